"""Blows of a load against the flanks of its gap that no step follows: runs and derivatives stay finite and bounded."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import effect

from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate

SIZES = {
    "ratio": (0.0, 0.97),
    "gap": (1e-7, 1e-1),
    "frequency": (3.0, 400.0),
    "damping": (1e-3, 1.0),
    "drag": (1e-2, 100.0),
    "bristle": (0.02, 0.6),
    "vs": (1e-4, 1e-1),
    "J": (1e-2, 3.0),
}
"""Ranges from which gaps and machines are drawn, the ratio evenly, the others in their logarithm; `bristle`:
natural frequency in rad a sample, up to what a fit admits."""
COUNT, SAMPLES = 200, 300


def _run(numbers, u, rate):
    ratio, gap, frequency, damping, drag, bristle, vs, inertia = numbers
    sigma0 = inertia * (bristle * rate) ** 2
    sigma1 = 0.2 * jnp.sqrt(sigma0 * inertia)
    friction = LuGre(sigma0=sigma0, sigma1=sigma1, sigma2=0.4, Fc=1.0, Fs=1.5, vs=vs)
    load = effect("Backlash", ratio=ratio, gap=gap, frequency=frequency, damping=damping, drag=drag)
    run = simulate(Drive(J=inertia, friction=friction, effects=(load,)), u, rate)
    return jnp.mean(run.x**2), (run.x, run.v)


@pytest.mark.parametrize("rate", [1000.0, 2000.0])
def test_no_load_leaves_a_flank_faster_than_forces_can_drive_it(rate):
    """At 400 Hz and 1000 samples a second a blow is over within a step: the step may be wrong, but makes no energy."""
    rng = np.random.default_rng(0)
    low, high = np.array(list(SIZES.values())).T
    numbers = rng.uniform(np.log(np.maximum(low, 1e-12)), np.log(high), (COUNT, len(SIZES)))
    numbers = np.exp(numbers)
    numbers[:, 0] = rng.uniform(low[0], high[0], COUNT)
    amplitudes = 10.0 ** rng.uniform(-1.0, 1.2, (COUNT, 1))
    u = np.repeat(rng.normal(size=(COUNT, SAMPLES // 20)) * amplitudes, 20, axis=1)
    program = jax.jit(jax.vmap(jax.value_and_grad(_run, has_aux=True), in_axes=(0, 0, None)))
    (value, (x, v)), slope = jax.tree.map(np.asarray, program(jnp.asarray(numbers), jnp.asarray(u), rate))
    assert np.all(np.isfinite(value))
    assert np.all(np.isfinite(slope))
    largest = np.sum(np.abs(u), axis=1) / rate / (numbers[:, -1] * (1.0 - numbers[:, 0]))
    assert np.all(np.abs(v).max(axis=1) < largest)
    assert np.all(np.abs(x).max(axis=1) < largest * SAMPLES / rate)
