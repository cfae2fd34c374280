"""A verdict.json read again: why an effect was named in it or not."""

import math
from pathlib import Path
from typing import Any, NamedTuple

from frictionjax.core import InputError
from frictionjax.diagnosis.explain import explain_effect
from frictionjax.diagnosis.verdict import Candidate
from frictionjax.report.save import SCHEMA


class _Named(NamedTuple):
    effect: str
    effect_class: tuple[str, ...]
    split_by: str


class _Saved(NamedTuple):
    candidates: list[Candidate]
    missing: list[_Named]


def explain_saved(content: Any, effect: str, *, file: Path) -> str:
    """Why an effect was named or not, from a saved verdict.

    **Arguments:**

    - `content`: what verdict.json holds, schema `frictionjax.verdict/1`.
    - `effect`: a name of the catalogue.
    - `file`: where it comes from, for messages.

    **Returns:** a few sentences, as from `Diagnosis.explain`.

    **Raises:** `InputError` for content of another schema, and for a name that is not among its candidates.
    """
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(
            f"is not of the schema {SCHEMA}", file=file, cure="Give the verdict.json of a diagnosis"
        )
    try:
        saved = _Saved(
            [
                Candidate(
                    effect=row["effect"],
                    p_value=_number(row["p_value"]),
                    minimum_detectable={
                        name: _number(size) for name, size in row["minimum_detectable"].items()
                    },
                    tested=row["tested"],
                    reason=row["reason"],
                    gain_fit=_number(row.get("gain_fit")),
                    gain_holdout=_number(row.get("gain_holdout")),
                    units=row.get("units", {}),
                )
                for row in content["candidates"]
            ],
            [_Named(row["effect"], tuple(row["class"]), row["split_by"]) for row in content["missing"]],
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(
            f"is damaged: what is needed for an explanation is not in it ({error})",
            file=file,
            cure="Give the verdict.json as `diagnose` wrote it",
        ) from error
    return explain_effect(saved, effect)


def _number(value: Any) -> float:
    """A number of the file; null stands for what was not finite."""
    return math.nan if value is None else float(value)
