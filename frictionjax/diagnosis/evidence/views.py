"""What a model predicts for every recording: free run, prediction 0.1 s ahead, residual force."""

import dataclasses
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.programs import compiled
from frictionjax.diagnosis.evidence.imposed_views import view_of_forces
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.estimation.data.batch import Batch, rows_of
from frictionjax.estimation.data.pieces import Piece, lanes_of, padded, pieces_of, put_together
from frictionjax.physics import Drive, Push
from frictionjax.physics.effects import Before
from frictionjax.simulation import (
    ObserverGains,
    innovation_gain,
    observe,
    observer_gains,
    residual_force,
)
from frictionjax.simulation.fixed import run_free
from frictionjax.simulation.observer import corrected_states
from frictionjax.simulation.prediction import free_run
from frictionjax.simulation.ros2 import DriveState

_AHEAD = 0.1  # s
_FORCE_BANDWIDTH = 25.0  # Hz
_RUNS_IN_HORIZON = 40  # free runs that begin within the horizon of a prediction
_LANES, _ROOM = 256, 64  # free runs side by side, and samples that are kept of each


class View(eqx.Module):
    """One model's predictions of all recordings, arrays of shape `(r, n)`: `free` run and `ahead` by 0.1 s, of the
    position, or of the force where the motion is imposed; residual `force`; the observer's `v`, `bend` (|z| over
    Fs/sigma0) and standardised innovations `e` (where the motion is imposed: velocity, bend and standardised errors of
    the run); and the position by `one_sample` and by `one_second` ahead (None where the motion is imposed, or not
    asked for)."""

    free: Float[np.ndarray, "r n"]
    ahead: Float[np.ndarray, "r n"]
    force: Float[np.ndarray, "r n"]
    v: Float[np.ndarray, "r n"]
    bend: Float[np.ndarray, "r n"]
    e: Float[np.ndarray, "r n"]
    one_sample: Float[np.ndarray, "r n"] | None = None
    one_second: Float[np.ndarray, "r n"] | None = None


class GivenPredictions(eqx.Module):
    """What the user's own simulation, as it was given, predicts.

    **Attributes:** `source` (as in `SimulationAsGiven`), `there` (which recordings have one, bool, shape `(r,)`), the
    `free` run, and the prediction 0.1 s `ahead` (None where no measured sample corrects it), shape `(r, n)`.
    """

    source: Literal["column", "model"] = eqx.field(static=True)
    there: Bool[np.ndarray, " r"]
    free: Float[np.ndarray, "r n"]
    ahead: Float[np.ndarray, "r n"] | None


class _Along(eqx.Module):
    """One model along a piece of recordings, arrays of shape `(w, n)`: `free` run, residual `force`; of the observer
    `v`, `bend`, `innovation`, predicted position `x` and corrected `states`; and the motor force, `push`."""

    free: Float[Numbers, "*w n"]
    force: Float[Numbers, "*w n"]
    v: Float[Numbers, "*w n"]
    bend: Float[Numbers, "*w n"]
    innovation: Float[Numbers, "*w n"]
    x: Float[Numbers, "*w n"]
    states: DriveState
    push: Push


@compiled()
def _along(
    drive: Drive,
    batch: Batch,
    gains: ObserverGains,
    deflection: Float[Numbers, " w"],
    first: Float[Numbers, " w"],
    bandwidth: Float[Numbers, ""],
) -> _Along:
    def one(
        u: Float[Numbers, " n"],
        x: Float[Numbers, " n"],
        dt: Float[Numbers, ""],
        gains: ObserverGains,
        start: tuple[Float[Numbers, ""], Float[Numbers, ""], Float[Numbers, ""], Before],
        x_first: Float[Numbers, ""],
        length: Int[Numbers, ""],
    ) -> _Along:
        force, before = drive.applied_force(u, dt), start[3]
        steps, samples = batch.steps, batch.samples
        zero = jnp.zeros_like(x_first)
        # The free run uses the first sample only.
        free = run_free(drive, u, dt, (x_first, zero, zero, before), jnp.maximum(steps, 2), samples)
        observed = observe(drive, force, x, dt, gains, start, substeps=steps, samples=samples)
        missing = residual_force(
            drive, force, x, dt, bandwidth, start, substeps=steps, measured=length, samples=samples
        )
        bend = jnp.abs(observed.z[:, 0]) * drive.friction.sigma0 / drive.friction.Fs
        states = corrected_states(drive, observed, gains)
        push = force if isinstance(force, Push) else Push(force, jnp.zeros_like(force))
        return _Along(free.measured, missing, observed.v, bend, observed.innovation, observed.x, states, push)

    deflection = deflection * drive.friction.Fs / drive.friction.sigma0
    return batch.each(one, gains, deflection, first, jnp.asarray(batch.lengths))


@compiled()
def _free_runs(
    drive: Drive,
    push: Push,
    states: DriveState,
    begin: Int[Numbers, " runs"],
    dt: Float[Numbers, ""],
    horizon: Int[Numbers, ""],
    stride: Int[Numbers, ""],
    steps: Int[Numbers, ""],
) -> Float[Numbers, "runs room"]:
    def one(state: DriveState, begin: Int[Numbers, ""]) -> Float[Numbers, " room"]:
        return free_run(drive, push, state, begin, dt, horizon, stride, room=_ROOM, substeps=steps)

    return jax.vmap(one)(states, begin)


def view(judgement: Judgement, scene: Scene, *, far: bool = False) -> View:
    """Predict all recordings of the `scene` by the model of the `judgement`; `far`: 1 s ahead, too."""
    batch = scene.batch
    dt = np.asarray(batch.dt)
    if batch.imposed:
        slowest = float(np.max(dt))
        own = (ahead_samples(slowest), force_bandwidth(slowest))
        forces = view_of_forces(judgement, batch, *own)  # type: ignore[arg-type]
        return View(forces.free, forces.ahead, forces.missing, forces.v, forces.bend, forces.e)
    shape = np.asarray(batch.x).shape
    names = [field.name for field in dataclasses.fields(View) if far or field.name != "one_second"]
    whole = {name: np.zeros(shape) for name in names}
    # At another sample rate the 0.1 s ahead are another number of samples.
    horizons = np.array([ahead_samples(float(step)) for step in dt])
    for horizon in np.unique(horizons):
        rows = np.flatnonzero(horizons == horizon)
        length = shape[1] if rows.size == dt.size else int(np.max(batch.lengths[rows]))
        for name, part in _view_of_rows(judgement, scene, rows, length, int(horizon), far).items():
            whole[name][rows, :length] = part
    return View(**whole)


def _view_of_rows(
    judgement: Judgement, scene: Scene, rows: Int[np.ndarray, " k"], length: int, horizon: int, far: bool
) -> dict[str, Float[np.ndarray, "k n"]]:
    """The fields of a `View` for the recordings `rows`, in all of which the 0.1 s ahead are `horizon` samples, up to
    `length` samples; `far` as in `view`."""
    batch = rows_of(scene.batch, rows)
    slowest = float(np.max(np.asarray(batch.dt)))
    varying = scene.varying and scene.varying.of(rows, length)
    gains = observer_gains(scene.bandwidth[rows], batch.dt) if varying is None else varying.gains
    names = ("free", "ahead", "force", "v", "bend", "innovation", *(("one_second",) if far else ()))
    fields: dict[str, list] = {name: [] for name in names}
    pieces = pieces_of(batch.lengths)
    for piece in pieces:
        part = batch.piece(piece)
        first, bandwidth = np.asarray(batch.x)[piece.lanes, 0], np.asarray(force_bandwidth(slowest))
        bent = judgement.deflection[rows][piece.lanes]
        own = (
            lanes_of(gains, piece)
            if varying is None
            else ObserverGains(padded(gains.position, piece), padded(gains.velocity, piece))
        )
        found = _along(judgement.drive, part, own, bent, first, bandwidth)
        fields["ahead"].append(_ahead(judgement.drive, found, piece, part, horizon))
        if far:
            fields["one_second"].append(_ahead(judgement.drive, found, piece, part, round(1.0 / slowest)))
        for name in ("free", "force", "v", "bend", "innovation"):
            fields[name].append(getattr(found, name))
    whole = {
        name: put_together(list(zip(pieces, parts, strict=True)), rows.size, length)
        for name, parts in fields.items()
    }
    relative = (
        np.asarray(innovation_gain(gains, batch.integrated))[:, None] if varying is None else varying.unit
    )
    unit = np.asarray(batch.noise)[:, None] * relative
    whole["one_sample"] = np.asarray(batch.x)[:, :length] - whole["innovation"]
    whole["e"] = whole.pop("innovation") / unit * np.asarray(batch.valid)[:, :length]
    return whole


def _ahead(drive: Drive, found: _Along, piece: Piece, batch: Batch, horizon: int) -> Float[np.ndarray, "w n"]:
    """Position `horizon` samples ahead, as `predict_ahead` has it, along a `piece` of recordings, the `batch`,
    from what was `found` along it."""
    stride = int(np.clip(horizon // _RUNS_IN_HORIZON, 1, _ROOM))
    whole = np.array(found.x)
    states = jax.tree.map(np.asarray, found.states)
    for row in range(piece.rows.size):
        dt = np.asarray(batch.dt)[row]
        push = jax.tree.map(lambda leaf, row=row: np.asarray(leaf)[row], found.push)
        begins = np.arange(0, max(piece.samples - horizon, 0), stride)
        for some in (begins[first : first + _LANES] for first in range(0, begins.size, _LANES)):
            lanes = np.concatenate([some, np.repeat(some[-1:], _LANES - some.size)])
            own = jax.tree.map(lambda leaf, row=row, lanes=lanes: leaf[row][lanes], states)
            numbers = tuple(np.asarray(value) for value in (dt, horizon, stride, batch.steps))
            runs = np.asarray(_free_runs(drive, push, own, lanes, *numbers))
            ahead = runs[: some.size, :stride].ravel()
            first = some[0] + horizon
            last = min(first + ahead.size, piece.samples)
            whole[row, first:last] = ahead[: last - first]
    return whole


def errors_ahead(predicted: View, scene: Scene) -> Float[np.ndarray, "r n"]:
    """Errors of what a model `predicted` for the held-out recordings of the `scene`, each in units of its noise: of the
    position 0.1 s ahead, or of the force in a free run along an imposed motion; infinite where a run overflows, NaN
    where nothing is held out."""
    batch = scene.batch
    measured, model = np.asarray(batch.answer), predicted.free if batch.imposed else predicted.ahead
    errors = (model - measured) / np.asarray(batch.noise)[:, None]
    scored = (np.asarray(batch.valid) > 0) & scene.held_out[:, None]
    return np.where(scored, np.where(np.isfinite(errors), errors, np.inf), np.nan)


def held_out_error(predicted: View, scene: Scene) -> float:
    """Root mean square of the `errors_ahead`; infinite where a run overflows."""
    return root_mean_square(errors_ahead(predicted, scene))


def root_mean_square(errors: Float[np.ndarray, "..."]) -> float:
    """Root mean square of the `errors` that are not NaN, infinite where one overflows."""
    with np.errstate(over="ignore"):
        value = float(np.sqrt(np.nanmean(errors**2)))
    return value if np.isfinite(value) else float("inf")


def ahead_samples(dt: float) -> int:
    """Samples of `dt` s in the horizon of 0.1 s of a prediction, at least one."""
    return max(round(_AHEAD / dt), 1)


def force_bandwidth(dt: float) -> float:
    """Bandwidth of the residual force at samples of `dt` s, Hz."""
    return min(_FORCE_BANDWIDTH, 0.05 / dt)
