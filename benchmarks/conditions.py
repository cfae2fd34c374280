"""`python -m benchmarks.conditions [--only NAME ...]`: one machine under the conditions that recordings are made in.

Sample rates from 50 Hz to 20 kHz, uneven time stamps, an unknown motor constant, one recording or eleven, ten seconds
in all or ten minutes, a coarse encoder, several rates in one case: each with nothing hidden and with friction that
depends on the direction (strong). Prints what was said of both, in brackets the share of the misfit that is explained,
and seconds.
"""

import argparse
import dataclasses
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import frictionjax as fj
from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from frictionjax.recordings import Recording

EFFECT = "direction_asymmetry"
SEED = 9500


def _each(case: fj.Case, change: Callable[[Recording, int], Recording]) -> fj.Case:
    return dataclasses.replace(
        case, recordings=tuple(change(recording, k) for k, recording in enumerate(case.recordings))
    )


def _thinned(recording: Recording, by: int) -> Recording:
    """Every `by`-th sample of the position; the input is what acted in the mean."""
    n = recording.x.size // by * by
    u = recording.u[:n].reshape(-1, by).mean(1)
    return dataclasses.replace(recording, u=u, x=recording.x[:n:by], sample_rate=recording.sample_rate / by)


def _slower(by: int) -> Callable[[fj.Case], fj.Case]:
    return lambda case: _each(case, lambda recording, _: _thinned(recording, by))


def _mixed(case: fj.Case) -> fj.Case:
    return _each(case, lambda recording, k: _thinned(recording, (1, 2, 4)[k % 3]))


def _rounded(step: float) -> Callable[[fj.Case], fj.Case]:
    """Without the recordings in which the encoder then stands still: a case with such a one is refused."""

    def change(case: fj.Case) -> fj.Case:
        coarse = _each(case, lambda r, _: dataclasses.replace(r, x=np.round(r.x / step) * step))
        moving = tuple(r for r in coarse.recordings if np.ptp(r.x) > 0.0)
        plant = dataclasses.replace(case.plant, encoder_step=step)
        return dataclasses.replace(coarse, plant=plant, recordings=moving)

    return change


def _uneven(case: fj.Case) -> fj.Case:
    """Every fifth sample in the mean, one more or less, in files with their own times."""
    rng = np.random.default_rng(0)
    lines = [
        f"[plant]\nmotor_constant = {case.plant.motor_constant}\nencoder_step = {case.plant.encoder_step}"
    ]
    with tempfile.TemporaryDirectory() as folder:
        for r in case.recordings:
            at = np.arange(5, r.x.size - 10, 5) + rng.integers(-1, 2, (r.x.size - 11) // 5)
            u = np.add.reduceat(r.u, at)[:-1] / np.diff(at)
            table = np.column_stack([at[:-1] / r.sample_rate, u, r.x[at[:-1]]])
            np.savetxt(f"{folder}/{r.name}.csv", table, delimiter=",", header="t,u,x", comments="")
            lines.append(
                f'[[recording]]\nfile = "{r.name}.csv"\nrole = "{r.role}"\nloop = "{r.loop}"\n'
                f"start_time = {r.start_time}"
            )
        (Path(folder) / "case.toml").write_text("\n".join(lines))
        return fj.load_case(f"{folder}/case.toml")


def _no_constant(case: fj.Case) -> fj.Case:
    return dataclasses.replace(case, plant=dataclasses.replace(case.plant, motor_constant=None))


def _alone(name: str) -> Callable[[fj.Case], fj.Case]:
    return lambda case: fj.hold_out_last_third(
        dataclasses.replace(case, recordings=tuple(r for r in case.recordings if r.name == name))
    )


def _same(case: fj.Case) -> fj.Case:
    return case


class Condition(NamedTuple):
    """How the machine is simulated (options of `make_case`), and what becomes of its recordings."""

    options: dict
    change: Callable[[fj.Case], fj.Case] = _same


TURN = 2.0 * np.pi
CONDITIONS = {
    "as it is: 2 kHz, eight recordings": Condition({}),
    "20 kHz": Condition({"rate": 20000.0, "stretch": 0.5}),
    "10 kHz": Condition({"rate": 10000.0}),
    "500 Hz": Condition({"rate": 500.0}),
    "200 Hz": Condition({"rate": 200.0}),
    "50 Hz": Condition({"rate": 50.0}),
    "500 Hz of a loop of 2 kHz": Condition({}, _slower(4)),
    "200 Hz of a loop of 2 kHz": Condition({}, _slower(10)),
    "rates of 2000, 1000 and 500 Hz": Condition({}, _mixed),
    "2 kHz, steps that differ by two fifths": Condition({"rate": 10000.0}, _uneven),
    "motor constant unknown": Condition({}, _no_constant),
    "one recording": Condition({}, _alone("moves")),
    "eleven recordings": Condition({"families": "rich"}),
    "ten seconds in all": Condition({"stretch": 0.1}),
    "ten minutes in all, 1 kHz": Condition({"stretch": 6.0}, _slower(2)),
    "encoder of 12 bit": Condition({}, _rounded(TURN / 2**12)),
    "encoder of 16 bit": Condition({}, _rounded(TURN / 2**16)),
    "encoder of 24 bit": Condition({}, _rounded(TURN / 2**24)),
}


def said(condition: Condition, missing: tuple[str, ...]) -> tuple[str, float]:
    """Verdict with names and the share that they explain, and seconds."""
    simulated = make_case(SEED, missing=missing, strength="strong", kind="rotary", **condition.options)
    case = condition.change(case_of(simulated))
    start = time.perf_counter()
    try:
        found = fj.diagnose(case)
    except ValueError as error:
        return f"refused: {error}", time.perf_counter() - start
    names = ", ".join(f"{one.effect} ({one.evidence[0]:.2f})" for one in found.missing)
    return f"{found.verdict} {names}".strip(), time.perf_counter() - start


def main() -> None:
    """Diagnose and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(CONDITIONS), choices=CONDITIONS, metavar="NAME")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    fj.configure_jax()
    sys.stdout.write(f"| condition | nothing hidden | s | {EFFECT} | s |\n|---|---|---|---|---|\n")
    for name in arguments.only:
        (none, one), (effect, other) = (said(CONDITIONS[name], missing) for missing in ((), (EFFECT,)))
        sys.stdout.write(f"| {name} | {none} | {one:.0f} | {effect} | {other:.0f} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
