"""Seconds from files to a verdict: `python -m benchmarks.diagnose [--rows 1500 20000 204000]`.

For each number of rows two cases of one machine (a motor with 0.3 N m of gravity) that differ in sample rate, length
and number of recordings. Each diagnosis is a process, as a user runs it: the first case with an empty cache (`cold`),
the second with what the first has left there (`other shapes`), the second again (`again`).
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import frictionjax as fj
from benchmarks.timing import machine

NOISE = 2e-5  # rad
CASES = {
    1_500: ((62.5, 375, 4), (100.0, 300, 5)),
    20_000: ((1000.0, 5_000, 4), (800.0, 4_000, 5)),
    204_000: ((2000.0, 25_500, 8), (1600.0, 34_000, 6)),
}
"""Rows -> sample rate (Hz), samples of a recording, and recordings, of the two cases."""


def _machine() -> fj.Drive:
    return fj.Drive(
        J=0.03,
        friction=fj.LuGre(sigma0=150.0, sigma1=0.4, sigma2=0.02, Fc=0.1, Fs=0.13, vs=0.08),
        effects=(fj.catalogue()["gravity_pendulum"][0](sine=0.3),),
    )


def write(folder: Path, rate: float, samples: int, count: int) -> Path:
    """A case of `count` recordings of so many `samples` at `rate` Hz, the last one held out; its file."""
    folder.mkdir()
    rng, lines = np.random.default_rng(count), ['name = "benchmark"', "[plant]", 'position_unit = "rad"']
    t = np.arange(samples) / rate
    for number in range(count):
        phases = rng.uniform(0.0, 2.0 * np.pi, 4)
        u = sum(
            0.16 * np.sin(2.0 * np.pi * f * t + p) for f, p in zip((0.3, 0.7, 1.9, 4.1), phases, strict=True)
        )
        run = fj.simulate(_machine(), u, rate, substeps=max(int(4000.0 / rate), 2))
        x = np.asarray(run.x) + NOISE * rng.standard_normal(samples)
        name = f"recording_{number}.csv"
        np.savetxt(folder / name, np.column_stack([t, u, x]), delimiter=",", header="t,u,x", comments="")
        role = "holdout" if number == count - 1 else "fit"
        lines += ["[[recording]]", f'file = "{name}"', f'role = "{role}"']
    file = folder / "case.toml"
    file.write_text("\n".join(lines) + "\n")
    return file


def run(case: Path, cache: Path, out: Path) -> tuple[float, float, str]:
    """Seconds of the program on the `case`, those of compilation in all threads, and what it says."""
    start = time.perf_counter()
    environment = {key: value for key, value in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
    subprocess.run(
        [sys.executable, "-m", "frictionjax", "diagnose", str(case), "--out", str(out)],
        env=environment | {"XDG_CACHE_HOME": str(cache)},
        check=True,
        capture_output=True,
    )
    seconds = time.perf_counter() - start
    verdict = json.loads((out / "verdict.json").read_text())
    names = " + ".join(one["effect"] for one in verdict["missing"])
    return seconds, verdict["seconds"]["compile"], f"{verdict['verdict']} {names}".strip()


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", nargs="*", type=int, default=list(CASES), choices=list(CASES))
    arguments = parser.parse_args()
    fj.configure_jax()
    print(json.dumps(machine()))
    print("| rows | run | seconds | of that compilation, all threads | verdict |\n|---|---|---|---|---|")
    for rows in arguments.rows:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            first, second = (
                write(folder / f"case_{index}", *shape) for index, shape in enumerate(CASES[rows])
            )
            turns = (("cold", first), ("other shapes", second), ("again", second))
            for what, case in turns:
                seconds, compiled, verdict = run(case, folder / "cache", folder / "out")
                print(f"| {rows} | {what} | {seconds:.1f} | {compiled:.1f} | {verdict} |", flush=True)


if __name__ == "__main__":
    main()
