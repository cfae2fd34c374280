"""The scores as Markdown."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.concealed.scores import GOALS, METHODS, STRENGTHS


def _percent(score: dict) -> str:
    if score["value"] is None:
        return "no case"
    text = f"{100 * score['value']:.0f} % ({100 * score['low']:.0f} to {100 * score['high']:.0f})"
    return f"{text}, {score['hits']} of {score['of']}" if "hits" in score else text


def _number(score: dict, digits: int = 2) -> str:
    if score["value"] is None:
        return "no case"
    return f"{score['value']:.{digits}f} ({score['low']:.{digits}f} to {score['high']:.{digits}f}), {score['of']} cases"


def summary(scores: dict) -> str:
    """Goal by goal: what was reached, with 95 % intervals."""
    alarms, naming, sizes = scores["alarms"], scores["naming"], scores["sizes"]
    low, high = GOALS["coverage"]
    rows = [
        (
            "named right within class (strong, medium)",
            _percent(naming["strong_and_medium"]),
            f"{100 * GOALS['right_within_class']:.0f} %",
        ),
        ("named right, first name", _percent(naming["strong_and_medium_top_1"]), ""),
        ("easily confused pairs, within class", _percent(naming["confusable"]), ""),
        (
            "false alarms, nothing hidden",
            _percent(alarms["false_alarms"]),
            f"at most {100 * GOALS['false_alarms']:.0f} %",
        ),
        ("names given to nothing hidden", _percent(alarms["false_names"]), ""),
        ("outside the catalogue: noticed", _percent(alarms["outside_noticed"]), ""),
        (
            "outside the catalogue: flagged unknown",
            _percent(alarms["outside_flagged"]),
            f"{100 * GOALS['outside_flagged']:.0f} %",
        ),
        (
            "outside the catalogue: named wrongly",
            _percent(alarms["outside_named"]),
            f"at most {100 * GOALS['outside_named']:.0f} %",
        ),
        ("two effects, F1", _number(scores["two_f1"]), f"{GOALS['two_f1']:.2f}"),
        (
            "held-out recovery, median",
            _number(scores["held_out"]["recovery"]["all"]),
            f"{GOALS['recovery']:.2f}",
        ),
        ("held-out recovery, named right", _number(scores["held_out"]["recovery"]["named right"]), ""),
        ("size error, median", _number(sizes["error"], 4), ""),
        ("size in its 95 % interval", _percent(sizes["coverage"]), f"{100 * low:.0f} to {100 * high:.0f} %"),
        ("map's first regime holds most of the energy", _percent(scores["localisation"]["top_bin"]), ""),
        ("energy in the map's first regime, median", _number(scores["localisation"]["energy_in_it"]), ""),
        ("Brier score of the confidence", _number(scores["calibration"]["brier"], 3), ""),
        (
            "nothing hidden: some p below 0.001 (Bonferroni)",
            _percent(scores["null_p_values"]["below_0.001"]),
            "",
        ),
        ("seconds a case, median", _number(scores["seconds"], 0), f"{GOALS['seconds']:.0f}"),
    ]
    return _table(("measured on " + f"{scores['cases']} cases", "reached (95 % interval)", "goal"), rows)


def by_strength(scores: dict) -> str:
    """Single effects by strength."""
    rows = [
        (s, _percent(own["top_1"]), _percent(own["within_class"]), _percent(own["wrong"]))
        for s, own in scores["naming"]["by_strength"].items()
    ]
    return _table(("strength", "first name right", "within class", "wrong name"), rows)


def by_family(scores: dict) -> str:
    """A row for each family of experiments."""
    rows = [
        (
            family,
            str(own["cases"]),
            _percent(own["within_class"]),
            _percent(own["wrong"]),
            _percent(own["strong_adequate"]),
            _percent(own["false_alarms"]),
            _percent(own["outside_flagged"]),
            _number(own["two_f1"]),
            _number(own["seconds"], 0),
        )
        for family, own in scores["by_family"].items()
    ]
    head = (
        "family",
        "cases",
        "within class (strong, medium)",
        "wrong names",
        "adequate with something strong hidden",
        "false alarms, nothing hidden",
        "outside: flagged unknown",
        "two effects, F1",
        "s a case, median",
    )
    return _table(head, rows)


def by_effect(scores: dict) -> str:
    """Outcomes of each effect by strength."""
    rows = [
        (
            effect,
            *(", ".join(f"{n} {word}" for word, n in Counter(own.get(s, [])).items()) for s in STRENGTHS),
        )
        for effect, own in scores["naming"]["by_effect"].items()
    ]
    rows += [(kind, outcome, "", "") for kind, outcome in scores["alarms"]["outside_by_kind"].items()]
    return _table(("effect", *STRENGTHS), rows)


def methods(scores: dict) -> str:
    """Held-out error over the noise by method."""
    rows = [
        (m.replace("extended", "named").replace("_", " "), _number(scores["held_out"]["error"][m]))
        for m in METHODS
    ]
    return _table(("method", "held-out error over the noise, median"), rows)


def rivals(scores: dict) -> str:
    """The rivals under the same seal."""
    naming, alarms = scores["naming"], scores["alarms"]
    own = (
        "diagnose",
        naming["strong_and_medium_top_1"],
        alarms["false_names"],
        alarms["outside_named"],
        scores["seconds"],
    )
    rows = [
        (name, _percent(right), _percent(false), _percent(outside), _number(seconds, 0))
        for name, right, false, outside, seconds in [
            own,
            *(
                (n, r["right"], r["false_names"], r["outside_named"], r["seconds"])
                for n, r in scores["rivals"].items()
            ),
        ]
    ]
    return _table(
        (
            "who",
            "first name right (strong, medium)",
            "names given to nothing",
            "names given to the outside",
            "s a case",
        ),
        rows,
    )


def detectable(scores: dict) -> str:
    """Below these sizes an effect does not show, as the verdicts state it."""
    rows = [
        (name, f"{v['median']:.2g}", f"{v['low']:.2g} to {v['high']:.2g}", str(v["cases"]))
        for name, v in scores["detectable"].items()
    ]
    return _table(
        ("effect: parameter, unit", "smallest that shows, median", "90 % of the cases", "cases"), rows
    )


def together(scores: dict) -> str:
    """Names that were given together."""
    return _table(("one class", "cases"), [(k, str(n)) for k, n in scores["stated_together"].items()])


def kept() -> list[dict]:
    """The results of all revealed batches, in the order of their seeds, smaller ones included."""
    folder = Path(__file__).parent / "results"
    files = [*folder.glob("*.json"), *folder.glob("smaller/*.json")]
    return [
        json.loads(file.read_text(encoding="utf-8")) for file in sorted(files, key=lambda file: file.stem)
    ]


def series(results: Sequence[dict]) -> str:
    """A row for each batch of `results`, as `reveal` writes them."""
    head = (
        "seed",
        "cases",
        "commit",
        "right within class (strong, medium)",
        "false alarms",
        "outside: flagged unknown",
        "outside: named wrongly",
        "two effects, F1",
        "held-out recovery, median",
        "size in its 95 % interval",
        "s a case, median",
    )
    rows = []
    for result in results:
        scores = result["scores"]
        alarms = scores["alarms"]
        rows.append(
            (
                str(result["seed"]),
                str(scores["cases"]),
                result["solver"]["commit"][:7],
                _percent(scores["naming"]["strong_and_medium"]),
                _percent(alarms["false_alarms"]),
                _percent(alarms["outside_flagged"]),
                _percent(alarms["outside_named"]),
                _number(scores["two_f1"]),
                _number(scores["held_out"]["recovery"]["all"]),
                _percent(scores["sizes"]["coverage"]),
                _number(scores["seconds"], 0),
            )
        )
    return _table(head, rows)


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


TABLES: dict[str, Callable[[dict], str]] = {
    "What was reached": summary,
    "By strength": by_strength,
    "By family of experiments": by_family,
    "By effect": by_effect,
    "Held-out error by method": methods,
    "Rivals under the same seal": rivals,
    "What it cannot tell apart": together,
    "What it cannot tell: smallest sizes that show": detectable,
}
"""Heading -> table."""
