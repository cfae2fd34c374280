"""Rejection: how little the named effects must leave, or else the verdict is `unknown`."""

from collections.abc import Sequence

import numpy as np

from frictionjax.diagnosis.evidence.judgement import ADEQUATE_MISFIT, explained
from frictionjax.diagnosis.selection.decide import Step
from frictionjax.diagnosis.verdict import Verdict
from frictionjax.physics.effects import AbstractEffect

# Shares of the misfit, on fit or on held-out recordings. What the catalogue lacks resembles something in it, and what
# has a twin there is explained by it to a sixth and less: `python -m benchmarks.diagnosis` leaves each effect out in
# turn. The right names left 5 % at most where there is one law, elsewhere up to 30 % (the bank of seed 30 and three
# batches of `benchmarks.concealed`, from which these were chosen).
_ONE_LAW = 0.1
_SEVERAL_OF_ONE_LAW = 0.04
_ONE = 0.3
_SEVERAL = 0.1


def most_left(effects: Sequence[AbstractEffect]) -> float:
    """Share of the misfit that the accepted `effects` may leave together, and still be the name of what is missing.

    A delay is the same on every machine: what it leaves is something else. A law of creep or of hysteresis is a
    likeness, and what it leaves may be no more than that. Several effects have more ways to stand in for another.
    """
    alike = all(effect.about.one_law for effect in effects)
    if len(effects) == 1:
        return _ONE_LAW if alike else _ONE
    return _SEVERAL_OF_ONE_LAW if alike else _SEVERAL


def verdict_of(steps: list[Step]) -> tuple[Verdict, tuple[bool, float]]:
    """`adequate` when the base model is at the noise on fit and held-out recordings, with its parameters as they were
    fitted or with those of all recordings together; `named` when what was accepted explains enough of the whole; else
    `unknown`. Then whether something significant is left, and its share."""
    accepted = [step.accepted for step in steps if step.accepted is not None]
    first, floor = steps[0].before.judgement, steps[-1].floor
    if not accepted:
        if steps[0].together or all(first.within(floor, ADEQUATE_MISFIT)):
            return "adequate", (False, 0.0)
        return "unknown", (True, 1.0)
    last = accepted[-1].model.judgement
    share = float(np.clip(1.0 - min(explained(first, last, floor)), 0.0, 1.0))
    remains = not all(last.within(floor, 2.0 * ADEQUATE_MISFIT))
    if share < most_left([found.trial.form for found in accepted]):
        return "named", (bool(remains), share)
    return "unknown", (True, share)
