"""What base and extended model make of each recording."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.horizons import horizons_of, lacking_force, rms_error
from frictionjax.diagnosis.evidence.imposed_views import smoothing_width
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.views import GivenPredictions, View, ahead_samples, force_bandwidth
from frictionjax.diagnosis.recording_fit import ClosedLoop, RecordingFit
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation import residual_force_std


def _increment_rmse(
    run: Float[np.ndarray, " n"] | None, measured: Float[np.ndarray, " n"], horizon: int
) -> float | None:
    """Root mean square error of what a free `run` moves in `horizon` samples against what was measured to move; None
    without a run.

    It is the error of a run that is put on the measured position each time and keeps its own velocity: the drift of
    long ago does not count, and it needs no observer.
    """
    if run is None:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        off = run - measured
        moved = off[horizon:] - off[:-horizon]
    return rms_error(moved, np.zeros_like(moved))


def recording_fits(
    recordings: tuple[Recording, ...],
    scene: Scene,
    base: View,
    extended: View,
    base_drive: Drive,
    given: GivenPredictions | None = None,
    closed: Sequence[ClosedLoop | None] | None = None,
) -> tuple[RecordingFit, ...]:
    """One `RecordingFit` per recording.

    **Arguments:**

    - `recordings`: in the order of the scene.
    - `scene`: the same recordings, in arrays.
    - `base`, `extended`: what the two models predict.
    - `base_drive`: for the standard deviation of the residual force.
    - `given`: what the user's own simulation predicts, as it was given; None where there is none.
    - `closed`: the errors of each recording under the user's own controller; None where there is none.
    """
    fits = []
    for row, recording in enumerate(recordings):
        n = recording.x.size
        noise, dt = float(scene.batch.noise[row]), 1.0 / recording.sample_rate
        if recording.drive == "motion":
            # Imposed motions of all rates have the horizon and the smoothing of the lowest rate.
            slowest = float(np.max(np.asarray(scene.batch.dt)))
            measured, horizon = np.asarray(recording.force), ahead_samples(slowest)
            std = noise / np.sqrt(smoothing_width(force_bandwidth(slowest), dt))
            applied = measured
        else:
            measured, horizon = recording.x, ahead_samples(dt)
            std = residual_force_std(noise, float(base_drive.J), dt, force_bandwidth(dt))
            applied = float(base_drive.motor_constant) * recording.u
        # In a horizon the noise of an integrated velocity makes so many steps, each of twice its power.
        drift = np.sqrt(2.0 * horizon) if recording.integrated else 1.0
        # Nothing is predicted before the first horizon has passed.
        scored = slice(horizon, n)
        own = None if given is None or not given.there[row] else given.free[row, :n]
        own_ahead = None if own is None or given is None or given.ahead is None else given.ahead[row, scored]
        fits.append(
            RecordingFit(
                name=recording.name,
                role=recording.role,
                t=recording.t,
                u=recording.u,
                x=recording.x,
                free_base=base.free[row, :n],
                free_extended=extended.free[row, :n],
                predicted_base=base.ahead[row, :n],
                predicted_extended=extended.ahead[row, :n],
                residual_force=base.force[row, :n],
                residual_force_extended=extended.force[row, :n],
                residual_force_std=np.full(n, std),
                horizons=horizons_of(recording, row, base, extended),
                unmeasured_base=lacking_force(base.force[row, :n], std, applied, base_drive),
                unmeasured_extended=lacking_force(extended.force[row, :n], std, applied, base_drive),
                noise_floor=float(drift * noise),
                sensor_noise=noise if recording.integrated else None,
                free_run_rmse_base=rms_error(base.free[row, :n], measured),
                free_run_rmse_extended=rms_error(extended.free[row, :n], measured),
                prediction_rmse_base=rms_error(base.ahead[row, scored], measured[scored]),
                prediction_rmse_extended=rms_error(extended.ahead[row, scored], measured[scored]),
                drive=recording.drive,
                force=recording.force if recording.drive == "motion" else None,
                free_run_rmse_given=None if own is None else rms_error(own, measured),
                prediction_rmse_given=None if own_ahead is None else rms_error(own_ahead, measured[scored]),
                free_given=own,
                increment_rmse_base=_increment_rmse(base.free[row, :n], measured, horizon),
                increment_rmse_extended=_increment_rmse(extended.free[row, :n], measured, horizon),
                increment_rmse_given=_increment_rmse(own, measured, horizon),
                closed_loop=None if closed is None else closed[row],
            )
        )
    return tuple(fits)
