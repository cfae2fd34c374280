"""Laws of slip that rise steeply stay finite and lose energy at every size that is admitted, however long the step."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects.elasto_plastic import ElastoPlastic
from frictionjax.physics.effects.sharp_yield import SharpYield
from frictionjax.simulation import simulate

N, RATE, MACHINES = 400, 2000.0, 40
CORE = next(p for p in ElastoPlastic.nuisances if p.name == "core")
(EXPONENT,) = SharpYield.strengths


def elasto_plastic(size):
    return ElastoPlastic(plasticity=1.0, core=size)


def sharp_yield(size):
    return SharpYield(exponent_change=size)


@eqx.filter_jit
def speeds(make, sizes, machines, inputs):
    """Velocities of each machine (inertia, damping of the bristle) under its input, with an effect of each size."""

    def run(size, machine, u):
        inertia, sigma1 = machine
        friction = LuGre(sigma0=1e5, sigma1=sigma1, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3)
        return simulate(Drive(inertia, friction, effects=(make(size),)), u, RATE).v

    return jax.vmap(jax.vmap(run, (None, 0, 0)), (0, None, None))(sizes, machines, inputs)


@pytest.mark.parametrize(
    ("make", "sizes"),
    [
        (elasto_plastic, np.linspace(CORE.lower, CORE.upper, 7)),
        (sharp_yield, np.linspace(EXPONENT.lower, EXPONENT.upper, 7)),
    ],
    ids=["elasto_plastic", "sharp_yield"],
)
def test_no_machine_gets_faster_than_its_motor_makes_it(make, sizes):
    rng = np.random.default_rng(0)
    machines = np.stack([10 ** rng.uniform(-2, 0.5, MACHINES), 10 ** rng.uniform(1, 3, MACHINES)], axis=1)
    inputs = np.repeat(rng.normal(size=(MACHINES, N // 20)), 20, axis=1)
    inputs *= 10 ** rng.uniform(-0.5, 1.2, (MACHINES, 1))
    found = np.asarray(speeds(make, jnp.asarray(sizes), jnp.asarray(machines), jnp.asarray(inputs)))
    assert np.isfinite(found).all()
    if make is elasto_plastic:
        # The impulse of the motor from the start on, over the inertia; friction only takes.
        fastest = np.abs(inputs).sum(axis=1) / RATE / machines[:, 0]
        assert (np.abs(found).max(axis=2) <= fastest).all()
