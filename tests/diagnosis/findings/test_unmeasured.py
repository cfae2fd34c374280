"""The unmeasured force in units, against friction and the applied force."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers_estimation import PLANT

from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.findings.unmeasured import unmeasured_force
from frictionjax.diagnosis.recording_fit import Unmeasured
from frictionjax.diagnosis.verdict import Unexplained

pytestmark = pytest.mark.untyped

VALID = np.array([[0.0, 1.0, 1.0, 1.0]])


def model(inputs, answer):
    """A model of `PLANT` on one recording whose first sample is not scored."""
    batch = SimpleNamespace(valid=VALID, inputs=inputs, answer=answer)
    return SimpleNamespace(posterior=SimpleNamespace(batch=batch), judgement=SimpleNamespace(drive=PLANT))


def test_the_applied_force_is_that_of_the_motor():
    u, constant, coulomb = (
        np.array([[99.0, 1.0, -2.0, 2.0]]),
        float(PLANT.motor_constant),
        float(PLANT.friction.Fc),
    )
    found = unmeasured_force(model(u, np.zeros((1, 4))), 0.1)
    assert found.force == pytest.approx(0.1 * coulomb)
    assert found.of_coulomb == 0.1
    assert found.of_applied == pytest.approx(0.1 * coulomb / (constant * np.sqrt(3.0)))


def test_under_an_imposed_motion_it_is_the_measured_force():
    found = unmeasured_force(model(None, np.array([[99.0, 3.0, -3.0, 3.0]])), 0.2)
    assert found.of_applied == pytest.approx(0.2 * float(PLANT.friction.Fc) / 3.0)


def test_an_unmeasured_force_is_not_called_noise():
    force = Unmeasured(0.0523, 0.121, 0.0456)
    found = summary_sentence("adequate", (), Unexplained(False, 0.0, ""), "", (), force, "N*m")
    assert (
        "an unmeasured force of 0.052 N*m rms (12 % of Coulomb friction, 4.6 % of the applied force)" in found
    )
    assert "above the noise" not in found
    small = summary_sentence(
        "adequate", (), Unexplained(False, 0.0, ""), "", (), Unmeasured(0.01, 0.02, 0.004), "N*m"
    )
    assert small.endswith("significant above the noise.")
