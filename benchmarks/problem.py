"""The work that all simulators are given: a linear stage under noise that breaks it away now and then."""

import jax.numpy as jnp
import numpy as np

from frictionjax.physics import Drive, LuGre

NAMES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
STAGE = np.array([13.7, 3.5e5, 840.0, 41.0, 25.6, 29.2, 7.7e-3])
"""kg, N/m, N s/m, N s/m, N, N, m/s; numbers of this project."""
SAMPLE_RATE = 2000.0
DT = 1.0 / SAMPLE_RATE


def drive_of(parameters) -> Drive:
    """The drive with `parameters` in the order of `NAMES`; each a number or an array over drives."""
    J, *friction = parameters
    return Drive(J, LuGre(*friction))


def force(samples: int) -> np.ndarray:
    """Force noise, shape `(samples,)`, N: 0.7 times the break-away force in rms."""
    return 0.7 * STAGE[5] * np.random.default_rng(2002).normal(size=samples)


def many(drives: int) -> np.ndarray:
    """Parameters of `drives` stages, 10 % apart, shape `(drives, 7)`."""
    return STAGE * np.exp(0.1 * np.random.default_rng(1).normal(size=(drives, 7)))


def last(run):
    """The last position of a run."""
    return run.x[-1]


def rms(error) -> float:
    """Root mean square."""
    return float(jnp.sqrt(jnp.mean(jnp.square(error))))
