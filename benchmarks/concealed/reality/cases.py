"""Cases: a machine, what is concealed in it, and its recordings; in memory and as a folder of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .effects import build
from .experiments import RATE, Experiment, plan
from .families import RECIPES
from .knobs import pack
from .machines import MACHINES
from .plants import Plant, draw_plant
from .recorder import SETTLE, SUBSTEPS, Hidden, record
from .streams import stream


@dataclass(frozen=True)
class SimulatedCase:
    """A simulated case: `plant` as a case file describes it, `recordings`, and the `truth` that is to be found.

    `given` is what the case file says of the machine's own model: effects that are known to act, with their parameters.
    A recording is a dict of name, role, loop, start_time, sample_rate, t, u and x (measured). `machine`, `knobs` (every
    parameter of the simulator) and `hidden` (what each recording would be without noise) are for the author of a
    benchmark; a diagnosis must not see them, nor `truth`.
    """

    name: str
    plant: dict
    recordings: list[dict]
    truth: dict
    machine: Plant
    knobs: np.ndarray
    hidden: list[Hidden]
    given: dict[str, dict[str, float]]


def experiments_of(
    seed: int, plant: Plant, families: str = "default", rate: float = RATE, stretch: float = 1.0
) -> list[Experiment]:
    """Experiments of a seed: the same whatever its case conceals."""
    own = stream(seed, "experiments", families)
    return plan(own, plant, families, rate, stretch, stream(seed, "controller"))


def _given(seed: int, plant: Plant) -> dict[str, dict[str, float]]:
    """A link's weight as its drawing has it: within some percent, as parts with the sine and the cosine of position."""
    rng = stream(seed, "given")
    parts = {"sine": np.cos(plant.gravity_at), "cosine": np.sin(plant.gravity_at)}
    return {
        "gravity_pendulum": {
            name: float(plant.gravity * part * rng.uniform(0.95, 1.05)) for name, part in parts.items()
        }
    }


def knobs_of(
    seed: int, missing: tuple[str, ...], strength: str, families: str, rate: float, kind: str | None = None
) -> tuple[Plant, np.ndarray, dict[str, dict], dict[str, dict[str, float]]]:
    """Machine, knobs, true sizes of what is missing, and what the case file gives; arguments as of `make_case`."""
    if kind is None and "gravity_pendulum" in missing:
        kind = "rotary"
    own = families in RECIPES
    plant = (MACHINES[families] if own else draw_plant)(stream(seed, "plant"), kind)
    changes, sizes = build(
        missing, strength, plant, lambda name: stream(seed, "effect", name), rate if own else None
    )
    given: dict = {}
    if plant.gravity and "gravity_pendulum" not in missing:
        given = _given(seed, plant)
        changes |= {"grav": plant.gravity, "grav_x0": plant.gravity_at}
    return plant, pack(plant, changes), sizes, given


def make_case(
    seed: int,
    missing: Sequence[str] = ("creep",),
    strength: str = "strong",
    *,
    families: str = "default",
    kind: str | None = None,
    rate: float = RATE,
    stretch: float = 1.0,
    coloured: bool = False,
    horizon: float = 0.0,
    substeps: int = SUBSTEPS,
) -> SimulatedCase:
    """Simulate a case that conceals the effects `missing` (none: a null case) at a strength.

    One seed gives one machine, one set of experiments and one noise, whatever is missing; `families` names the set of
    experiments, `rate` is in samples a second, `stretch` a factor on durations, and `coloured` says whether the
    position noise is coloured. `kind` forces a "rotary" or "linear" machine; an unbalance (`gravity_pendulum`) forces a
    rotary one. With a `horizon` (s), `hidden` predicts held-out recordings so far ahead. `substeps` is at 2 kHz.

    A robot's joint always carries a weight: the case file gives it unless `gravity_pendulum` is missing.
    """
    missing = tuple(missing)
    plant, knobs, sizes, given = knobs_of(seed, missing, strength, families, rate, kind)
    recordings, hidden, carried, ended = [], [], {}, 0.0
    for experiment in experiments_of(seed, plant, families, rate, stretch):
        if carried:
            # Nothing turns between two recordings: heat leaks and the supply recovers.
            pause = experiment.start_time - SETTLE - ended
            carried["heat"] *= float(np.exp(-pause / knobs["heat_tau"][0]))
            carried["sag"] *= float(np.exp(-pause / knobs["sag_tau"][0]))
        ahead = horizon if experiment.role == "holdout" else 0.0
        recording, carried, inside = record(
            experiment, plant, knobs, carried, seed, substeps, coloured=coloured, horizon=ahead
        )
        ended = experiment.start_time + recording["t"][-1]
        recordings.append(recording)
        hidden.append(inside)
    truth = {
        "missing": list(missing),
        "strength": strength if missing else None,
        "sizes": sizes,
        "base": plant.base(),
        "process_noise": plant.process_noise,
        "sensor_noise": plant.sensor_noise,
        "coloured": coloured,
        "kind": plant.kind,
        "families": families,
        "rate": rate,
        "stretch": stretch,
        "seed": seed,
    }
    described = {
        "motor_constant": float(plant.motor_constant),
        **plant.units,
        "encoder_step": float(plant.encoder_step),
    }
    return SimulatedCase(f"case_{seed}", described, recordings, truth, plant, knobs, hidden, given)


def write_case(case: SimulatedCase, folder: str | Path, name: str | None = None) -> Path:
    """Write case.toml and one CSV a recording (t, u, x) into `folder`; the truth stays out. Returns the TOML's path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'name = "{name or folder.name}"', "", "[plant]"]
    for key, value in case.plant.items():
        lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.9g}")
    if case.given:
        known = [
            f'{{name = "{effect}", {", ".join(f"{key} = {value:.6g}" for key, value in values.items())}}}'
            for effect, values in case.given.items()
        ]
        lines += ["", "[model]", f"effects = [{', '.join(known)}]"]
    for one in case.recordings:
        lines += ["", "[[recording]]", f'file = "{one["name"]}.csv"', f'role = "{one["role"]}"']
        lines += [f'loop = "{one["loop"]}"', f"start_time = {one['start_time']:.6f}"]
        table = np.column_stack([one["t"], one["u"], one["x"]])
        target = folder / f"{one['name']}.csv"
        np.savetxt(target, table, fmt=("%.6f", "%.9g", "%.12g"), delimiter=",", header="t,u,x", comments="")
    path = folder / "case.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
