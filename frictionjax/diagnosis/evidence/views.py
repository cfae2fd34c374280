"""What a model predicts for every recording: free run, prediction 0.1 s ahead, residual force."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.diagnosis.evidence.imposed_views import smoothing_width, view_of_forces
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.verdict import RecordingFit
from frictionjax.estimation.data.batch import Batch, rows_of
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
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
    """One model's predictions of all recordings, arrays of shape `(r, n)`: `free` run and `ahead` by 0.1 s, of the
    position, or of the force where the motion is imposed; residual `force`; and the observer's `v`, `bend` (|z| over
    Fs/sigma0) and standardised innovations `e` (where the motion is imposed: velocity, bend and standardised errors of
    the run)."""

    free: Float[np.ndarray, "r n"]
    ahead: Float[np.ndarray, "r n"]
    force: Float[np.ndarray, "r n"]
    v: Float[np.ndarray, "r n"]
    bend: Float[np.ndarray, "r n"]
    e: Float[np.ndarray, "r n"]


@eqx.filter_jit
def _view(
    drive: Drive,
    batch: Batch,
    gains: Gains,
    deflection: Float[Array, " r"],
    first: Float[Array, " r"],
    bandwidth: Float[Array, ""],
    horizon: int,
    stride: int,
) -> tuple[Float[Array, "r n"], ...]:
    def one(
        u: Float[Array, " n"],
        x: Float[Array, " n"],
        dt: Float[Array, ""],
        gains: Gains,
        start: tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""], Before],
        x_first: Float[Array, ""],
        length: Int[Array, ""],
    ) -> tuple[Float[Array, " n"], ...]:
        force, before = drive.applied_force(u, dt), start[3]
        # The free run uses the first sample only.
        steps = batch.substeps
        free = simulate(drive, u, 1.0 / dt, x0=x_first, substeps=max(steps, 2), before=before).measured
        observed = observe(drive, force, x, dt, gains, start, substeps=steps)
        ahead = run_ahead(drive, force, observed, dt, gains, horizon=horizon, stride=stride, substeps=steps)
        missing = residual_force(drive, force, x, dt, bandwidth, start, substeps=steps, measured=length)
        bend = jnp.abs(observed.z[:, 0]) * drive.friction.sigma0 / drive.friction.Fs
        return free, ahead, missing, observed.v, bend, observed.innovation

    deflection = deflection * drive.friction.Fs / drive.friction.sigma0
    return batch.each(one, gains, deflection, first, jnp.asarray(batch.lengths))


def view(judgement: Judgement, scene: Scene) -> View:
    """Predict all recordings of the `scene` by the model of the `judgement`."""
    batch = scene.batch
    dt = np.asarray(batch.dt)
    if batch.imposed:
        slowest = float(np.max(dt))
        own = (ahead_samples(slowest), force_bandwidth(slowest))
        forces = view_of_forces(judgement, batch, *own)  # type: ignore[arg-type]
        return View(forces.free, forces.ahead, forces.missing, forces.v, forces.bend, forces.e)
    shape = np.asarray(batch.x).shape
    whole = {field.name: np.zeros(shape) for field in dataclasses.fields(View)}
    # At another sample rate the 0.1 s ahead are another number of samples.
    for step in np.unique(dt):
        rows = np.flatnonzero(dt == step)
        length = shape[1] if rows.size == dt.size else int(np.max(batch.lengths[rows]))
        for name, part in _view_of_rows(judgement, scene, rows, length, float(step)).items():
            whole[name][rows, :length] = part
    return View(**whole)


def _view_of_rows(
    judgement: Judgement, scene: Scene, rows: Int[np.ndarray, " k"], length: int, dt: float
) -> dict[str, Float[np.ndarray, "k n"]]:
    """The fields of a `View` for the recordings `rows`, all sampled at `dt` s, up to `length` samples."""
    batch = rows_of(scene.batch, rows)
    cut = tuple(leaf[:, :length] for leaf in (batch.u, batch.x, batch.valid))
    batch = eqx.tree_at(lambda b: (b.u, b.x, b.valid), batch, cut)
    gains = observer_gains(jnp.minimum(scene.bandwidth, 0.1 / batch.dt), batch.dt)
    horizon = ahead_samples(dt)
    parts = _view(
        judgement.drive,
        batch,
        gains,
        jnp.asarray(judgement.deflection[rows]),
        batch.x[:, 0],
        jnp.asarray(force_bandwidth(dt)),
        horizon,
        max(horizon // 40, 1),
    )
    free, ahead, force, v, bend, innovation = (np.asarray(part) for part in parts)
    unit = np.asarray(batch.noise * innovation_gain(gains))[:, None]
    e = innovation / unit * np.asarray(batch.valid)
    return {"free": free, "ahead": ahead, "force": force, "v": v, "bend": bend, "e": e}


def held_out_error(predicted: View, scene: Scene) -> float:
    """Root mean square error of what a model `predicted` for the held-out recordings of the `scene`, each in units of
    its noise: of the position 0.1 s ahead, or of the force in a free run along an imposed motion; infinite where a run
    overflows."""
    batch = scene.batch
    measured, model = np.asarray(batch.answer), predicted.free if batch.imposed else predicted.ahead
    scored = (np.asarray(batch.valid) > 0) & scene.held_out[:, None]
    errors = ((model - measured) / np.asarray(batch.noise)[:, None])[scored]
    value = float(np.sqrt(np.mean(errors**2)))
    return value if np.isfinite(value) else float("inf")


def ahead_samples(dt: float) -> int:
    """Samples of `dt` s in the horizon of 0.1 s of a prediction, at least one."""
    return max(round(_AHEAD / dt), 1)


def force_bandwidth(dt: float) -> float:
    """Bandwidth of the residual force at samples of `dt` s, Hz."""
    return min(_FORCE_BANDWIDTH, 0.05 / dt)


def _rmse(model: Float[np.ndarray, " n"], measured: Float[np.ndarray, " n"]) -> float:
    value = float(np.sqrt(np.mean((model - measured) ** 2)))
    return value if np.isfinite(value) else float("inf")


def recording_fits(
    recordings: tuple[Recording, ...], scene: Scene, base: View, extended: View, base_drive: Drive
) -> tuple[RecordingFit, ...]:
    """One `RecordingFit` per recording.

    **Arguments:**

    - `recordings`: in the order of the scene.
    - `scene`: the same recordings, in arrays.
    - `base`, `extended`: what the two models predict.
    - `base_drive`: for the standard deviation of the residual force.
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
        else:
            measured, horizon = recording.x, ahead_samples(dt)
            std = residual_force_std(noise, float(base_drive.J), dt, force_bandwidth(dt))
        # Nothing is predicted before the first horizon has passed.
        scored = slice(horizon, n)
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
                prediction_rmse_base=_rmse(base.ahead[row, scored], measured[scored]),
                prediction_rmse_extended=_rmse(extended.ahead[row, scored], measured[scored]),
                drive=recording.drive,
                force=recording.force if recording.drive == "motion" else None,
            )
        )
    return tuple(fits)
