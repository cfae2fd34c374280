"""How well an experiment discriminates between two models, over a design: power curves of the next recording."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from frictionjax.core import InputError, require_x64
from frictionjax.information import rank_for_discrimination
from frictionjax.physics.effects import AbstractEffect
from frictionjax.studies.experiment import (
    Experiment,
    Experiments,
    Machines,
    case_of,
    check_axes,
    experiments_described,
    machines_described,
)
from frictionjax.studies.task import AbstractTask, Block, Outcome, joined, kept, one_line

SIZE = "size"
"""Axis: so many times the strengths of both effects."""


@dataclasses.dataclass(frozen=True, eq=False)
class DiscriminationTask(AbstractTask):
    """Whether an experiment could distinguish two effects, the rival refitted (`rank_for_discrimination`).

    Results: `d_prime` (distance of the two models in standard deviations of the noise), `power` (probability that a
    test at the level of 5 % rejects the wrong one), `converged` (whether the refit has). Of an experiment that lasts k
    times as long `d_prime` is sqrt(k) times as large.

    **Attributes:**

    - `machine`: a `Drive` without either effect, or several by name; axes as in `SimulationTask`.
    - `first`, `second`: the effects, with strengths of a typical size; None: the machine as it is. The axis `size`
        multiplies their strengths.
    - `experiment`: an `Experiment`, or several by name; noise and encoder step must not both be zero. The step counts
        as white noise of its size over the root of 12.
    - `free`: names of the parameters that are refitted beside the strengths; None: all of the base model.
    - `refit_steps`: at most; 0: the linear projection alone.
    - `units`: name of a result -> its unit.
    """

    machine: Machines
    first: AbstractEffect | None
    second: AbstractEffect | None
    experiment: Experiments = dataclasses.field(default_factory=Experiment)
    free: Sequence[str] | None = None
    refit_steps: int = 10
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def lanes(self) -> int:
        """One case at a time."""
        return 1

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """None: all results are numbers."""
        return {}

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `axes` name nothing of the machine or the experiment, or nothing has noise."""
        require_x64()
        check_axes(self.machine, self.experiment, tuple(axis for axis in axes if axis != SIZE))
        several = [self.experiment] if isinstance(self.experiment, Experiment) else self.experiment.values()
        noisy = {"noise", "encoder_step"} & set(axes) or all(_noise(one) > 0.0 for one in several)
        if not noisy:
            raise InputError(
                "an experiment has no noise: without it, anything can be distinguished",
                place="`experiment`",
                cure="Give the standard deviation of the position's noise: Experiment(..., noise=1e-8)",
            )

    def described(self) -> dict[str, Any]:
        """Machine, experiment, the two effects with their strengths, what is free, and the steps."""
        return {
            "kind": "DiscriminationTask",
            "machine": machines_described(self.machine),
            "experiment": experiments_described(self.experiment),
            "effects": [_described(one) for one in (self.first, self.second)],
            "free": None if self.free is None else list(self.free),
            "refit_steps": self.refit_steps,
        }

    def compute(self, seed: int, block: Block) -> Outcome:
        """Rank the experiment of the case of a `block`; `seed` as in `AbstractTask`."""
        case = {n: c[0] if c.dtype == object else c[0].item() for n, c in block.columns.items()}
        size = float(case.pop(SIZE, 1.0))
        drive, experiment = case_of(self.machine, self.experiment, case)
        key = jax.random.fold_in(jax.random.key(np.uint32(seed)), int(block.streams[0]))
        try:
            found = rank_for_discrimination(
                drive,
                _grown(self.first, size),
                _grown(self.second, size),
                {"experiment": np.asarray(experiment.input(key, drive))},
                experiment.sample_rate,
                _noise(experiment),
                free=self.free,
                refit_steps=self.refit_steps,
                substeps=experiment.substeps,
                progress=False,
            ).best
        except InputError as error:  # a case in which the machine runs away is a result
            return Outcome({}, [one_line(error)])
        result = {"d_prime": found.d_prime, "power": found.probability, "converged": found.converged}
        return Outcome(joined([kept(result)]), [""])


def _noise(experiment: Experiment) -> float:
    """Standard deviation of the measured position in an `experiment`, quantisation included."""
    return float(np.hypot(float(experiment.noise), float(experiment.encoder_step) / np.sqrt(12.0)))


def _grown(effect: AbstractEffect | None, size: float) -> AbstractEffect | None:
    """The `effect` with so many times its strengths, `size`."""
    if effect is None:
        return None
    names = [parameter.name for parameter in effect.strengths]
    return eqx.tree_at(
        lambda one: [getattr(one, name) for name in names],
        effect,
        [size * getattr(effect, name) for name in names],
    )


def _described(effect: AbstractEffect | None) -> Any:
    if effect is None:
        return None
    parameters = (*effect.strengths, *effect.nuisances)
    values = {parameter.name: float(getattr(effect, parameter.name)) for parameter in parameters}
    return {"form": type(effect).__name__, "parameters": values}
