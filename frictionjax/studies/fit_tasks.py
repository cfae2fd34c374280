"""Tasks that estimate from simulated recordings: the maximum-likelihood fit, and the diagnosis."""

import dataclasses
import functools
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Key

from frictionjax.core import FrictionjaxWarning, InputError, require_x64
from frictionjax.diagnosis import diagnose
from frictionjax.estimation import fit_many
from frictionjax.physics import Drive
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.studies.experiment import (
    Experiment,
    Machines,
    case_of,
    check_axes,
    machines_described,
    places_of,
)
from frictionjax.studies.task import AbstractTask, Block, CompiledTask, Outcome, Values, joined, kept


@dataclasses.dataclass(frozen=True, eq=False)
class FitTask(AbstractTask):
    """Simulate recordings of a machine and fit a model to them, by `fit_many`.

    Results: of each free parameter, `NAME_estimate`, `NAME_estimate_stderr` and `NAME_estimate_true`, the latter NaN
    where the machine has no such parameter; `converged`.

    **Attributes:**

    - `machine`: as in `SimulationTask`.
    - `experiments`: one recording each; the axes `level`, `noise`, `encoder_step` and `signal` change all of them.
    - `model`: start of the fit, and its structure; None: the machine, with the parameters of the task and not those of
        the case.
    - `free`: names of the free parameters; None: as in `fit`.
    - `lanes`: cases that are fitted together: those whose fit is unlike the others' are fitted again from theirs.
    - `units`: name of a result -> its unit.
    """

    machine: Machines
    experiments: Sequence[Experiment]
    model: Drive | None = None
    free: Sequence[str] | None = None
    lanes: int = 16
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """None: all results are numbers."""
        return {}

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `axes` name nothing of the machine or the experiments."""
        require_x64()
        _check(self.machine, self.experiments, axes)

    def described(self) -> dict[str, Any]:
        """Machine, experiments, model and lanes."""
        model = None if self.model is None else machines_described(self.model)
        free = None if self.free is None else list(self.free)
        return _described(self) | {"model": model, "free": free, "lanes": self.lanes}

    def compute(self, seed: int, block: Block) -> Outcome:
        """Fit the cases of a `block` together; `seed` as in `AbstractTask`."""
        count = len(block.places)
        cases = _cases(block)
        sets = _sets(self, self.machine, self.experiments, seed, block, self.lanes)
        start = self.model
        if start is None:
            start = self.machine if isinstance(self.machine, Drive) else self.machine[cases[0]["machine"]]
        # The last block is filled up as the others are, so that the sets beside a case do not depend on their number.
        sets += [sets[-1]] * (self.lanes - count)
        try:
            found = fit_many(start, sets, free=self.free, progress=False)
        except InputError as error:
            return Outcome({}, [str(error)] * count)
        values: Values = {"converged": found.converged[:count]}
        for k, name in enumerate(found.names):
            values[f"{name}_estimate"] = found.values[:count, k]
            values[f"{name}_estimate_stderr"] = found.stderr[:count, k]
            values[f"{name}_estimate_true"] = np.array([_true(self.machine, case, name) for case in cases])
        finite = np.all(np.isfinite(found.values[:count]), axis=1)
        reasons = [
            "" if fine and done else "did not converge" if fine else "the estimates are not finite"
            for fine, done in zip(finite, found.converged[:count], strict=True)
        ]
        return Outcome(values, reasons)


@dataclasses.dataclass(frozen=True, eq=False)
class DiagnosisTask(AbstractTask):
    """Simulate recordings of a machine and diagnose them.

    Results: `verdict`; `named`, the named effects, with commas between them; `confidence` of the first of them; and
    `p_value`, under the model without it.

    **Attributes:**

    - `machine`: as in `SimulationTask`.
    - `experiments`: one recording each; at least one has the role `"holdout"`.
    - `units`: name of a result -> its unit.
    """

    machine: Machines
    experiments: Sequence[Experiment]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def lanes(self) -> int:
        """One case at a time."""
        return 1

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """None: no result is an array."""
        return {}

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `axes` name nothing of the machine or the experiments, or none is held out."""
        require_x64()
        _check(self.machine, self.experiments, axes)
        if {one.role for one in self.experiments} != {"fit", "holdout"}:
            raise InputError(
                "a diagnosis needs recordings to fit and recordings that are held out",
                place="`experiments`",
                cure='Give one or more of each: Experiment(..., role="holdout")',
            )

    def described(self) -> dict[str, Any]:
        """Machine and experiments."""
        return _described(self)

    def compute(self, seed: int, block: Block) -> Outcome:
        """Diagnose the case of a `block`; `seed` as in `AbstractTask`."""
        case = _cases(block)[0]
        (recordings,) = _sets(self, self.machine, self.experiments, seed, block, 1)
        drive, first = case_of(self.machine, self.experiments[0], case)
        plant = Plant(
            motor_constant=float(drive.motor_constant), encoder_step=float(first.encoder_step) or None
        )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FrictionjaxWarning)
                found = diagnose(Case("case", plant, recordings), progress=False)
        except InputError as error:  # a case that cannot be diagnosed is a result
            return Outcome({}, [str(error)])
        top = found.missing[0] if found.missing else None
        result = {
            "verdict": found.verdict,
            "named": ", ".join(one.effect for one in found.missing),
            "confidence": np.nan if top is None else top.confidence,
            "p_value": np.nan if top is None else top.p_value,
        }
        return Outcome(joined([kept(result)]), [""])


def _described(task: FitTask | DiagnosisTask) -> dict[str, Any]:
    return {
        "kind": type(task).__name__,
        "machine": machines_described(task.machine),
        "experiments": [one.described() for one in task.experiments],
    }


def _check(machine: Machines, experiments: Sequence[Experiment], axes: tuple[str, ...]) -> None:
    if not experiments:
        raise InputError("there is no experiment", place="`experiments`", cure="Give one or more")
    check_axes(machine, experiments[0], axes)


def _cases(block: Block) -> list[dict[str, Any]]:
    """The values of each case of a `block`, by the name of the axis."""
    columns = block.columns
    return [
        {n: c[k] if c.dtype == object else c[k].item() for n, c in columns.items()}
        for k in range(len(block.places))
    ]


def _true(machine: Machines, case: Mapping[str, Any], name: str) -> float:
    """The true value of the parameter `name` in a `case`; NaN where the machine has none."""
    if name in case:
        return float(case[name])
    drive = machine if isinstance(machine, Drive) else machine[case["machine"]]
    described = machines_described(drive)["parameters"]
    return described[name] if name in places_of(drive) else float("nan")


def _sets(
    task: AbstractTask,
    machine: Machines,
    experiments: Sequence[Experiment],
    seed: int,
    block: Block,
    lanes: int,
) -> list[list[Recording]]:
    """The recordings of each case of a `block`, simulated side by side."""
    simulated = CompiledTask(_recorder(task), lanes=lanes, may_be_infinite=("u", "x")).compute(seed, block)
    count = len(block.places)
    return [
        [
            Recording(
                f"experiment_{number + 1}",
                one.sample_rate,
                simulated.values[f"u{number}"][k],
                simulated.values[f"x{number}"][k],
                role=one.role,
            )
            for number, one in enumerate(experiments)
        ]
        for k in range(count)
    ]


@functools.lru_cache(maxsize=8)
def _recorder(task: FitTask | DiagnosisTask) -> Any:
    """The function that simulates all recordings of one case of a `task`: always the same object, so that it is
    compiled once."""

    def one(key: Key[Array, ""], **case: Any) -> dict[str, Any]:
        keys = jax.random.split(key, len(task.experiments))
        found = {}
        for number, experiment in enumerate(task.experiments):
            drive, own = case_of(task.machine, experiment, case)
            found[f"u{number}"], found[f"x{number}"] = own.record(keys[number], drive)
        return found

    return one
