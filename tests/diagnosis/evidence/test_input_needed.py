"""No verdict where the input has nothing to do with the motion: the model predicts as well without it."""

import numpy as np
import pytest

from frictionjax.diagnosis import Effort, diagnose
from frictionjax.diagnosis.base_model.credibility import CREDIBLE, Credibility
from frictionjax.diagnosis.evidence.input_needed import INPUT, NOT_DRIVEN, input_is_needed
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import OtherDecision
from frictionjax.recordings import Case, Plant, Recording

RATE = 1000.0


def unrelated(name, role, seed):
    """A sine that rings on by itself, beside a square wave of another period."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE
    x = 1e-3 * np.sin(2.0 * np.pi * 1.7 * t + seed) + 1e-7 * rng.standard_normal(t.size)
    return Recording(name, RATE, np.sign(np.sin(2.0 * np.pi * 0.9 * t + 2.0 * seed)), x, role=role)


@pytest.mark.slow
def test_a_motion_that_its_input_does_not_make_gets_no_name():
    recordings = (unrelated("a", "fit", 0), unrelated("b", "fit", 1), unrelated("c", "holdout", 2))
    found = diagnose(Case("rings", Plant(motor_constant=1.0), recordings), effort=Effort(rounds=1))
    assert (found.verdict, found.missing) == ("unknown", ())
    assert found.summary.startswith((NOT_DRIVEN, "Check that u is what drives x"))
    decided = {one.about: one for one in found.decided}
    credible = Credibility(**decided[CREDIBLE].numbers, failed=()).is_credible()
    assert not credible or not input_is_needed(decided[INPUT], Rule())


def test_an_error_that_stays_needs_no_input():
    for without, needed in (
        (1.0, False),
        (0.5, False),
        (2.0, True),
        (float("inf"), True),
        (float("nan"), True),
    ):
        compared = OtherDecision(INPUT, {"error": 1.0, "error_without_input": without})
        assert input_is_needed(compared, Rule()) == needed
