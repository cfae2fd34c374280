"""`python -m benchmarks.replay [RULE.json | name=value ...] [--lines FILE ...]`: another rule on stored comparisons.

    python -m benchmarks.replay
    python -m benchmarks.replay accept.least_share=0.3 limits.one=0.2
    python -m benchmarks.replay rule.json --lines out/bank.jsonl

Decides anew, without a refit, from the tables that `benchmarks.bank` stored with its lines, and prints how often the
rule is right by plan, what it names where the true effect was left out of the catalogue, and how often it leads where
the stored search has not been. Without a rule that of today decides, and is compared with what the lines say. Numbers
that are not given keep today's values.
"""

import argparse
import gzip
import json
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from frictionjax.diagnosis.evidence.input_needed import INPUT, input_is_needed
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.search import Decision
from frictionjax.diagnosis.selection.stored_tables import NotStored, StoredTables, decide_again
from frictionjax.diagnosis.table import OtherDecision, table_of

RESULTS = Path(__file__).parent / "results"
STUDIED = "likelihood"
"""The folder of `RESULTS` whose lines are of case files, for `benchmarks.likelihood`: not of the bank."""
OUTCOMES = ("right", "class", "other name", "unknown", "adequate", "off the path", "no table")
"""The first name is right; is in the class of the first name; is another; no name. Then what could not be decided."""
UNANSWERED = (
    *("floor", "testable", "residual", "place", "limits.unmeasured"),
    *(f"credible.{name}" for name in ("energy", "lead", "loud", "least_clusters")),
)
"""Groups and numbers of the rule that act before or after what the tables hold: no table answers for them."""


class Side(NamedTuple):
    """One stored search: the `plan` of its machine, what is `missing`, what was `said` (verdict, names, classes), and
    its `comparisons` (None where the line has none)."""

    plan: str
    missing: tuple[str, ...]
    said: tuple[str, list[str], list[list[str]]]
    comparisons: dict[str, Any] | None


def lines_of(paths: Iterable[Path]) -> Iterator[dict]:
    """The lines of the files at `paths`, packed or not."""
    for path in paths:
        opened = gzip.open if path.suffix == ".gz" else open
        with opened(path, "rt", encoding="utf-8") as file:
            yield from map(json.loads, file)


def once(lines: Iterable[dict]) -> list[dict]:
    """Of the `lines` of one machine the first that has tables, or the first."""
    kept: dict[str, dict] = {}
    for line in lines:
        job = json.dumps([line["seed"], line["missing"], line["strength"]])
        if job not in kept or (_comparisons(line) and not _comparisons(kept[job])):
            kept[job] = line
    return list(kept.values())


def stored_lines() -> list[Path]:
    """The files of the lines of the bank that are kept."""
    return sorted(path for path in RESULTS.glob("*/*.jsonl*") if path.parent.name != STUDIED)


def sides_of(line: dict) -> Iterator[Side]:
    """The search of a `line`, and the one without the true effect in the catalogue, where there was one."""
    missing = tuple(line["missing"])
    outside = any(name.startswith("outside") for name in missing)
    plan = "outside" if outside else {0: "nothing missing", 1: "one effect", 2: "two effects"}[len(missing)]
    said = line["verdict"], line["named"], line["classes"]
    yield Side(plan, missing, said, _comparisons(line))
    left = line["left"]
    if left:
        names = [step["effect"] for step in left["steps"] if step["effect"]]
        classes = [list(own) for own in left.get("classes", [[name] for name in names])]
        yield Side("left out", missing, (left["verdict"], names, classes), _comparisons(left))


def _comparisons(run: dict) -> dict[str, Any] | None:
    stored = run.get("comparisons")
    return stored if stored and stored["tables"] else None


def decided(side: Side, rule: Rule) -> Decision:
    """What the `rule` makes of the stored comparisons of a `side`, and of the error without input where that is stored,
    too: where the input is not needed nothing is diagnosed. Raises `NotStored` where it leads off their path."""
    stored = side.comparisons
    if stored is None:
        raise NotStored("the line has no table")
    made_by = rule_of(stored["rule"], old=True)
    tables = [table_of(content) for content in stored["tables"]]
    others = {one["about"]: one["numbers"] for one in stored.get("decided", ())}
    if INPUT in others:
        numbers = {name: math.inf if value is None else value for name, value in others[INPUT].items()}
        if not input_is_needed(OtherDecision(INPUT, numbers), rule):
            return Decision((), "unknown", True, 1.0, ())
    elif rule.credible.driven != made_by.credible.driven:
        raise NotStored("the line has no error without input")
    return decide_again(StoredTables(tables, made_by, rule), rule, stored["rounds"])


def outcome(side: Side, decision: Decision) -> str:
    """One of the `OUTCOMES` of the `decision` on a `side`."""
    if decision.verdict != "named":
        return decision.verdict
    if decision.names[0] in side.missing:
        return "right"
    return "class" if set(side.missing) & set(decision.classes[0]) else "other name"


def rule_of(content: dict[str, Any], *, old: bool = False) -> Rule:
    """The rule with the numbers of the `content`, by group or by full name; the others are those of today. Of an `old`
    rule, those are left out that there are no more."""
    numbers = {}
    for name, value in content.items():
        own = (
            {f"{name}.{key}": number for key, number in value.items()}
            if isinstance(value, dict)
            else {name: value}
        )
        numbers |= own
    known = Rule().numbers()
    return Rule().changed({name: value for name, value in numbers.items() if name in known or not old})


class Score(NamedTuple):
    """How a rule does: `counts` of the outcomes by plan, how many searches were `alike` what the lines say of those
    that were `compared`, and the `others` in words."""

    counts: dict[str, Counter]
    alike: int
    compared: int
    others: list[str]


def score(lines: Iterable[dict], rule: Rule) -> Score:
    """Decide each of the `lines` by the `rule`."""
    counts: dict[str, Counter] = {}
    alike, compared, others = 0, 0, []
    for line in lines:
        for side in sides_of(line):
            own = counts.setdefault(side.plan, Counter())
            if side.comparisons is None:
                own["no table"] += 1
                continue
            try:
                decision = decided(side, rule)
            except NotStored:
                own["off the path"] += 1
                continue
            own[outcome(side, decision)] += 1
            compared += 1
            found = decision.verdict, list(decision.names), [list(names) for names in decision.classes]
            if found == side.said:
                alike += 1
            else:
                what = ",".join(side.missing) or "nothing"
                others.append(
                    f"{side.plan}, {what} ({line['seed']}): {_words(found)}, was {_words(side.said)}"
                )
    return Score(counts, alike, compared, others)


def _words(said: tuple[str, list[str], list[list[str]]]) -> str:
    verdict, _, classes = said
    return f"{verdict} {' and '.join('/'.join(names) for names in classes)}".strip()


def read_rule(texts: list[str]) -> Rule:
    """The rule of the command line: files of JSON, and `name=value`, one after the other in these `texts`."""
    numbers: dict[str, float] = {}
    for text in texts:
        if "=" in text:
            name, _, value = text.partition("=")
            numbers[name] = float(value)
        else:
            numbers |= rule_of(json.loads(Path(text).read_text(encoding="utf-8"))).numbers()
    return Rule().changed(numbers)


def main() -> None:
    """Decide and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rule", nargs="*", help="a file of JSON, or name=value as in accept.least_share=0.3")
    parser.add_argument(
        "--lines", nargs="+", type=Path, help="files of `benchmarks.bank` (.jsonl, .jsonl.gz)"
    )
    arguments = parser.parse_args()
    paths = arguments.lines or stored_lines()
    rule = read_rule(arguments.rule)
    today = Rule().numbers()
    changed = {name: value for name, value in rule.numbers().items() if value != today[name]}
    unanswered = [name for name in changed if name in UNANSWERED or name.split(".")[0] in UNANSWERED]
    if unanswered:
        parser.error(
            f"{', '.join(unanswered)}: stored tables hold nothing that depends on it. Diagnose anew."
        )
    found = score(once(lines_of(paths)), rule)
    sys.stdout.write(f"rule: {changed or 'of today'}\n\n| plan | {' | '.join(OUTCOMES)} |\n")
    sys.stdout.write("|---" * (len(OUTCOMES) + 1) + "|\n")
    for plan, counts in sorted(found.counts.items()):
        sys.stdout.write(f"| {plan} | {' | '.join(str(counts[one]) for one in OUTCOMES)} |\n")
    sys.stdout.write(f"\nAs the lines say: {found.alike} of {found.compared}.\n")
    for text in found.others:
        sys.stdout.write(f"- {text}\n")
    if not changed and found.alike < found.compared:
        sys.exit("The rule of today does not reproduce what the lines say.")


if __name__ == "__main__":
    main()
