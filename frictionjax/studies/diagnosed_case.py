"""One case diagnosed as a case of a study: what is kept of the answer, and why there is none."""

import warnings
from collections.abc import Callable, Mapping
from typing import Any

from frictionjax.core import FrictionjaxWarning
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.studies.task import Outcome, joined, kept, one_line

_WITHIN, _BETWEEN = "|", ", "


def kept_of(diagnose: Callable[[], Diagnosis], keep: Callable[[Diagnosis], Mapping[str, Any]]) -> Outcome:
    """What `keep` takes of the diagnosis that `diagnose` makes; where it raises, the case counts as failed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FrictionjaxWarning)
            found = diagnose()
        return Outcome(joined([kept(keep(found))]), [""])
    except Exception as error:  # a failed case is a result: it is reported with the study
        return Outcome({}, [one_line(error)])


def answer_of(found: Diagnosis) -> dict[str, Any]:
    """What was `found`: `verdict`; `classes`, those of the named effects as `text_of` writes them, the name itself
    first; and `seconds` that it took."""
    classes = tuple((one.effect, *(n for n in one.effect_class if n != one.effect)) for one in found.missing)
    return {
        "verdict": found.verdict,
        "classes": text_of(classes),
        "seconds": float(found.seconds.get("total", float("nan"))),
    }


def text_of(classes: tuple[tuple[str, ...], ...]) -> str:
    """The `classes` of named effects as one text: members with bars, effects with commas between them."""
    return _BETWEEN.join(_WITHIN.join(members) for members in classes)


def classes_in(text: str) -> tuple[tuple[str, ...], ...]:
    """The classes that `text_of` wrote as a `text`."""
    return tuple(tuple(members.split(_WITHIN)) for members in text.split(_BETWEEN)) if text else ()
