"""Cases: a machine, what is concealed in it, and its recordings; in memory and as a folder of files."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .effects import build
from .experiments import RATE, Experiment, plan
from .kernel import simulate
from .knobs import SLOW_STATES, pack, rest
from .plants import Plant, draw_plant

SUBSTEPS = 32
_SETTLE = 1.0


@dataclass(frozen=True)
class SimulatedCase:
    """A simulated case: `plant` as a case file describes it, `recordings`, and the `truth` that is to be found.

    A recording is a dict of name, role, loop, start_time, sample_rate, t, u and x (measured). `machine` and `knobs`
    (every parameter of the simulator) are for the author of a benchmark; a diagnosis must not see them, nor `truth`.
    """

    name: str
    plant: dict
    recordings: list[dict]
    truth: dict
    machine: Plant
    knobs: np.ndarray


def _stream(seed: int, *labels: str) -> np.random.Generator:
    """Random stream of its own for each purpose, so that nothing shifts when an effect draws more numbers."""
    return np.random.default_rng([seed, *(zlib.crc32(label.encode()) for label in labels)])


def _gains(rng: np.random.Generator, plant: Plant, trip: float) -> np.ndarray:
    """PD controller tuned on the inertia, as on the shop floor, with a bandwidth of some hertz."""
    w = 2 * np.pi * rng.uniform(4.5, 8.0)
    kp = plant.J * w**2 / plant.motor_constant
    kd = 2 * rng.uniform(0.7, 1.0) * plant.J * w / plant.motor_constant
    return np.array([kp, kd, rng.uniform(2e-3, 4e-3), 6.0 * plant.Fs / plant.motor_constant, trip])


def record(
    experiment: Experiment,
    plant: Plant,
    knobs: np.ndarray,
    carried: dict[str, float],
    seed: int,
    substeps: int = SUBSTEPS,
) -> tuple[dict, dict[str, float], np.ndarray]:
    """Simulate one experiment; returns the recording, the slow states at its end, and the true position."""
    rng = _stream(seed, "noise", experiment.name)
    gains = _gains(_stream(seed, "controller"), plant, experiment.trip)
    state = rest()
    for name, value in carried.items():
        state[name] = value
    dt, n = 1.0 / RATE, experiment.command.size
    start = experiment.start_time

    def run(closed: bool, command: np.ndarray, quiet: bool, begin: float) -> tuple[np.ndarray, ...]:
        count = command.size
        scale = 0.0 if quiet else 1.0
        noise = scale * plant.sensor_noise * plant.encoder_step * rng.standard_normal(count)
        push = scale * plant.process_noise * plant.Fc * rng.standard_normal(count)
        slow = scale * rng.standard_normal((count, 2))
        step = plant.encoder_step
        return simulate(knobs, state, closed, command, gains, step, noise, push, slow, begin, dt, substeps)

    # Constant forces are there before the recording starts: let the machine settle under them.
    run(False, np.zeros(round(_SETTLE * RATE)), True, start - _SETTLE)
    u, y, x = run(experiment.loop == "closed", experiment.command, False, start)
    recording = {
        "name": experiment.name,
        "role": experiment.role,
        "loop": experiment.loop,
        "start_time": start,
        "sample_rate": RATE,
        "t": np.arange(n) * dt,
        "u": u,
        "x": y,
    }
    return recording, {name: float(state[name][0]) for name in SLOW_STATES}, x


def experiments_of(seed: int, plant: Plant, families: str = "default") -> list[Experiment]:
    """Experiments of a seed: the same whatever its case conceals."""
    return plan(_stream(seed, "experiments", families), plant, families)


def make_case(
    seed: int,
    missing: Sequence[str] = ("creep",),
    strength: str = "strong",
    *,
    families: str = "default",
    kind: str | None = None,
    substeps: int = SUBSTEPS,
) -> SimulatedCase:
    """Simulate a case that conceals the effects `missing` (none: a null case) at a strength.

    One seed gives one machine, one set of experiments and one noise, whatever is missing; `families` names the set of
    experiments. `kind` forces a "rotary" or "linear" machine; an unbalance (`gravity_pendulum`) forces a rotary one.
    """
    missing = tuple(missing)
    if kind is None and "gravity_pendulum" in missing:
        kind = "rotary"
    plant = draw_plant(_stream(seed, "plant"), kind)
    changes, sizes = build(missing, strength, plant, lambda name: _stream(seed, "effect", name))
    knobs = pack(plant, changes)
    recordings, carried, ended = [], {}, 0.0
    for experiment in experiments_of(seed, plant, families):
        if carried:
            # Nothing turns between two recordings: heat leaks and the supply recovers.
            pause = experiment.start_time - _SETTLE - ended
            carried["heat"] *= float(np.exp(-pause / knobs["heat_tau"][0]))
            carried["sag"] *= float(np.exp(-pause / knobs["sag_tau"][0]))
        recording, carried, _ = record(experiment, plant, knobs, carried, seed, substeps)
        ended = experiment.start_time + recording["t"][-1]
        recordings.append(recording)
    truth = {
        "missing": list(missing),
        "strength": strength if missing else None,
        "sizes": sizes,
        "base": plant.base(),
        "process_noise": plant.process_noise,
        "sensor_noise": plant.sensor_noise,
        "kind": plant.kind,
        "families": families,
        "seed": seed,
    }
    described = {
        "motor_constant": float(plant.motor_constant),
        **plant.units,
        "encoder_step": float(plant.encoder_step),
    }
    return SimulatedCase(f"case_{seed}", described, recordings, truth, plant, knobs)


def write_case(case: SimulatedCase, folder: str | Path, name: str | None = None) -> Path:
    """Write case.toml and one CSV a recording (t, u, x) into `folder`; the truth stays out. Returns the TOML's path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'name = "{name or folder.name}"', "", "[plant]"]
    for key, value in case.plant.items():
        lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.9g}")
    for record in case.recordings:
        lines += ["", "[[recording]]", f'file = "{record["name"]}.csv"', f'role = "{record["role"]}"']
        lines += [f'loop = "{record["loop"]}"', f"start_time = {record['start_time']:.6f}"]
        table = np.column_stack([record["t"], record["u"], record["x"]])
        target = folder / f"{record['name']}.csv"
        np.savetxt(target, table, fmt=("%.6f", "%.9g", "%.12g"), delimiter=",", header="t,u,x", comments="")
    path = folder / "case.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
