"""Machines side by side, as rows of one batch, do what each does alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import STAGE, effect

from frictionjax.simulation import innovations, observer_gains, simulate
from frictionjax.simulation.lanes import innovations_side_by_side, repeated, tiled

N = 600
DT = jnp.asarray([1.0 / 2000.0, 1.0 / 1500.0])
FORCE = float(STAGE.friction.Fs / STAGE.motor_constant)
EFFECTS = {
    "the base model": (),
    "a delay of the input": (effect("Delay", delay=0.4e-3),),
    "states of its own": (effect("Creep", compliance=0.5), effect("WarmupByTime", fall=0.2)),
    "a second inertia": (effect("FlexibleTransmission", ratio=0.2),),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_each_machine_before_each_recording(name):
    """Three machines of different friction, two recordings of different sample rates that begin apart."""
    drive = STAGE.with_effects(*EFFECTS[name])
    u = FORCE * np.random.default_rng(5).normal(size=(2, N))
    x = jnp.stack([simulate(STAGE, u[row], 1.0 / float(DT[row]), substeps=1).x for row in range(2)])
    gains = observer_gains(jnp.full(2, 60.0), DT)
    factors = jnp.asarray([0.9, 1.0, 1.2])
    drives = jax.vmap(lambda factor: jax.tree.map(lambda leaf: factor * leaf, drive))(factors)
    bend = STAGE.friction.Fs / STAGE.friction.sigma0
    z0 = bend * jnp.asarray([[0.0, 0.1], [0.2, -0.3], [0.4, 0.0]])
    x0, v0 = x[:, 0], jnp.asarray([0.0, 1e-3])
    found = jax.jit(innovations_side_by_side)(drives, jnp.asarray(u), x, DT, gains, (x0, v0, z0))
    alone = jax.jit(innovations)
    for lane in range(3):
        own = jax.tree.map(lambda leaf, lane=lane: leaf[lane], drives)
        for row in range(2):
            force = own.applied_force(jnp.asarray(u[row]), DT[row])
            its = jax.tree.map(lambda leaf, row=row: leaf[row], gains)
            true = alone(own, force, x[row], DT[row], its, (x0[row], v0[row], z0[lane, row]))
            assert float(jnp.max(jnp.abs(true))) > 0.0
            np.testing.assert_allclose(found[lane, row], true, rtol=1e-7, atol=1e-9 * float(bend))


def test_rows_are_repeated_as_they_are_numbered():
    """Row `k r + j` is recording j before machine k."""
    assert tiled(jnp.arange(2), 3).tolist() == [0, 1, 0, 1, 0, 1]
    assert repeated(jnp.arange(3), 2).tolist() == [0, 0, 1, 1, 2, 2]
    assert tiled(jnp.ones((2, 5)), 3).shape == repeated(jnp.ones((2, 5)), 3).shape == (6, 5)
