"""The motion of each recording as the report draws it: smoothed, with friction and what preceded each sample."""

import math
from collections.abc import Mapping

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Bool, Float

from frictionjax.core import Estimate
from frictionjax.diagnosis.mismatch_map.history import last_rest, since_reversal
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.estimation.start.sliding import WINDOWS, smooth_motion
from frictionjax.recordings import Plant, Recording

_SIGNIFICANT = 4.0  # standard deviations of its noise above which a velocity is one
_BENDS = 10.0  # deflections at break-away after which LuGre's bristle has its steady state


class PlottedMotion(eqx.Module):
    """The motion in one recording, as the report plots it: arrays of shape `(n,)`.

    **Attributes:** `name`; `t` (s), `u` (input units), `x`, `v` (position units, per s); the friction force as
    `measured`, of the `base` and of the `extended` model (force units: what of the applied force does not accelerate
    the inertia of the base model); the residual force `lacks_base` and `lacks_extended` (force units); `travel` since
    the last reversal, or since the first sample (position units); `rest` (length of the last rest, s), `slides` and
    `rests` (which samples do).
    """

    name: str = eqx.field(static=True)
    t: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " n"]
    x: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    base: Float[np.ndarray, " n"]
    extended: Float[np.ndarray, " n"]
    lacks_base: Float[np.ndarray, " n"]
    lacks_extended: Float[np.ndarray, " n"]
    travel: Float[np.ndarray, " n"]
    rest: Float[np.ndarray, " n"]
    slides: Bool[np.ndarray, " n"]
    rests: Bool[np.ndarray, " n"]

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(self.t[-1] - self.t[0]) / (self.t.size - 1)

    @property
    def direction(self) -> Float[np.ndarray, " n"]:
        """+1 or -1, the direction of the motion; 0 at rest."""
        return np.where(self.rests, 0.0, np.sign(self.v))


def motions_of(diagnosis: Diagnosis) -> tuple[PlottedMotion, ...]:
    """The recordings of a `diagnosis` that are long enough to be smoothed, in its order."""
    long = [one for one in diagnosis.recordings if one.t.size > _LEAST and one.t[-1] > one.t[0]]
    return tuple(_motion(one, diagnosis.plant, diagnosis.base) for one in long)


_LEAST = 10  # samples


def bristle_bend(base: Mapping[str, Estimate]) -> float:
    """Deflection of the bristle at break-away, Fs/sigma0, position units, of the `base` model; NaN where unknown."""
    if not {"Fs", "sigma0"} <= base.keys() or not base["sigma0"].value > 0.0:
        return math.nan
    return base["Fs"].value / base["sigma0"].value


def _motion(recording: RecordingFit, plant: Plant, base: Mapping[str, Estimate]) -> PlottedMotion:
    t, rate = recording.t, (recording.t.size - 1) / float(recording.t[-1] - recording.t[0])
    constant = plant.motor_constant or 1.0
    smooth = smooth_motion(Recording(recording.name, rate, recording.u, recording.x), constant)
    slow = _SIGNIFICANT * _noise_of_velocity(recording, plant, rate)
    if recording.drive == "motion" and recording.force is not None:
        measured, before, after = recording.force, recording.free_base, recording.free_extended
    else:
        inertia = base["J"].value if "J" in base else plant.inertia or 0.0
        measured = smooth.force - inertia * smooth.a
        before, after = measured + recording.residual_force, measured + recording.residual_force_extended
    _, travel = since_reversal(smooth.x, smooth.v, slow, 1.0 / rate)
    # A recording begins at rest, or in motion that lasted for a time unknown.
    travel = np.where(np.isfinite(travel), travel, np.abs(smooth.x - smooth.x[0]))
    rest, rests = last_rest(smooth.v, slow, 1.0 / rate)
    far = _BENDS * bristle_bend(base)
    return PlottedMotion(
        recording.name,
        t,
        recording.u,
        smooth.x,
        smooth.v,
        measured,
        before,
        after,
        recording.residual_force,
        recording.residual_force_extended,
        travel,
        rest,
        (np.abs(smooth.v) > slow) & (travel > far) & ~rests,
        rests,
    )


def _noise_of_velocity(recording: RecordingFit, plant: Plant, rate: float) -> float:
    """Standard deviation of the smoothed velocity, from the noise of the position."""
    step = (plant.encoder_step or 0.0) / math.sqrt(12.0)
    noise = step if recording.drive == "motion" else max(step, recording.noise_floor)
    window = min(max(round(WINDOWS[0] * rate) | 1, 7), (recording.x.size - 1) | 1)
    return noise * float(np.linalg.norm(scipy.signal.savgol_coeffs(window, 3, deriv=1, delta=1.0 / rate)))
