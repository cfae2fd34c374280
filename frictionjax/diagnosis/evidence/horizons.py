"""How far two models are off at each horizon of a prediction, and how much force they lack, for one recording."""

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.views import View, ahead_samples
from frictionjax.diagnosis.recording_fit import Horizon, Unmeasured
from frictionjax.physics import Drive
from frictionjax.recordings import Recording


def rms_error(model: Float[np.ndarray, " m"], measured: Float[np.ndarray, " n"]) -> float:
    """Root mean square of what a `model` (samples, or one value for all) is off from what was `measured`; infinite
    where a run overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        value = float(np.sqrt(np.mean((model - measured) ** 2)))
    return value if np.isfinite(value) else float("inf")


def horizons_of(recording: Recording, row: int, base: View, extended: View) -> tuple[Horizon, ...]:
    """The errors of the `base` and the `extended` model on the `recording`, which is number `row` of their views: one
    sample, 0.1 s and 1 s ahead, as far as it is longer than twice that, and over the whole recording.

    Where the motion is imposed there are none: nothing that a model predicts enters its next prediction.
    """
    if base.one_sample is None or extended.one_sample is None:
        return ()
    x, n, dt = recording.x, recording.x.size, 1.0 / recording.sample_rate
    found = []
    for name, samples in (
        ("one_sample", 1),
        ("ahead", ahead_samples(dt)),
        ("one_second", round(1.0 / dt)),
    ):
        if getattr(base, name) is None or n < 2 * samples or (found and found[-1].seconds == samples * dt):
            continue
        off, off_extended = (
            rms_error(getattr(one, name)[row, samples:n], x[samples:]) for one in (base, extended)
        )
        found.append(Horizon(samples * dt, off, off_extended, rms_error(x[:-samples], x[samples:])))
    off, off_extended = (rms_error(one.free[row, :n], x) for one in (base, extended))
    return (*found, Horizon((n - 1) * dt, off, off_extended, rms_error(x[:1], x)))


def lacking_force(
    residual: Float[np.ndarray, " n"], deviation: float, applied: Float[np.ndarray, " n"], drive: Drive
) -> Unmeasured:
    """The part of a `residual` force that noise, whose standard deviation in it is `deviation`, does not explain
    (root mean square; force units), against the Coulomb friction of the `drive` and the `applied` force."""
    power = float(np.mean(np.square(residual)))
    force = float(np.sqrt(max(power - deviation**2, 0.0))) if np.isfinite(power) else float("inf")
    rms = float(np.sqrt(np.mean(np.square(applied))))
    return Unmeasured(force, force / float(drive.friction.Fc), force / max(rms, 1e-300))
