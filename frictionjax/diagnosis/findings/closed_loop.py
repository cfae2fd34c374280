"""How far the models are off when the user's own controller drives them, as it drives the machine.

A free run in an open loop adds up every small error of a model; under a controller it does not, and this is what the
model of a servo is made for. The controller answers to the simulated position: it adds to the recorded input what its
gains make of the measured less the simulated position, so that neither its reference nor its feedforward need be known.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import jax
import numpy as np
from jaxtyping import Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.programs import compiled
from frictionjax.diagnosis.evidence.horizons import rms_error
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.recording_fit import ClosedLoop
from frictionjax.estimation.data.batch import rows_of
from frictionjax.estimation.data.pieces import lengths_up_to
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.recordings import Controller, Recording
from frictionjax.simulation.closed_loop import control_samples, finer_samples, run_closed


@compiled()
def _run(
    drive: Drive,
    controller: Controller,
    reference: Float[Numbers, " n"],
    feedforward: Float[Numbers, " n"],
    dt: Float[Numbers, ""],
    every: Int[Numbers, ""],
    start: tuple[Float[Numbers, ""], Float[Numbers, ""], Float[Numbers, ""], Before],
    substeps: Int[Numbers, ""],
    samples: Int[Numbers, ""],
) -> tuple[Float[Numbers, " n"], Float[Numbers, " n"]]:
    run = run_closed(drive, controller, reference, feedforward, dt, every, start, substeps, samples)
    return run.measured, run.u  # type: ignore[return-value]


def closed_loops(
    controller: Controller | None,
    recordings: Sequence[Recording],
    scene: Scene,
    drives: Mapping[str, Drive],
    executor: Executor,
) -> tuple[ClosedLoop | None, ...]:
    """The errors of each model in closed loop, for each recording; None for one that was made in an open loop, and
    where there is no `controller`.

    **Arguments:**

    - `controller`: that of the case.
    - `recordings`: in the order of the scene.
    - `scene`: the same recordings, in arrays.
    - `drives`: the models, by the name of their fields in `ClosedLoop`.
    - `executor`: runs the models and recordings in parallel.
    """
    if controller is None:
        return (None,) * len(recordings)

    def errors(row: int, drive: Drive) -> tuple[float, float]:
        recording = recordings[row]
        x, u = _closed_run(controller, recording, rows_of(scene.batch.before, np.array([row])), drive, scene)
        return rms_error(x, recording.x), rms_error(u, recording.u)

    asked = {
        (row, name): executor.submit(errors, row, drive)
        for row, recording in enumerate(recordings)
        for name, drive in drives.items()
        if recording.loop == "closed"
    }
    found: list[ClosedLoop | None] = [None] * len(recordings)
    for row, recording in enumerate(recordings):
        if recording.loop == "closed":
            own = {name: asked[row, name].result() for name in drives}
            position = {name: one[0] for name, one in own.items()}
            given = {f"input_{name}": one[1] for name, one in own.items()}
            found[row] = ClosedLoop(**position, **given, law=_share_of_the_law(controller, recording))
    return tuple(found)


def _closed_run(
    controller: Controller, recording: Recording, before: Before, drive: Drive, scene: Scene
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Measured position and input of `drive` under the `controller`, from rest at the first sample of the `recording`,
    with what was `before` it, leaves of shape `(1, ...)`."""
    parts, every = control_samples(controller, recording.sample_rate)
    reference = finer_samples(recording.x, parts)
    feedforward = finer_samples(recording.u, parts, held=drive.hold == "zero")
    room = lengths_up_to(reference.size)[-1] - reference.size
    numbers = (
        np.asarray(1.0 / (recording.sample_rate * parts)),
        np.asarray(every),
        (recording.x[0], np.zeros(()), np.zeros(()), jax.tree.map(lambda leaf: leaf[0], before)),
        np.asarray(max(-(-scene.batch.substeps // parts), 2)),
        np.asarray(reference.size),
    )
    padded = (np.pad(reference, (0, room), mode="edge"), np.pad(feedforward, (0, room), mode="edge"))
    measured, u = _run(drive, controller, *padded, *numbers)
    return np.asarray(measured)[: reference.size : parts], np.asarray(u)[: reference.size : parts]


def _share_of_the_law(controller: Controller, recording: Recording) -> float | None:
    """The part of the variance of the recorded input that the gains of the `controller` make of the recorded reference
    less the measured position; None without a reference."""
    if recording.reference is None:
        return None
    every = control_samples(controller, recording.sample_rate)[1]
    period = every / recording.sample_rate
    off = (recording.reference - recording.x)[::every]
    rate = np.diff(off, prepend=off[:1]) / period
    asked = controller.kp * off + controller.ki * np.cumsum(off) * period + controller.kd * rate
    law = np.clip(
        np.repeat(np.asarray(asked), every)[: recording.u.size], -controller.limit, controller.limit
    )
    whole = float(np.var(recording.u))
    return 1.0 - float(np.var(recording.u - law)) / whole if whole > 0.0 else None
