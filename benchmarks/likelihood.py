"""`python -m benchmarks.likelihood`: the first name by likelihood alone, against that by shares of the misfit.

    python -m benchmarks.likelihood collect BATCH --out FILE
    python -m benchmarks.likelihood compare [--lead 3] [--each 1] FILE ...
    python -m benchmarks.likelihood shares FILE ...
    python -m benchmarks.likelihood tally FILE ...

`collect` writes a line for each solved case of a revealed batch of `benchmarks.concealed`: what was hidden, what was
said, and the table of the first round. `tally` counts what was said in such lines. `shares` counts, by the share of the
misfit that it explains, how often what the likelihood takes first is right: what `Rule.accept.least_share` parts.
`compare` decides from the lines, and from those of the bank that have tables, which candidate is accepted first, by two
rules:

- by shares: the rule until commit 5bf98cf, of shares of the misfit above the floor, the p-value of the score test,
  leads and distance from the noise, with nine numbers;
- by likelihood alone: the candidate with the largest gain of the log-likelihood over all recordings among those whose
  gain is more than so many standard errors, over clusters of 0.5 s, on both sets together (`--lead`), and on the
  fitted and on the held-out recordings alone (`--each`). The latter determined nothing of it (a split likelihood
  ratio). No other number enters; today's rule has these two, `Rule.accept.lead` and `lead_each`.

It prints how often the first name is right, by stratum, and where the two differ. Where one of two effects is named
first, that counts as right.
"""

import argparse
import gzip
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.concealed.seal import open_seal
from benchmarks.concealed.solve import SOLVED, VERDICT
from benchmarks.replay import lines_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import gain_of, likelier, ranked
from frictionjax.diagnosis.table import (
    ComparisonTable,
    Improvement,
    ModelComparison,
    table_of,
    whole_misfits,
    within,
)

COMPARISONS = "comparisons.json"
OUTCOMES = ("right", "class", "other", "none")
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)

# The numbers of the rule by shares, as they were.
LEAST_SHARE, LEAST_ENERGY, FAR_FROM_NOISE = 0.45, 0.8, 0.8
SIGNIFICANCE, LEAD_HOLDOUT, LEAD_BOTH, DECISIVE_SHARE = 1e-3, 2.0, 6.0, 0.6
BEHIND_BEST, ALIKE = 0.5, 0.03


class Case(NamedTuple):
    """A diagnosed case: its `name`, the `stratum` (nothing, one, two, outside), what is `missing`, the `verdict`, and
    the first `table`."""

    name: str
    stratum: str
    missing: tuple[str, ...]
    verdict: str
    table: ComparisonTable


class Choice(NamedTuple):
    """The name that is given first, and those that the recordings cannot tell from it; None where there is none."""

    name: str | None
    rivals: tuple[str, ...] = ()

    def outcome(self, missing: tuple[str, ...]) -> str:
        """One of the `OUTCOMES`."""
        if self.name is None:
            return "none"
        if self.name in missing:
            return "right"
        return "class" if set(self.rivals) & set(missing) else "other"


def by_shares(table: ComparisonTable, rule: Rule) -> Choice:
    """What shares of the misfit accept first; the `rule` says what it says in both."""

    def gains(row: ModelComparison) -> Improvement:
        return row.gains(rule)

    def clear(row: ModelComparison) -> bool:
        own = gains(row)
        leads = own.lead_holdout > LEAD_HOLDOUT and own.lead_fit + own.lead_holdout > LEAD_BOTH
        adequate = rule.limits.adequate
        wholes = whole_misfits(row.misfits_before, rule)
        left = max(w * (1.0 - s) for w, s in zip(wholes, (own.share_fit, own.share_holdout), strict=True))
        before = within(row.misfits_before, row.misfit_errors, adequate, rule)
        removes = not before[1] and (left < adequate or own.share > DECISIVE_SHARE)
        return row.p_value <= SIGNIFICANCE or leads or removes

    def acceptable(row: ModelComparison) -> bool:
        own = gains(row)
        if not own.repeats or own.lead_fit < 0.0 or not clear(row):
            return False
        far = min(row.misfits_before) > FAR_FROM_NOISE and own.energy > LEAST_ENERGY and own.share > 0.0
        return own.share > LEAST_SHARE or row.makes_credible or far

    order = ranked(table, rule)
    worth = [gains(row).worth for row in table.rows]
    most = max(worth, default=0.0)
    may = [row for row in order if worth[row] > most - BEHIND_BEST and acceptable(table.rows[row])]
    if not may:
        return Choice(None)
    alike = [row for row in may if worth[row] > worth[may[0]] - ALIKE]
    total = [row.fit.total + row.held_out.total for row in table.rows]
    return _choice(table, min(alike, key=lambda row: (table.rows[row].free, -total[row])), may, rule)


def _choice(table: ComparisonTable, best: int, able: list[int], rule: Rule) -> Choice:
    """The row `best` of the `table`, and those of the `able` that the `rule` does not tell from it."""
    name = table.rows[best].effect
    rivals = {
        table.rows[other].effect
        for other in able
        if table.rows[other].effect != name and table.lead(best, other, rule) < rule.rivals.lead
    }
    return Choice(name, tuple(sorted(rivals)))


def likely(table: ComparisonTable, rule: Rule) -> list[int]:
    """The rows of the `table` that chance does not bring, by the `rule`, the one with the largest gain of the
    log-likelihood first."""
    able = [number for number, row in enumerate(table.rows) if likelier(row, rule)]
    return sorted(able, key=lambda number: -gain_of(table.rows[number]))


def by_likelihood(table: ComparisonTable, rule: Rule) -> Choice:
    """What the likelihood accepts first of the `table`, by the `rule`."""
    able = likely(table, rule)
    return _choice(table, able[0], able, rule) if able else Choice(None)


def cases_of(lines: Iterable[dict]) -> Iterator[Case]:
    """The cases of `lines`, of the bank or collected, that have a table."""
    for line in lines:
        tables = (line.get("comparisons") or {}).get("tables")
        if not tables:
            continue
        missing = tuple(line["missing"])
        stratum = line.get("stratum") or ("nothing", "one", "two")[len(missing)]
        yield Case(line["name"], stratum, missing, line["verdict"], table_of(tables[0]))


def collected(batch: Path) -> Iterator[dict[str, Any]]:
    """A line for each solved case of a `batch`, by `benchmarks.concealed solve` or `frictionjax diagnose`. Raises
    `BrokenSeal` where the truth or a case was changed, and `FileNotFoundError` where a verdict has no comparisons."""
    truth = open_seal(batch)
    for name, own in sorted(truth["cases"].items()):
        path = batch / SOLVED / name / VERDICT
        if not path.exists():
            continue
        verdict = json.loads(path.read_text(encoding="utf-8"))
        first = _comparisons(path, verdict)[:1]
        for row in (row for table in first for row in table["rows"]):
            row |= {"gains_fit": [], "gains_held_out": []}  # by cluster: nothing here needs them
        yield {
            "name": f"{truth['seed']} {name}",
            "stratum": "one" if own["stratum"] == "confusable" else own["stratum"],
            "missing": own["missing"],
            "strength": own["strength"],
            "families": own["families"],
            "verdict": verdict["verdict"],
            "named": [missing["effect"] for missing in verdict["missing"]],
            "classes": [missing["class"] for missing in verdict["missing"]],
            "seconds": verdict["seconds"].get("total"),
            "ceiling": verdict.get("ceiling"),
            "comparisons": {"tables": first},
        }


def _comparisons(path: Path, verdict: dict[str, Any]) -> list[dict[str, Any]]:
    """The tables of a verdict, which has them itself or, from the command line, in a file beside it."""
    if verdict["verdict"] == "failed":
        return []
    stored = verdict.get("comparisons") or json.loads(path.with_name(COMPARISONS).read_text(encoding="utf-8"))
    return stored["tables"]


def _named_lines(paths: list[Path]) -> Iterator[dict]:
    for line in lines_of(paths):
        yield line if "name" in line else line | {"name": f"bank {line['seed']}"}


def compare(cases: Iterable[Case], rule: Rule) -> str:
    """The two tables in Markdown, by the `rule`."""
    counts: Counter = Counter()
    differing = []
    for case in cases:
        old, new = by_shares(case.table, rule), by_likelihood(case.table, rule)
        ends = old.outcome(case.missing), new.outcome(case.missing)
        counts.update([(case.stratum, "shares", ends[0]), (case.stratum, "likelihood", ends[1])])
        if old.name != new.name:
            hidden = ", ".join(case.missing) or "nothing"
            said = [f"{choice.name or ''} ({end})" for choice, end in zip((old, new), ends, strict=True)]
            differing.append(f"| {case.name} | {hidden} | {case.verdict} | {said[0]} | {said[1]} |")
    lines = [f"| stratum | decided by | {' | '.join(OUTCOMES)} |", "|---|---|" + "---|" * len(OUTCOMES)]
    for stratum in dict.fromkeys(key[0] for key in sorted(counts)):
        for how in ("shares", "likelihood"):
            numbers = " | ".join(str(counts[stratum, how, end]) for end in OUTCOMES)
            lines.append(f"| {stratum} | {how} | {numbers} |")
    head = [
        "",
        "| case | hidden | verdict | first name by shares | by likelihood |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *head, *differing])


def shares(cases: Iterable[Case], rule: Rule) -> str:
    """How often what the likelihood takes first is right, by the share of the misfit that it explains (the smaller of
    the fitted and the held-out recordings), by the `rule`, in Markdown."""
    counts: Counter = Counter()
    for case in cases:
        able = likely(case.table, rule)
        if able:
            share = case.table.rows[able[0]].gains(rule).share
            low = max(edge for edge in SHARES if edge <= max(share, 0.0))
            counts[low, by_likelihood(case.table, rule).outcome(case.missing)] += 1
    lines = [f"| share from | {' | '.join(OUTCOMES[:-1])} |", "|---|---|---|---|"]
    for low in SHARES:
        lines.append(f"| {low:g} | {' | '.join(str(counts[low, end]) for end in OUTCOMES[:-1])} |")
    return "\n".join(lines)


def tally(lines: Iterable[dict]) -> str:
    """What was said of collected `lines`, by family, in Markdown: nothing hidden and `adequate`; one strong or medium
    effect, its name right, in the class, another, or none; two effects, how many of them were named; physics outside
    the catalogue, `unknown`, and given a name in any case. Then the median of the seconds."""
    lines = list(lines)
    rows = [
        "| family | nothing: adequate | one: right, class, other, none | two: named | outside: unknown, with a name |"
    ]
    rows += ["|---|---|---|---|---|"]
    for family in [*sorted({line["families"] for line in lines}), "all"]:
        own = [line for line in lines if family in (line["families"], "all")]
        nothing = [line["verdict"] == "adequate" for line in own if line["stratum"] == "nothing"]
        one = [line for line in own if line["stratum"] == "one" and line["strength"] != "weak"]
        ends = Counter(_said(line).outcome(tuple(line["missing"])) for line in one)
        two = [line for line in own if line["stratum"] == "two"]
        hits = sum(len(set(line["missing"]) & set(line["named"])) for line in two)
        outside = [line for line in own if line["stratum"] == "outside"]
        unknown = sum(line["verdict"] == "unknown" for line in outside)
        named = sum(bool(line["named"]) for line in outside)
        counts = ", ".join(str(ends[end]) for end in OUTCOMES)
        rows.append(
            f"| {family} | {sum(nothing)} of {len(nothing)} | {counts} | {hits} of {2 * len(two)} | "
            f"{unknown}, {named} of {len(outside)} |"
        )
    seconds = sorted(line["seconds"] for line in lines if line.get("seconds"))
    return "\n".join([*rows, "", f"median {seconds[len(seconds) // 2]:.0f} s" if seconds else ""])


def _said(line: dict) -> Choice:
    return Choice(line["named"][0], tuple(line["classes"][0])) if line["named"] else Choice(None)


def main() -> None:
    """Run one of the verbs."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.likelihood",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    collect = verbs.add_parser("collect")
    collect.add_argument("batch", type=Path)
    collect.add_argument(
        "--out", type=Path, required=True, help="a file to write, packed where it ends in .gz"
    )
    against = verbs.add_parser("compare")
    against.add_argument("files", type=Path, nargs="+")
    accept = Rule().accept
    against.add_argument("--lead", type=float, default=accept.lead)
    against.add_argument("--each", type=float, default=accept.lead_each)
    for verb in ("shares", "tally"):
        verbs.add_parser(verb).add_argument("files", type=Path, nargs="+")
    options = parser.parse_args()
    if options.verb == "tally":
        sys.stdout.write(tally(lines_of(options.files)) + "\n")
        return
    if options.verb == "shares":
        sys.stdout.write(shares(cases_of(_named_lines(options.files)), Rule()) + "\n")
        return
    if options.verb == "compare":
        rule = Rule().changed({"accept.lead": options.lead, "accept.lead_each": options.each})
        sys.stdout.write(compare(cases_of(_named_lines(options.files)), rule) + "\n")
        return
    opened = gzip.open if options.out.suffix == ".gz" else open
    with opened(options.out, "wt", encoding="utf-8") as file:
        for line in collected(options.batch):
            file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
