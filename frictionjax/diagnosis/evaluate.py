"""What base and extended model say of every recording: free run, 0.1 s ahead, residual force."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from frictionjax.diagnosis.imposed import smoothing_width, view_of_forces
from frictionjax.diagnosis.judge import Judgement, Scene
from frictionjax.diagnosis.verdict import RecordingFit
from frictionjax.estimation.imposed_batch import ImposedBatch
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation import (
    Gains,
    innovation_gain,
    observe,
    observer_gains,
    residual_force,
    residual_force_std,
    simulate,
)
from frictionjax.simulation.prediction import run_ahead

_AHEAD = 0.1  # s
_FORCE_BANDWIDTH = 25.0  # Hz


class View(eqx.Module):
    """One model's view of all recordings, shape `(r, n)`: `free` run and `ahead` by 0.1 s, of the position, or of the
    force where the motion is imposed; residual `force`; and the observer's `v` and `bend` (|z| over Fs/sigma0), and its
    standardised innovations `e` (`v`, `bend` and errors of the run where the motion is imposed)."""

    free: np.ndarray
    ahead: np.ndarray
    force: np.ndarray
    v: np.ndarray
    bend: np.ndarray
    e: np.ndarray


@eqx.filter_jit
def _view(drive: Drive, batch, gains, deflection, first, bandwidth, horizon, stride):
    def one(u, x, dt, position_gain, velocity_gain, x0, v0, z0, x_first, before):
        force = drive.applied_force(u, dt)
        own = Gains(position_gain, velocity_gain)
        start = (x0, v0, z0, before)
        # The free run knows the first sample alone.
        run = simulate(drive, u, 1.0 / dt, x0=x_first, substeps=2, before=before)
        free = jax.vmap(drive.seen)(run.x, run.v, run.t)
        seen = observe(drive, force, x, dt, own, start)
        ahead = run_ahead(drive, force, seen, dt, own, horizon=horizon, stride=stride)
        missing = residual_force(drive, force, x, dt, bandwidth, start)
        bend = jnp.abs(seen.z[:, 0]) * drive.friction.sigma0 / drive.friction.Fs
        return free, ahead, missing, seen.v, bend, seen.innovation

    z0 = deflection * drive.friction.Fs / drive.friction.sigma0
    return jax.vmap(one)(
        batch.u,
        batch.x,
        batch.dt,
        gains.position,
        gains.velocity,
        batch.x0,
        batch.v0,
        z0,
        first,
        batch.before,
    )


def view(judgement: Judgement, scene: Scene) -> View:
    """See all recordings of the `scene` through the model of the `judgement`."""
    batch = scene.batch
    if isinstance(batch, ImposedBatch):
        horizon, bandwidth = _horizon(scene), _force_bandwidth(scene)
        seen = view_of_forces(judgement, batch, horizon, bandwidth)
        return View(seen.free, seen.ahead, seen.missing, seen.v, seen.bend, seen.e)
    gains = observer_gains(jnp.minimum(scene.bandwidth, 0.1 / batch.dt), batch.dt)
    horizon = _horizon(scene)
    parts = _view(
        judgement.drive,
        batch,
        gains,
        jnp.asarray(judgement.deflection),
        batch.x[:, 0],
        jnp.asarray(_force_bandwidth(scene)),
        horizon,
        max(horizon // 40, 1),
    )
    free, ahead, force, v, bend, innovation = (np.asarray(part) for part in parts)
    unit = np.asarray(batch.noise * innovation_gain(gains))[:, None]
    return View(free, ahead, force, v, bend, innovation / unit * np.asarray(batch.valid))


def _horizon(scene: Scene) -> int:
    """Samples in the 0.1 s that models look ahead."""
    return max(round(_AHEAD / float(np.max(np.asarray(scene.batch.dt)))), 1)


def _force_bandwidth(scene: Scene) -> float:
    """Bandwidth of the residual force, Hz."""
    return min(_FORCE_BANDWIDTH, 0.05 / float(np.max(np.asarray(scene.batch.dt))))


def _rmse(model: np.ndarray, measured: np.ndarray) -> float:
    value = float(np.sqrt(np.mean((model - measured) ** 2)))
    return value if np.isfinite(value) else float("inf")


def recording_fits(
    recordings: tuple[Recording, ...], scene: Scene, base: View, extended: View, base_drive: Drive
) -> tuple[RecordingFit, ...]:
    """One `RecordingFit` per recording.

    **Arguments:**

    - `recordings`: in the order of the scene.
    - `scene`: the recordings side by side.
    - `base`, `extended`: the two models' views.
    - `base_drive`: for the standard deviation of the residual force.
    """
    fits = []
    for row, recording in enumerate(recordings):
        n = recording.x.size
        noise, dt, bandwidth = (
            float(scene.batch.noise[row]),
            1.0 / recording.sample_rate,
            _force_bandwidth(scene),
        )
        if recording.drive == "motion":
            measured = np.asarray(recording.force)
            std = noise / np.sqrt(smoothing_width(bandwidth, dt))
        else:
            measured = recording.x
            std = residual_force_std(noise, float(base_drive.J), dt, bandwidth)
        # Nothing is predicted before the first horizon has passed.
        judged = slice(_horizon(scene), n)
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
                noise_floor=noise,
                free_run_rmse_base=_rmse(base.free[row, :n], measured),
                free_run_rmse_extended=_rmse(extended.free[row, :n], measured),
                prediction_rmse_base=_rmse(base.ahead[row, judged], measured[judged]),
                prediction_rmse_extended=_rmse(extended.ahead[row, judged], measured[judged]),
                drive=recording.drive,
                force=recording.force if recording.drive == "motion" else None,
            )
        )
    return tuple(fits)
