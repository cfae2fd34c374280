"""Fig. 4 on the twins: FRFs at several levels, the second-order fit up to 150 Hz, and its limit at zero amplitude."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError, Progress, silent
from frictionjax.excitation import prbs
from frictionjax.frequency import (
    FRF,
    SKResult,
    ZeroAmplitude,
    estimate_frf,
    extrapolate_to_zero_amplitude,
    fit_sk,
)
from frictionjax.paper.experiments.rig import SAMPLE_RATE, Twin, measure, twins

SEGMENT, BANDWIDTH = 8192, 500.0  # the paper's
BAND = (2.0, 150.0)  # Hz; 150 is the paper's
LEVELS = (0.00125, 0.0025, 0.005, 0.01, 0.015, 0.02, 0.025)  # V rms; 0.01 is the paper's smallest
PAPER_LEVEL = 0.01  # V
_UNITS = {"force": "N*m", "position": "rad"}


class Identified(eqx.Module):
    """Parameters of one twin from its frequency responses.

    **Attributes:**

    - `twin`: the machine.
    - `levels`: rms of the PRBS, V, shape `(k,)`.
    - `frfs`: the measured response at each level.
    - `fits`: the second-order system with a delay, fitted up to 150 Hz, at each level.
    - `without_delay`: the same fit without a delay, as the paper describes it, at each level.
    - `paper`: which level is the paper's.
    - `zero_amplitude`: the stiffness extrapolated to a level of zero.
    """

    twin: Twin
    levels: Float[np.ndarray, " k"]
    frfs: tuple[FRF, ...]
    fits: tuple[SKResult, ...]
    without_delay: tuple[SKResult, ...]
    paper: int = eqx.field(static=True)
    zero_amplitude: ZeroAmplitude

    @property
    def fit(self) -> SKResult:
        """The paper's estimate: the fit with a delay at the paper's level."""
        return self.fits[self.paper]


def identify(
    machines: Sequence[Twin] | None = None,
    *,
    levels: Sequence[float] = LEVELS,
    averages: int = 50,
    seed: int = 0,
    progress: Progress = silent,
) -> tuple[Identified, ...]:
    """Measure and fit the presliding response of each machine, as the paper's Section IV does.

    **Arguments:**

    - `machines`: the twins; the study's four when absent.
    - `levels`: rms of the noise, V, ascending; 0.01, the paper's, must be one of them, and three are needed.
    - `averages`: number of segments in an average; the paper's is 50.
    - `seed`: of the noise; the same sequence is applied to every machine, an independent one at every level.
    - `progress`: called as the work goes on.

    **Returns:** an `Identified` for each machine.

    **Raises:** `InputError` when 0.01 V is not among the `levels` or fewer than three are given.
    """
    machines = twins() if machines is None else tuple(machines)
    if PAPER_LEVEL not in levels or len(levels) < 3:
        raise InputError(
            f"`levels` = {tuple(levels)} must contain the paper's {PAPER_LEVEL} V and at least three values",
            cure="Add lower ones, such as 0.0025 and 0.005.",
        )
    n = SEGMENT + (averages - 1) * (SEGMENT // 2)
    progress("measuring frequency responses of the twins", 0.0)
    noise = [
        prbs(key, n, SAMPLE_RATE, BANDWIDTH, rms)
        for key, rms in zip(jax.random.split(jax.random.key(seed), len(levels)), levels, strict=True)
    ]
    volts = np.tile(np.stack([np.asarray(u) for u in noise], axis=1), (1, len(machines)))
    run = measure([twin for twin in machines for _ in levels], volts, seed=seed)
    found = []
    for i, twin in enumerate(machines):
        progress("fitting the second-order response", 0.5 + 0.5 * i / len(machines))
        columns = range(i * len(levels), (i + 1) * len(levels))
        # The arm drifts slowly under noise this strong; a line through each segment takes most of that away.
        frfs = tuple(
            estimate_frf(run.u[:, c], run.x[:, c], SAMPLE_RATE, segment=SEGMENT, detrend="linear")
            for c in columns
        )
        fits, plain = (
            tuple(
                fit_sk(frf, BAND, motor_constant=twin.motor_constant, fit_delay=delay, units=_UNITS)
                for frf in frfs
            )
            for delay in (True, False)
        )
        zero = extrapolate_to_zero_amplitude(
            np.asarray(levels),
            np.array([fit.stiffness.value for fit in fits]),
            np.array([fit.stiffness.stderr for fit in fits]),
            unit="N*m/rad",
        )
        found.append(
            Identified(
                twin=twin,
                levels=np.asarray(levels, float),
                frfs=frfs,
                fits=fits,
                without_delay=plain,
                paper=list(levels).index(PAPER_LEVEL),
                zero_amplitude=zero,
            )
        )
    progress("frequency responses fitted", 1.0)
    return tuple(found)
