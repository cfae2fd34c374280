"""`Experiment`: what is applied to a simulated machine and how its position is measured; cases of a study in it."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from frictionjax.core import InputError
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import effect_labels
from frictionjax.excitation import gaussian_noise, multisine, prbs, ramp
from frictionjax.physics import Drive
from frictionjax.simulation import simulate

Signal = Literal["prbs", "gaussian", "multisine", "ramp"]


@dataclasses.dataclass(frozen=True)
class Experiment:
    """An input for a simulated machine, and the noise of its sensor.

    **Attributes:**

    - `signal`: `"prbs"` or `"gaussian"` noise, a `"multisine"`, or a `"ramp"`; random ones are new in each case.
    - `samples`: number of samples.
    - `sample_rate`: samples per second.
    - `level`: rms of the input over the static friction; of a ramp, its end.
    - `bandwidth`: upper end of the noise or of the multisine, Hz.
    - `noise`: standard deviation of the position's white noise, position units.
    - `encoder_step`: quantum of the position sensor, position units; zero: none.
    - `substeps`: integration steps per sample.
    - `role`: `"fit"` or `"holdout"`, for a diagnosis.
    """

    signal: Signal = "prbs"
    samples: int = 4096
    sample_rate: float = 2000.0
    level: Any = 0.1
    bandwidth: float = 500.0
    noise: Any = 0.0
    encoder_step: Any = 0.0
    substeps: int = 2
    role: Literal["fit", "holdout"] = "fit"

    def input(self, key: Key[Array, ""], drive: Drive) -> Float[Array, " n"]:
        """The input of `drive`, shape `(n,)`, in its input units, drawn from the `key`."""
        size = real(self.level) * drive.friction.Fs / drive.motor_constant
        n, rate = self.samples, self.sample_rate
        if self.signal == "prbs":
            return prbs(key, n, rate, self.bandwidth, size)
        if self.signal == "gaussian":
            return gaussian_noise(key, n, rate, self.bandwidth, size)
        if self.signal == "multisine":
            return multisine(key, n, rate, (0.0, self.bandwidth), size)
        if self.signal == "ramp":
            return ramp(n, rate, size)
        raise InputError(
            f"there is no signal {self.signal!r}",
            place="`signal`",
            cure=f"Choose one of: {', '.join(get_args(Signal))}",
        )

    def record(self, key: Key[Array, ""], drive: Drive) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Input and measured position of `drive`, shape `(n,)` each, drawn from the `key`."""
        for_input, for_noise = jax.random.split(key)
        u = self.input(for_input, drive)
        x = simulate(drive, u, self.sample_rate, substeps=self.substeps).measured
        x = x + real(self.noise) * jax.random.normal(for_noise, x.shape)
        step = real(self.encoder_step)
        safe = jnp.where(step > 0.0, step, 1.0)
        return u, jnp.where(step > 0.0, safe * jnp.round(x / safe), x)

    def described(self) -> dict[str, Any]:
        """Its fields."""
        return dataclasses.asdict(self)


VARIED = ("level", "noise", "encoder_step")
"""Properties of an experiment that may be an axis of numbers; `signal` may be one of texts."""
VARIANTS = ("machine", "experiment")
"""Axes of texts that choose among several machines or experiments, which differ in more than numbers."""

Machines = Drive | Mapping[str, Drive]
Experiments = Experiment | Mapping[str, Experiment]


def places_of(drive: Drive) -> dict[str, str]:
    """Name of a parameter, as an axis has it -> its path in `drive`."""
    found = {"J": "J", "motor_constant": "motor_constant"}
    found |= {parameter.name: f"friction.{parameter.name}" for parameter in drive.friction.parameters}
    return found | {label: path for path, label in effect_labels(drive).items()}


def check_axes(machines: Machines, experiments: Experiments, axes: tuple[str, ...]) -> None:
    """Raise `InputError` for one of `axes` that is neither a parameter of all `machines` nor a property of
    `experiments`."""
    known: set[str] = {*VARIED, "signal"}
    several = [machines] if isinstance(machines, Drive) else list(machines.values())
    known |= set.intersection(*(set(places_of(one)) for one in several))
    known |= {
        name for name, own in zip(VARIANTS, (machines, experiments), strict=True) if isinstance(own, Mapping)
    }
    if unknown := [axis for axis in axes if axis not in known]:
        raise InputError(
            f"nothing of the machine or the experiment is called `{unknown[0]}`",
            place="`design`",
            cure=f"Name an axis by one of: {', '.join(sorted(known))}",
        )
    for name, own in zip(VARIANTS, (machines, experiments), strict=True):
        if isinstance(own, Mapping) and name not in axes:
            raise InputError(
                f"there are several of `{name}`",
                place="`task`",
                cure=f'Add an axis of their names: Axis("{name}", {list(own)})',
            )


def case_of(machines: Machines, experiments: Experiments, case: dict[str, Any]) -> tuple[Drive, Experiment]:
    """The machine and the experiment of a `case`."""
    case = dict(case)
    drive = machines if isinstance(machines, Drive) else chosen(machines, "machine", case)
    experiment = (
        experiments if isinstance(experiments, Experiment) else chosen(experiments, "experiment", case)
    )
    changed = {name: case.pop(name) for name in (*VARIED, "signal") if name in case}
    return changed_drive(drive, case), dataclasses.replace(experiment, **changed)


def chosen(variants: Mapping[str, Any], name: str, case: dict[str, Any]) -> Any:
    """What the axis `name` of a `case` chooses among `variants`; it is taken out of the case."""
    value = case.pop(name)
    if value not in variants:
        raise InputError(
            f"there is no {name} {value!r}",
            place=f"axis `{name}`",
            cure=f"Choose from: {', '.join(variants)}",
        )
    return variants[value]


def changed_drive(drive: Drive, values: Mapping[str, Any]) -> Drive:
    """`drive` with these `values` of its parameters, by name."""
    places = places_of(drive)
    for name, value in values.items():
        path = places[name].split(".")

        def part(tree: Any, path: list[str] = path) -> Any:
            for step in path:
                tree = tree[int(step)] if step.isdigit() else getattr(tree, step)
            return tree

        drive = eqx.tree_at(part, drive, real(value))
    return drive


def machines_described(machines: Machines) -> Any:
    """The parameters of each machine by name, and the names of its effects."""
    if isinstance(machines, Mapping):
        return {name: machines_described(one) for name, one in machines.items()}
    values = {}
    for name, path in places_of(machines).items():
        tree: Any = machines
        for step in path.split("."):
            tree = tree[int(step)] if step.isdigit() else getattr(tree, step)
        values[name] = float(tree)
    return {"parameters": values, "effects": [type(effect).__name__ for effect in machines.effects]}


def experiments_described(experiments: Experiments) -> Any:
    """The fields of each experiment."""
    if isinstance(experiments, Mapping):
        return {name: one.described() for name, one in experiments.items()}
    return experiments.described()
