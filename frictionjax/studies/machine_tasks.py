"""Tasks with a simulated machine: its motion, and the stiffness and damping that a frequency response shows."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from frictionjax.core import InputError, require_x64
from frictionjax.frequency import estimate_frf
from frictionjax.physics import linearize
from frictionjax.studies.experiment import (
    Experiment,
    Experiments,
    Machines,
    case_of,
    check_axes,
    experiments_described,
    machines_described,
)
from frictionjax.studies.response_fit import Band, fit_response
from frictionjax.studies.task import AbstractTask, Block, CompiledTask, Outcome


@dataclasses.dataclass(frozen=True, eq=False)
class SimulationTask(AbstractTask):
    """Simulate a machine: results are the input `u` and the measured position `x`, over `sample`.

    **Attributes:**

    - `machine`: a `Drive`, or several by name, from which an axis `machine` chooses. Axes of numbers are named after
        its parameters: `J`, `sigma0`, and so on, and those of its effects.
    - `experiment`: an `Experiment`, or several by name; `level`, `noise`, `encoder_step` and `signal` may be axes.
    - `lanes`: cases side by side.
    - `units`: name of a result -> its unit.
    """

    machine: Machines
    experiment: Experiments = dataclasses.field(default_factory=Experiment)
    lanes: int = 64
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """`sample`."""
        return {"u": ("sample",), "x": ("sample",)}

    @property
    def on_devices(self) -> bool:
        """True."""
        return True

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `axes` name nothing of the machine or the experiment."""
        require_x64()
        check_axes(self.machine, self.experiment, axes)

    def described(self) -> dict[str, Any]:
        """Machine, experiment, and lanes."""
        return _described(self)

    def one(self, key: Key[Array, ""], **case: Any) -> dict[str, Any]:
        """Input and position in one `case`, drawn from the `key`."""
        drive, experiment = case_of(self.machine, self.experiment, case)
        u, x = experiment.record(key, drive)
        return {"u": u, "x": x}

    def compute(self, seed: int, block: Block) -> Outcome:
        """Simulate the cases of a `block` side by side; `seed` as in `AbstractTask`."""
        return CompiledTask(self.one, lanes=self.lanes).compute(seed, block)


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseTask(AbstractTask):
    """The paper's way: simulate a machine in stick, estimate its frequency response (Hann, half overlapped), and fit
    inertia, stiffness and damping to it by the iteration of Sanathanan and Koerner.

    Results: `stiffness`, `damping` and `inertia`, each with `_stderr` and with the value of the linearised machine at
    rest, `_true`; the mean `coherence` in the band; `converged`.

    **Attributes:**

    - `machine`, `experiment`, `lanes`, `units`: as in `SimulationTask`.
    - `band`: where the system is fitted, Hz.
    - `segment`: samples of a segment.
    """

    machine: Machines
    experiment: Experiments = dataclasses.field(default_factory=Experiment)
    band: tuple[float, float] = (3.0, 150.0)
    segment: int = 1024
    lanes: int = 64
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """None: all results are numbers."""
        return {}

    @property
    def on_devices(self) -> bool:
        """True."""
        return True

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `axes` name nothing of machine or experiment, or the band is too narrow."""
        require_x64()
        check_axes(self.machine, self.experiment, axes)
        several = [self.experiment] if isinstance(self.experiment, Experiment) else self.experiment.values()
        for one in several:
            step = one.sample_rate / self.segment
            bins = int(np.floor(self.band[1] / step) - np.ceil(self.band[0] / step)) + 1
            if one.samples < 2 * self.segment or bins < 4:
                raise InputError(
                    f"{one.samples} samples in segments of {self.segment} give {max(bins, 0)} frequencies from "
                    f"{self.band[0]} to {self.band[1]} Hz",
                    place="`task`",
                    cure="Take two segments or more, and four frequencies or more",
                )

    def described(self) -> dict[str, Any]:
        """Machine, experiment, band, segment and lanes."""
        return _described(self) | {"band": list(self.band), "segment": self.segment}

    def one(self, key: Key[Array, ""], **case: Any) -> dict[str, Any]:
        """The fit in one `case`, drawn from the `key`."""
        drive, experiment = case_of(self.machine, self.experiment, case)
        u, x = experiment.record(key, drive)
        force = drive.motor_constant * u
        frf = estimate_frf(force, x, experiment.sample_rate, segment=self.segment)
        segments = 1 + (experiment.samples - self.segment) // (self.segment // 2)
        band = Band(*self.band, self.segment, segments, experiment.sample_rate)
        fitted = fit_response(frf, band)[0]
        frequency = np.arange(self.segment // 2 + 1) * (experiment.sample_rate / self.segment)
        inside = np.flatnonzero((frequency >= self.band[0]) & (frequency <= self.band[1]))
        true = linearize(drive)
        found = {"converged": fitted.converged, "coherence": jnp.mean(frf.coherence[inside])}
        for k, (name, value) in enumerate(
            (("inertia", drive.J), ("stiffness", true.stiffness), ("damping", true.damping))
        ):
            found[name] = fitted.values[k]
            found[f"{name}_stderr"] = fitted.stderr[k]
            found[f"{name}_true"] = value
        return found

    def compute(self, seed: int, block: Block) -> Outcome:
        """Fit the cases of a `block` side by side; `seed` as in `AbstractTask`."""
        return CompiledTask(self.one, lanes=self.lanes).compute(seed, block)


def _described(task: "SimulationTask | ResponseTask") -> dict[str, Any]:
    return {
        "kind": type(task).__name__,
        "machine": machines_described(task.machine),
        "experiment": experiments_described(task.experiment),
        "lanes": task.lanes,
    }
