"""Sanity of the simulator: two tables.

    python -m benchmarks.concealed.reality.check [--seeds N] [--only NAME ...] [--family NAME] [--rate HZ]

The first has one row an effect (strong): how far stick recordings travel, how well closed loops follow, what input they
need, and how much the effect changes the measured position, in encoder steps. The second halves the substep.
"""

from __future__ import annotations

import argparse
import dataclasses
import time

import numpy as np

from .cases import SimulatedCase, experiments_of, make_case
from .effects import EFFECTS
from .experiments import FAMILIES, RATE
from .families import RATES
from .recorder import SUBSTEPS, record

_FINE = 1e-7


def excursion(case: SimulatedCase) -> float:
    """Largest travel of a stick recording over the break-away deflection (recordings meant to slip left out)."""
    travels = [
        np.ptp(r["x"]) for r in case.recordings if r["loop"] == "open" and r["name"] not in ("breakaway",)
    ]
    return max(travels, default=0.0) / case.machine.deflection


def tracking(case: SimulatedCase) -> float:
    """Largest rms tracking error of a closed loop, over the rms of its reference."""
    truth = case.truth
    made = experiments_of(truth["seed"], case.machine, truth["families"], truth["rate"], truth["stretch"])
    plans = {e.name: e for e in made}
    errors = []
    for r in case.recordings:
        if r["loop"] == "closed":
            wanted = plans[r["name"]].command
            errors.append(np.std(wanted - r["x"]) / np.std(wanted))
    return max(errors, default=0.0)


def loudest(case: SimulatedCase) -> float:
    """Largest input, as a share of what breaks away."""
    peak = max(np.abs(r["u"]).max() for r in case.recordings)
    return peak * case.machine.motor_constant / case.machine.Fs


def change(case: SimulatedCase, null: SimulatedCase, loop: str) -> float:
    """Rms difference to the same case without effect, in encoder steps, over recordings of one loop."""
    pairs = zip(case.recordings, null.recordings, strict=True)
    squares = [np.mean((a["x"] - b["x"]) ** 2) for a, b in pairs if a["loop"] == loop]
    return float(np.sqrt(np.mean(squares))) / case.machine.encoder_step if squares else 0.0


def convergence(
    seed: int,
    missing: tuple[str, ...],
    substeps: int = SUBSTEPS,
    *,
    family: str = "default",
    rate: float = RATE,
) -> dict[str, float]:
    """Rms change of the true position when the substep is halved, over the rms sensor noise, by recording.

    Without rounding: a controller would turn the first sample rounded to the other side into another noise.
    """
    case = make_case(seed, missing, families=family, rate=rate)
    machine = dataclasses.replace(
        case.machine,
        encoder_step=case.machine.encoder_step * _FINE,
        sensor_noise=case.machine.sensor_noise / _FINE,
    )
    noise = machine.sensor_noise * machine.encoder_step
    carried: dict[str, float] = {}
    changes = {}
    for experiment in experiments_of(seed, case.machine, family, rate):
        _, _, coarse = record(experiment, machine, case.knobs, carried, seed, substeps)
        _, carried, fine = record(experiment, machine, case.knobs, carried, seed, 2 * substeps)
        changes[experiment.name] = float(np.sqrt(np.mean((coarse.clean - fine.clean) ** 2))) / noise
    return changes


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="*", default=None, help="effects to check (default: all)")
    parser.add_argument("--strength", default="strong")
    parser.add_argument("--family", default="default", choices=FAMILIES, help="family of experiments")
    parser.add_argument("--rate", type=float, default=None, help="samples a second (default: the family's)")
    options = parser.parse_args()
    rate = options.rate or RATES.get(options.family, (RATE,))[0]
    made = {"families": options.family, "rate": rate}
    names = options.only or ["", *EFFECTS]

    print(f"{'effect':30s} seed  kind    finite stick/z0  track  u/ubreak  dx stick   dx slide  seconds")
    for name in names:
        for seed in range(options.seeds):
            missing = (name,) if name else ()
            began = time.perf_counter()
            case = make_case(seed, missing, options.strength, **made)
            spent = time.perf_counter() - began
            null = make_case(seed, (), kind=case.machine.kind, **made)
            finite = all(np.isfinite(r["x"]).all() and np.isfinite(r["u"]).all() for r in case.recordings)
            row = f"{name or '(null)':30s} {seed:4d}  {case.machine.kind:7s} {finite!s:6s} {excursion(case):8.2f}"
            row += f" {tracking(case):6.3f} {loudest(case):8.2f} {change(case, null, 'open'):10.2f}"
            print(f"{row} {change(case, null, 'closed'):10.2f} {spent:7.2f}", flush=True)

    print("\nhalving the substep: rms change of position over sensor noise")
    for name in names:
        changes = convergence(0, (name,) if name else (), family=options.family, rate=rate)
        print(f"{name or '(null)':30s} " + "  ".join(f"{k} {v:.2g}" for k, v in changes.items()), flush=True)


if __name__ == "__main__":
    main()
