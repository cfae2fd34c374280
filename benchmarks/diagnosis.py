"""`python -m benchmarks.diagnosis`: how often the diagnosis is right, on machines with other equations.

    python -m benchmarks.diagnosis [--seeds N] [--effects NAME ...] [--nulls N] [--out FOLDER] [--part K/N]
    python -m benchmarks.diagnosis --tables [--out FOLDER] [--beside FOLDER ...] [--store FOLDER]
    python -m benchmarks.diagnosis --again FOLDER ... [--out FOLDER] [--part K/N]

Machines, experiments, effects and noise are drawn by `benchmarks.concealed.reality`; machines with one hidden effect
are diagnosed a second time without it in the catalogue. An interrupted run continues from the lines in `--out`;
`--tables` prints the tables of the existing lines and diagnoses nothing; `--store` writes the fields that tables and
calibration read to a folder, to be kept. Hours at full size: `--part 1/2` and `--part 2/2` are two processes that share
it. If several folders have a line of one machine, the tables count that of the first. `--again` repeats those lines of
these folders that a refused effect may change (`bank.can_change`); with `--tables` it prints how many of them `--out`
has.
"""

import argparse
import functools
import json
import sys
import warnings
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import frictionjax as fj
from benchmarks.bank import COMPILED, again, can_change, diagnosed, fill, job_of, jobs
from benchmarks.concealed.reality import CATALOGUE
from frictionjax.core import keep_compiled
from frictionjax.diagnosis.selection.verdict_rule import most_left
from frictionjax.physics import catalogue

STRENGTHS = ["strong", "medium"]
"""Clearly visible, and a third of it."""
CLASSES = ({"maxwell_slip", "elasto_plastic"}, {"delay", "drive_lag", "sensor_lag"})
"""Names that are often one class, whichever of them is true: hysteresis in presliding, and what comes late. Without one
of them in the catalogue another of its class is no wrong name."""
PLANS = ["one", "none", "pairs", "outside"]
"""One effect, nothing, two effects, and what the catalogue lacks."""
SIZES = {
    "constant_load": ("load", "force", lambda v: v),
    "return_spring": ("stiffness", "stiffness", lambda v: v),
    "direction_asymmetry": ("coulomb", "level", lambda v: v),
    "stribeck_shape": ("exponent_change", "exponent", lambda v: v - 2.0),
    "friction_lag": ("lag", "time", lambda v: v),
    "load_dependence": ("growth", "mu", lambda v: v),
    "quadratic_drag": ("drag", "coefficient", lambda v: v),
    "delay": ("delay", "time", lambda v: v),
    "drive_lag": ("time_constant", "time", lambda v: v),
    "drive_deadzone": ("width", "half_width", lambda v: v),
    "elasto_plastic": ("core", "breakaway_ratio", lambda v: v),
}
"""Effects whose size means the same in the simulator and here: our parameter, its own, and how to get ours from its."""


def outcome(line: dict) -> str:
    """named right, right within its class, abstained (nothing or `unknown`), or wrong."""
    true = set(line["missing"])
    if not line["named"]:
        return "abstained"
    if line["named"][0] in true:
        return "named"
    return "class" if true & set(line["classes"][0]) else "wrong"


def recovered(line: dict) -> float:
    """Part of the held-out error 0.1 s ahead above the noise that the extended model removes; all recordings, each in
    units of its noise. Not a number where the base model is at the noise."""
    before, after = 0.0, 0.0
    for base, extended, noise in line["held"].values():
        before += max((base / noise) ** 2 - 1.0, 0.0)
        after += max((extended / noise) ** 2 - 1.0, 0.0)
    return 1.0 - after / before if before > 1.0 else float("nan")


def size_error(line: dict) -> tuple[float, float] | None:
    """Relative error of the size, and the same in standard errors; None where the sizes do not compare."""
    if outcome(line) != "named" or line["named"][0] not in SIZES:
        return None
    effect = line["named"][0]
    ours, theirs, convert = SIZES[effect]
    truth = line["sizes"].get(effect, {})
    if ours not in line["parameters"][0] or not isinstance(truth.get(theirs), float):
        return None
    true, (value, stderr) = convert(truth[theirs]), line["parameters"][0][ours]
    return abs(value / true - 1.0), abs(value - true) / stderr if stderr and np.isfinite(stderr) else np.nan


def verdict_without(line: dict) -> str:
    """The verdict without the true effect in the catalogue, by the limits of today: those of the version that made the
    line may have been others."""
    left = line["left"]
    names = _without(line)
    if not names:
        return left["verdict"]
    exact = [catalogue()[name][0].about.one_law for name in names]
    return "named" if 1.0 - left["evidence"][0][0] < most_left(exact) else "unknown"


def table_of_effects(lines: list[dict], write) -> None:
    """Named, class, abstained, wrong by effect and strength; size errors; held-out recovery; seconds."""
    write(
        "| effect | strength | cases | misfit | named | class | abstained | wrong (as) | size error | recovered | s |"
    )
    write("|---|---|---|---|---|---|---|---|---|---|---|")
    grouped = defaultdict(list)
    for line in lines:
        grouped[",".join(line["missing"]), line["strength"]].append(line)
    for (name, strength), some in grouped.items():
        counts = Counter(outcome(line) for line in some)
        wrong = ", ".join(line["named"][0] for line in some if outcome(line) == "wrong")
        errors = [e[0] for e in map(size_error, some) if e is not None]
        misfit = np.median([max(line["steps"][0]["misfits_unit"]) for line in some])
        write(
            f"| {name} | {strength} | {len(some)} | {misfit:.3f} | {counts['named']} | {counts['class']} | "
            f"{counts['abstained']} | {counts['wrong']} {f'({wrong})' if wrong else ''} | "
            f"{f'{100 * np.median(errors):.1f} %' if errors else ''} | "
            f"{np.median([recovered(line) for line in some]):.2f} | "
            f"{np.median([line['seconds'] for line in some]):.0f} |"
        )


def summary(read: dict[str, list[dict]], write) -> None:
    """The sums that the goals are about."""
    for strength in STRENGTHS:
        some = [line for line in read["one"] if line["strength"] == strength]
        if some:
            right = sum(outcome(line) in ("named", "class") for line in some)
            wrong = sum(outcome(line) == "wrong" for line in some)
            write(f"- {strength}: right within class {right} of {len(some)}, named wrongly {wrong}.")
            seen = [line for line in some if max(line["steps"][0]["misfits_unit"]) > 0.02]
            right = sum(outcome(line) in ("named", "class") for line in seen)
            write(
                f"  Where the base model misses by more than 2 % of a nat a sample: {right} of {len(seen)}."
            )
    errors = [e for line in read["one"] if (e := size_error(line)) is not None]
    if errors:
        inside = np.mean([e[1] < 1.96 for e in errors if np.isfinite(e[1])])
        write(
            f"- sizes that compare, {len(errors)}: median error {100 * np.median([e[0] for e in errors]):.2f} %; in "
            f"the 95 % interval {100 * inside:.0f} %."
        )
    for plan, words in (("none", "nothing missing"), ("outside", "outside the catalogue")):
        if read[plan]:
            counts = Counter(line["verdict"] for line in read[plan])
            write(f"- {words}, {len(read[plan])}: " + ", ".join(f"{v} {n}" for v, n in counts.items()) + ".")
    left = [line for line in read["one"] if line["left"]]
    if left:
        verdicts = [verdict_without(line) for line in left]
        names = [line for line, verdict in zip(left, verdicts, strict=True) if verdict == "named"]
        named, wrong = [_as_another(line) for line in names], sum(_of_another_class(line) for line in names)
        write(
            f"- own effect left out of the catalogue, {len(left)}: "
            + ", ".join(f"{verdict} {number}" for verdict, number in Counter(verdicts).items())
            + f"; named: {', '.join(named) or 'none'}. Of another class than what was left out: {wrong} of {len(left)}."
        )
    if read["pairs"]:
        hits = sum(len(set(line["missing"]) & set(line["named"])) for line in read["pairs"])
        total = sum(len(line["missing"]) + len(set(line["named"])) for line in read["pairs"])
        write(f"- pairs, {len(read['pairs'])}: F1 {2 * hits / total:.2f}.")


def thinned(line: dict) -> dict:
    """What tables, `benchmarks.calibrate` and `benchmarks.replay` read of a `line`: of each round the misfit and the
    name, and every comparison."""

    def outline(steps: list[dict]) -> list[dict]:
        return [{key: step[key] for key in ("misfits_unit", "accepted", "effect")} for step in steps]

    left = line["left"] and line["left"] | {"steps": outline(line["left"]["steps"])}
    return line | {"steps": outline(line["steps"]), "left": left}


def store(folder: Path, read: dict[str, list[dict]]) -> None:
    """Thin lines to a `folder`, one file a plan, where there are any; `--out` on that folder goes on from them."""
    folder.mkdir(parents=True, exist_ok=True)
    for plan, lines in read.items():
        if lines:
            text = "".join(json.dumps(thinned(line)) + "\n" for line in lines)
            (folder / f"{plan}.jsonl").write_text(text, encoding="utf-8")


def lines_of_plan(folders: Sequence[Path], plan: str) -> list[dict]:
    """The lines of a `plan` in the `folders`; of one job the line of the first folder that has it."""
    lines: dict[str, dict] = {}
    for path in [path for folder in folders for path in sorted(folder.glob(f"{plan}*.jsonl"))]:
        for line in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
            lines.setdefault(json.dumps(job_of(line)), line)
    return list(lines.values())


def print_changes(old: list[dict], new: list[dict], write) -> None:
    """How many of the `old` lines can change, and how many of those are among the `new` ones."""
    made = [job_of(line) for line in new]
    for words, sides in (
        ("the effect in the catalogue", old),
        ("the effect left out", [line | line["left"] for line in old if line["left"]]),
    ):
        some = [job_of(side) for side in sides if can_change(side["evidence"], side["steps"])]
        write(
            f"- can change, {words}: {len(some)} of {len(sides)}; made anew: {sum(job in made for job in some)}."
        )


def _part(text: str) -> tuple[int, int]:
    k, _, n = text.partition("/")
    if not (k.isdigit() and n.isdigit() and 1 <= int(k) <= int(n)):
        raise argparse.ArgumentTypeError(f'"{text}" is no part: write K/N, 1 <= K <= N, as in 1/2')
    return int(k), int(n)


def _without(line: dict) -> list[str]:
    """What is named without the true effect in the catalogue."""
    return [step["effect"] for step in line["left"]["steps"] if step["effect"]]


def _of_another_class(line: dict) -> bool:
    return not any({*_without(line), *line["missing"]} <= names for names in CLASSES)


def _as_another(line: dict) -> str:
    names = _without(line)
    return f"{','.join(line['missing'])} ({line['strength']}) as {' and '.join(names)}"


def main() -> None:
    """Diagnose and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="machines for each effect and strength")
    parser.add_argument(
        "--first", type=int, default=30, help="first seed; those before were used for development"
    )
    parser.add_argument("--nulls", type=int, default=40)
    parser.add_argument("--effects", nargs="*", default=list(CATALOGUE))
    parser.add_argument("--plans", nargs="*", default=PLANS, choices=PLANS)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis"))
    parser.add_argument("--part", type=_part, default=(1, 1), help="K/N: every N-th machine from the K-th on")
    parser.add_argument("--tables", action="store_true", help="print what is there, diagnose nothing")
    parser.add_argument(
        "--beside", type=Path, nargs="*", default=[], help="more folders that the tables count, too"
    )
    parser.add_argument(
        "--again",
        type=Path,
        nargs="*",
        default=[],
        help="folders of lines to make anew where they can change",
    )
    parser.add_argument("--store", type=Path, help="folder for what is worth keeping of the lines")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    fj.configure_jax()
    k, n = arguments.part
    if not arguments.tables:
        keep_compiled(arguments.out / COMPILED)
        for plan in arguments.plans:
            many = {"one": arguments.seeds, "none": arguments.nulls, "outside": 1, "pairs": 2}[plan]
            seeds = list(range(arguments.first, arguments.first + many))
            strengths = STRENGTHS if plan == "one" else ["strong"]
            todo = jobs(plan, strengths, seeds, arguments.effects if plan == "one" else [])
            fill(
                arguments.out / f"{plan}-{k}-of-{n}.jsonl",
                lines_of_plan(arguments.again, plan) if arguments.again else todo,
                again if arguments.again else functools.partial(diagnosed, left_out=plan == "one"),
                part=(k - 1, n),
                kept=sorted(arguments.out.glob(f"{plan}*.jsonl")),
            )
    read = {}
    for plan in PLANS:
        lines = lines_of_plan((arguments.out, *arguments.beside), plan)
        read[plan] = sorted(lines, key=lambda line: (line["missing"], STRENGTHS.index(line["strength"])))
    if arguments.store:
        store(arguments.store, read)

    def write(text: str) -> None:
        sys.stdout.write(text + "\n")

    for plan, lines in read.items():
        if lines:
            write(f"\n### {plan}\n")
            table_of_effects(lines, write)
    write("\n### in all\n")
    summary(read, write)
    if arguments.again:
        old = [line for plan in arguments.plans for line in lines_of_plan(arguments.again, plan)]
        print_changes(
            old, [line for plan in arguments.plans for line in lines_of_plan([arguments.out], plan)], write
        )


if __name__ == "__main__":
    main()
