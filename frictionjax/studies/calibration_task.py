"""One case of a calibration: a machine of the prior, diagnosed, beside the truth."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from frictionjax.core import Estimate, InputError, require_x64
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.checked import is_right
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.studies.diagnosed_case import answer_of, kept_of
from frictionjax.studies.prior import FAMILIES, Truth, case_like, drawn_truth
from frictionjax.studies.task import AbstractTask, Block, Outcome

RANKED = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "strength")
"""Parameters whose ranks are kept; the last is the first strength of the effect."""
NAMES = 3
"""Names of a diagnosis that are kept: no diagnosis has more."""


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationTask(AbstractTask):
    """Draw a machine from the prior, with experiments of the family that the axis `family` says, and diagnose it.

    Results: `acting` (name of what acts; empty in the base model alone) and its `form`; `verdict`, `classes` and
    `seconds` of the diagnosis; `right`, whether what is named is what acts, within its class; over `name`, the
    `confidence` of each name and whether it is right, `name_right` (NaN beyond the last name); over `parameter`, the
    `rank` of the true value in the distribution that the diagnosis states, normal with the estimate and its standard
    error, from 0 to 1 (NaN where another effect is named, or nothing is stated).

    **Attributes:**

    - `units`: name of a result -> its unit.
    """

    units: Mapping[str, str] = dataclasses.field(default_factory=lambda: {"seconds": "s"})

    @property
    def lanes(self) -> int:
        """One machine at a time."""
        return 1

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """`name` and `parameter`."""
        return {"confidence": ("name",), "name_right": ("name",), "rank": ("parameter",)}

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` for other `axes` than `family`."""
        require_x64()
        if axes != ("family",):
            raise InputError(
                "it has one axis, `family`", place="`design`", cure=f'Give Axis("family", {list(FAMILIES)})'
            )

    def described(self) -> dict[str, Any]:
        """The families of the prior, and what is ranked."""
        return {"kind": "CalibrationTask", "families": list(FAMILIES), "ranked": list(RANKED)}

    def compute(self, seed: int, block: Block) -> Outcome:
        """Draw and diagnose the machine of a `block`; `seed` as in `AbstractTask`."""
        rng = np.random.default_rng([seed, int(block.streams[0])])
        truth = drawn_truth(str(block.columns["family"][0]), rng)
        outcome = kept_of(
            lambda: diagnose(case_like(truth, rng), progress=False), lambda found: compared(found, truth)
        )
        # Of a machine that could not be diagnosed it is known what acted.
        known = {"acting": ", ".join(truth.acting), "form": truth.form}
        texts = {name: np.array([text], dtype=object) for name, text in known.items()}
        return Outcome({**outcome.values, **texts}, outcome.reasons)


def compared(found: Diagnosis, truth: Truth) -> dict[str, Any]:
    """What was `found` beside the `truth`: the results of a `CalibrationTask` but what acted."""
    classes = [one.effect_class for one in found.missing]
    confidence, right = np.full(NAMES, np.nan), np.full(NAMES, np.nan)
    for place, one in enumerate(found.missing[:NAMES]):
        confidence[place] = one.confidence
        right[place] = bool(set(one.effect_class) & set(truth.acting))
    return {
        **answer_of(found),
        "right": is_right(truth.acting, classes),
        "confidence": confidence,
        "name_right": right,
        "rank": _ranks(found, truth),
    }


def _ranks(found: Diagnosis, truth: Truth) -> np.ndarray:
    """The rank of each parameter of `RANKED`, shape `(8,)`."""
    ranks = np.full(len(RANKED), np.nan)
    if tuple(one.effect for one in found.missing) != truth.acting:
        return ranks
    friction = truth.drive.friction
    true = {"J": float(truth.drive.J)} | {
        p.name: float(getattr(friction, p.name)) for p in friction.parameters
    }
    stated: dict[str, Estimate] = dict(found.extended)
    name, strength = truth.strength
    if name and name in found.missing[0].parameters:
        true["strength"], stated["strength"] = strength, found.missing[0].parameters[name]
    for place, name in enumerate(RANKED):
        one = stated.get(name)
        if one is not None and name in true and one.identified and 0.0 < one.stderr < np.inf:
            ranks[place] = scipy.stats.norm.cdf((true[name] - one.value) / one.stderr)
    return ranks
