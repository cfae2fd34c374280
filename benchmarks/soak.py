"""Cases of many structures in one process, and its memory: `python -m benchmarks.soak [--cases 50] [--seed 0] [--fit]`.

Each case is a plant with other effects, so that everything is compiled anew: it is simulated, and the misfit of a
recording and its slope are computed; with `--fit` the model is also fitted to the recording. Printed are the programs
that this library holds and the memory of the process, at its most, along the cases.
"""

import argparse
import itertools
import random
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import frictionjax as fj
from benchmarks.problem import SAMPLE_RATE, STAGE, drive_of, force
from frictionjax.core.programs import programs_held
from frictionjax.physics import Drive
from frictionjax.recordings import Recording

SAMPLES = 1000
_NOISE = 1e-7  # of the sensor, position units
_TOGETHER = 3  # effects of one case, at most


class Row(NamedTuple):
    """After so many `case`s: programs `held`, memory in `megabytes` now, `seconds` of the processor since the start."""

    case: int
    held: int
    megabytes: float
    seconds: float


def structures(count: int, seed: int) -> list[tuple[str, ...]]:
    """So many different combinations of effects, drawn with the `seed`."""
    names = [name for name, forms in fj.catalogue().items() if len(forms[0].strengths) and name != "backlash"]
    every = [some for size in range(1, _TOGETHER + 1) for some in itertools.combinations(names, size)]
    return random.Random(seed).sample(every, count)


def drive_with(names: tuple[str, ...]) -> Drive:
    """The stage with the effects of these `names`, at zero strength."""
    effects = [fj.catalogue()[name][0]() for name in names]
    loads = [effect for effect in effects if hasattr(effect, "load_side")]
    return drive_of(STAGE).with_effects(*(effect for effect in effects if effect not in loads[1:]))


def one_case(names: tuple[str, ...], seed: int, *, fitted: bool) -> float:
    """Simulate a plant with the effects of these `names`; returns its misfit, or that of the model `fitted` to it."""
    drive, u = drive_with(names), force(SAMPLES)

    def misfit(inertia: jax.Array, measured: jax.Array) -> jax.Array:
        moved = fj.simulate(drive.__class__(**{**vars(drive), "J": inertia}), u, SAMPLE_RATE)
        return jnp.mean((moved.x - measured) ** 2)

    measured = np.asarray(fj.simulate(drive, u, SAMPLE_RATE).x)
    measured = measured + _NOISE * np.random.default_rng(seed).standard_normal(SAMPLES)
    value, slope = jax.jit(jax.value_and_grad(misfit))(jnp.asarray(drive.J), jnp.asarray(measured))
    if not (np.isfinite(value) and np.isfinite(slope)):
        raise FloatingPointError(f"The misfit of {names} has the value {value} and the slope {slope}.")
    if fitted:
        recording = Recording("run", SAMPLE_RATE, u, measured)
        return float(fj.fit(drive, [recording], own_starts=False, progress=False).cost)
    return float(value)


def soak(cases: int, seed: int = 0, *, fitted: bool = False) -> Iterator[Row]:
    """A row after each of so many `cases` of different structures, drawn with the `seed`."""
    start = time.process_time()
    for number, names in enumerate(structures(cases, seed), start=1):
        one_case(names, seed + number, fitted=fitted)
        yield Row(number, programs_held(), _memory(), time.process_time() - start)


def _memory() -> float:
    """Megabytes that this process has in memory, now where the system says it, else at its most."""
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        return int(pages) * resource.getpagesize() / 1e6
    except FileNotFoundError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main(argv: list[str] | None = None) -> int:
    """Print a table of the options in `argv`; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument(
        "--cases", type=int, default=50, help="of different structures (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the structures (default: %(default)s)")
    parser.add_argument("--fit", action="store_true", help="fit each model as well")
    options = parser.parse_args(argv)
    fj.configure_jax()
    print(f"{'cases':>6}{'programs':>10}{'megabytes':>11}{'seconds':>9}")
    for row in soak(options.cases, options.seed, fitted=options.fit):
        if row.case == 1 or row.case % 5 == 0 or row.case == options.cases:
            print(f"{row.case:>6}{row.held:>10}{row.megabytes:>11.0f}{row.seconds:>9.0f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
