"""Cases: a machine, what is concealed in it, and its recordings; in memory and as a folder of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .effects import build
from .experiments import RATE, Experiment, plan
from .knobs import pack
from .plants import Plant, draw_plant
from .recorder import SETTLE, SUBSTEPS, Hidden, record
from .streams import stream


@dataclass(frozen=True)
class SimulatedCase:
    """A simulated case: `plant` as a case file describes it, `recordings`, and the `truth` that is to be found.

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


def experiments_of(
    seed: int, plant: Plant, families: str = "default", rate: float = RATE, stretch: float = 1.0
) -> list[Experiment]:
    """Experiments of a seed: the same whatever its case conceals."""
    return plan(stream(seed, "experiments", families), plant, families, rate, stretch)


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
    """
    missing = tuple(missing)
    if kind is None and "gravity_pendulum" in missing:
        kind = "rotary"
    plant = draw_plant(stream(seed, "plant"), kind)
    changes, sizes = build(missing, strength, plant, lambda name: stream(seed, "effect", name))
    knobs = pack(plant, changes)
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
    return SimulatedCase(f"case_{seed}", described, recordings, truth, plant, knobs, hidden)


def write_case(case: SimulatedCase, folder: str | Path, name: str | None = None) -> Path:
    """Write case.toml and one CSV a recording (t, u, x) into `folder`; the truth stays out. Returns the TOML's path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'name = "{name or folder.name}"', "", "[plant]"]
    for key, value in case.plant.items():
        lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.9g}")
    for one in case.recordings:
        lines += ["", "[[recording]]", f'file = "{one["name"]}.csv"', f'role = "{one["role"]}"']
        lines += [f'loop = "{one["loop"]}"', f"start_time = {one['start_time']:.6f}"]
        table = np.column_stack([one["t"], one["u"], one["x"]])
        target = folder / f"{one['name']}.csv"
        np.savetxt(target, table, fmt=("%.6f", "%.9g", "%.12g"), delimiter=",", header="t,u,x", comments="")
    path = folder / "case.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
