"""Refits: where they begin."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.refit import uncoupled
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.joint import extend, make_joint
from frictionjax.estimation.scales import plant_scales


@pytest.mark.parametrize("known", [False, True])
def test_the_inertia_found_is_taken_for_that_of_the_motor_alone(known):
    """Motor inertia, stiffness and damping stay what they were when a load of 0.3 of the whole is hung behind a gap; a
    known inertia is that of the whole."""
    batch = make_batch((open_loop("stick", stick_noise(), seed=1),), encoder_step=FINE)
    joint, vector = make_joint(PLANT, batch, np.array([False]), known_inertia=known)
    joint, vector = extend(joint, vector, effect("Backlash"), plant_scales(PLANT, batch))
    place = next(i for i, free in enumerate(joint.layout) if free.parameter.name == "ratio")
    hung = uncoupled(joint, vector.at[place].set(0.3 / joint.layout[place].scale))
    drive = joint.drive(hung)
    side = drive.load_side
    assert side is not None and float(side.ratio) == pytest.approx(0.3, rel=1e-12)
    factor = 1.0 if known else 1.0 / 0.7
    assert float(drive.J) == pytest.approx(factor * float(PLANT.J), rel=1e-9)
    for name in ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs"):
        assert float(getattr(drive.friction, name)) == pytest.approx(
            float(getattr(PLANT.friction, name)), rel=1e-9
        ), name
    assert bool(jnp.all(jnp.isfinite(hung)))
