"""`python -m benchmarks.agreement`: whether two versions of the code come to the same diagnoses.

    python -m benchmarks.agreement run --out FILE [--cases CASE.toml ...] [--bank N] [--demo] [--part K/N]
        [--lines FILE]
    python -m benchmarks.agreement compare OLD NEW ...

`run` diagnoses case files, the demo and the first N of a fixed list of 40 simulated machines, and adds a JSON line for
each to FILE; what FILE has already is not run again. With `--lines` the machines are stored as lines of the bank, too,
with their tables of comparisons, for `benchmarks.replay`. `compare` prints a table: verdict and names, and the largest
relative change of any parameter and of any standard error. Between two versions that differ in their layout alone every
change is below 1e-6.
"""

import argparse
import json
import math
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import jax

import frictionjax as fj
from benchmarks.bank import PAIRS, diagnosis_and_line, plain
from benchmarks.concealed.reality import CATALOGUE
from frictionjax.core import keep_compiled

SEED = 9000
"""First seed of the machines: none that any study here uses."""
AGREES = 1e-6
"""Largest relative change that is rounding."""


def machines() -> list[tuple[int, tuple[str, ...], str]]:
    """Seed, what is missing, strength: 40 machines, among them every effect, seven without any, and ten pairs."""
    singles = [(name,) for name in CATALOGUE]
    mixed = [
        (missing, ("strong", "medium")[number % 2]) for number, missing in enumerate([*singles, *[()] * 7])
    ]
    mixed += [(pair, "strong") for pair in PAIRS]
    order = sorted(range(len(mixed)), key=lambda number: (number % 7, number))
    return [(SEED + number, *mixed[number]) for number in order][:40]


def cases(
    files: list[Path], bank: int, demo: bool, lines: Path | None
) -> Iterator[tuple[str, Callable[[], fj.Diagnosis]]]:
    """Name and diagnosis of everything asked for; a machine's line of the bank is added to `lines`."""
    for file in files:
        name = file.parent.name if file.name == "case.toml" else file.stem
        yield name, lambda file=file: fj.diagnose(fj.load_case(file))
    if demo:
        from frictionjax.demo import write_demo_case

        with tempfile.TemporaryDirectory() as folder:
            case = fj.load_case(write_demo_case(Path(folder)))
            yield "demo", lambda: fj.diagnose(case)
    for seed, missing, strength in machines()[:bank]:
        job = {"seed": seed, "missing": list(missing), "strength": strength}
        yield f"{seed} {'+'.join(missing) or 'nothing'}", lambda job=job: _stored(job, lines)


def _stored(job: dict, lines: Path | None) -> fj.Diagnosis:
    found, own = diagnosis_and_line(job)
    if lines is not None:
        lines.parent.mkdir(parents=True, exist_ok=True)
        with lines.open("a", encoding="utf-8") as file:
            file.write(json.dumps(own, default=plain) + "\n")
    return found


def line(name: str, diagnose: Callable[[], fj.Diagnosis]) -> dict:
    """A diagnosis in plain numbers."""
    start = time.perf_counter()
    found = diagnose()
    return {
        "name": name,
        "verdict": found.verdict,
        "named": [[m.effect, *m.effect_class[1:]] for m in found.missing],
        "confidence": [m.confidence for m in found.missing],
        "share": found.unexplained.share,
        "base": {k: [e.value, e.stderr] for k, e in found.base.items()},
        "extended": {k: [e.value, e.stderr] for k, e in found.extended.items()},
        "seconds": time.perf_counter() - start,
    }


def changes(old: dict, new: dict) -> tuple[float, float]:
    """Largest relative change of a parameter and of a standard error; infinite where one lacks what the other has."""
    values, errors = [0.0], [0.0]
    for model in ("base", "extended"):
        if old[model].keys() != new[model].keys():
            return math.inf, math.inf
        for key, (value, error) in old[model].items():
            other, other_error = new[model][key]
            values.append(_relative(value, other))
            errors.append(_relative(error, other_error))
    return max(values), max(errors)


def _relative(one: float, other: float) -> float:
    if one == other or (one != one and other != other):
        return 0.0
    size = max(abs(one), abs(other))
    return abs(one - other) / size if math.isfinite(size) else math.inf


def read(files: list[Path]) -> dict[str, dict]:
    """The lines of the `files` by name."""
    lines = [json.loads(text) for file in files for text in file.read_text(encoding="utf-8").splitlines()]
    return {own["name"]: own for own in lines}


def table(old: dict[str, dict], new: dict[str, dict], write) -> int:
    """Print how the `new` lines differ from the `old` ones; how many disagree."""
    write("| case | old | new | parameters | standard errors | s old | s new |")
    write("|---|---|---|---|---|---|---|")
    wrong = 0
    for name in [name for name in old if name in new]:
        one, other = old[name], new[name]
        said = [
            f"{own['verdict']} {' '.join('/'.join(n) for n in own['named'])}".strip() for own in (one, other)
        ]
        value, error = changes(one, other)
        agree = said[0] == said[1] and max(value, error) <= AGREES
        wrong += not agree
        write(
            f"| {name} | {said[0]} | {'same' if said[0] == said[1] else said[1]} | {value:.1e} | {error:.1e} | "
            f"{one['seconds']:.0f} | {other['seconds']:.0f} |{'' if agree else ' <'}"
        )
    both = sum(name in new for name in old)
    write(f"\n{both - wrong} of {both} agree to {AGREES:g}.")
    return wrong


def main() -> None:
    """Run or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    run = verbs.add_parser("run")
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--cases", type=Path, nargs="*", default=[])
    run.add_argument("--bank", type=int, default=0)
    run.add_argument("--demo", action="store_true")
    run.add_argument("--part", default="1/1")
    run.add_argument("--lines", type=Path)
    compare = verbs.add_parser("compare")
    compare.add_argument("old", type=Path)
    compare.add_argument("new", type=Path, nargs="+")
    arguments = parser.parse_args()

    def write(text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    if arguments.verb == "compare":
        sys.exit(bool(table(read([arguments.old]), read(arguments.new), write)))
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    fj.configure_jax()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    keep_compiled(arguments.out.parent / "compiled")
    done = read([arguments.out]) if arguments.out.exists() else {}
    k, n = (int(number) for number in arguments.part.split("/"))
    asked = cases(arguments.cases, arguments.bank, arguments.demo, arguments.lines)
    for number, (name, diagnose) in enumerate(asked):
        if name in done or number % n != k - 1:
            continue
        own = line(name, diagnose)
        jax.clear_caches()  # programs are of the case's lengths: kept, they would fill the memory
        with arguments.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(own) + "\n")
        write(f"{name}: {own['verdict']} {own['named']} {own['seconds']:.0f} s")


if __name__ == "__main__":
    main()
