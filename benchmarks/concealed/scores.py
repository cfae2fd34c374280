"""Scores of a revealed batch, each with a 95 % interval; plain dicts, ready for JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.concealed.answers import Answer
from benchmarks.concealed.intervals import bootstrapped, median, share

STRENGTHS = ("strong", "medium", "weak")
METHODS = ("base", "extended", "free_form", "oracle")
RIVALS = ("largest_r2", "bic", "sparse")
GOALS = {
    "right_within_class": 0.95,
    "false_alarms": 0.02,
    "outside_flagged": 0.90,
    "outside_named": 0.05,
    "two_f1": 0.85,
    "recovery": 0.95,
    "coverage": (0.90, 0.98),
    "seconds": 60.0,
}
"""What the batch is to reach; the table sets it beside what was reached."""


def _of(answers: Iterable[Answer], *strata: str, strengths: Sequence[str] = STRENGTHS) -> list[Answer]:
    return [a for a in answers if a.stratum in strata and a.truth["strength"] in strengths]


def naming(answers: Sequence[Answer]) -> dict:
    """Named right, top-1 and within the stated class, by strength and by effect (single and confusable effects)."""
    some = _of(answers, "one", "confusable")
    by_strength = {
        strength: {
            "top_1": share([a.right for a in own]),
            "within_class": share([a.right_within_class for a in own]),
            "wrong": share([a.outcome == "wrong" for a in own]),
        }
        for strength in STRENGTHS
        if (own := [a for a in some if a.truth["strength"] == strength])
    }
    effects = sorted({a.truth["missing"][0] for a in some})
    by_effect = {
        effect: {
            strength: [a.outcome for a in own]
            for strength in STRENGTHS
            if (
                own := [a for a in some if a.truth["missing"] == [effect] and a.truth["strength"] == strength]
            )
        }
        for effect in effects
    }
    seen = [a for a in some if a.truth["strength"] != "weak"]
    return {
        "strong_and_medium": share([a.right_within_class for a in seen]),
        "strong_and_medium_top_1": share([a.right for a in seen]),
        "confusable": share([a.right_within_class for a in _of(answers, "confusable")]),
        "by_strength": by_strength,
        "by_effect": by_effect,
    }


def by_family(answers: Sequence[Answer]) -> dict[str, dict]:
    """The scores that matter most for each family of experiments, in the order of their names."""
    table = {}
    for family in sorted({a.truth["families"] for a in answers}):
        own = [a for a in answers if a.truth["families"] == family]
        strong = [a for a in own if a.truth["missing"] and a.truth["strength"] == "strong"]
        seen = _of(own, "one", "confusable", strengths=("strong", "medium"))
        seconds = [a.verdict["seconds"]["wall"] for a in own]
        table[family] = {
            "cases": len(own),
            "within_class": share([a.right_within_class for a in seen]),
            "wrong": share([a.outcome == "wrong" for a in own]),
            "strong_adequate": share([a.verdict["verdict"] == "adequate" for a in strong]),
            "false_alarms": share([a.verdict["verdict"] != "adequate" for a in _of(own, "nothing")]),
            "outside_flagged": share([a.verdict["verdict"] == "unknown" for a in _of(own, "outside")]),
            "two_f1": bootstrapped(_of(own, "two"), f1),
            "seconds": median(seconds) | {"largest": max(seconds)},
        }
    return table


def alarms(answers: Sequence[Answer]) -> dict:
    """Nothing hidden: any verdict but adequate, and a name given. Outside the catalogue: noticed, flagged, named."""
    nothing, outside = _of(answers, "nothing"), _of(answers, "outside")
    return {
        "false_alarms": share([a.verdict["verdict"] != "adequate" for a in nothing]),
        "false_names": share([bool(a.named) for a in nothing]),
        "outside_noticed": share([a.verdict["verdict"] in ("unknown", "named") for a in outside]),
        "outside_flagged": share([a.verdict["verdict"] == "unknown" for a in outside]),
        "outside_named": share([bool(a.named) for a in outside]),
        "outside_by_kind": {
            f"{a.truth['missing'][0]} ({a.truth['strength']}, {a.name})": a.outcome for a in outside
        },
    }


def f1(answers: Sequence[Answer]) -> float:
    """F1 of all names over all answers together: 2 hits / (concealed + named); NaN where there are none."""
    hits = sum(len(set(a.truth["missing"]) & set(a.named)) for a in answers)
    total = sum(len(a.truth["missing"]) + len(set(a.named)) for a in answers)
    return 2 * hits / total if total else float("nan")


def sizes(answers: Sequence[Answer]) -> dict:
    """Relative error of the sizes that compare, and how often the 95 % interval holds the truth."""
    errors = [e for a in _of(answers, "one", "confusable") if (e := a.size_error) is not None]
    inside = [bool(e[1] < 1.96) for e in errors if np.isfinite(e[1])]
    return {"error": median([e[0] for e in errors]), "coverage": share(inside)}


def localisation(answers: Sequence[Answer]) -> dict:
    """Whether the map's first regime is the one with most of the energy, and how much of it that regime holds."""
    found = [f for a in answers if a.stratum != "nothing" and (f := a.located) is not None]
    return {"top_bin": share([hit for hit, _ in found]), "energy_in_it": median([part for _, part in found])}


def held_out(answers: Sequence[Answer]) -> dict:
    """Held-out error over the noise by method, where an effect of the catalogue is concealed; and the recovery."""
    some = _of(answers, "one", "two", "confusable")
    errors = {m: median([v for a in some if (v := a.held_out(m)) is not None]) for m in METHODS}
    recovered = {
        "all": median([r for a in some if (r := a.recovery) is not None]),
        "named right": median([r for a in some if a.right_within_class and (r := a.recovery) is not None]),
    }
    return {"error": errors, "recovery": recovered}


def calibration(answers: Sequence[Answer], bins: int = 5) -> dict:
    """Reliability of the confidence of first names (equal counts a bin), and the mean square error (Brier)."""
    pairs = sorted((a.verdict["missing"][0]["confidence"], a.right) for a in answers if a.named)
    groups = (
        [list(g) for g in np.array_split(np.arange(len(pairs)), min(bins, len(pairs))) if len(g)]
        if pairs
        else []
    )
    curve = [
        {"confidence": float(np.mean([pairs[i][0] for i in g])), **share([pairs[i][1] for i in g])}
        for g in groups
    ]
    brier = bootstrapped(pairs, lambda some: float(np.mean([(c - r) ** 2 for c, r in some])))
    return {"curve": curve, "brier": brier}


def null_p_values(answers: Sequence[Answer]) -> dict:
    """p-values of every tested effect under nothing hidden, sorted, and how many cases have one below 0.001 even when
    multiplied by the number of effects."""
    nothing = _of(answers, "nothing")
    values, smallest = [], []
    for a in nothing:
        own = [
            c["p_value"] for c in a.verdict.get("candidates", []) if c["tested"] and c["p_value"] is not None
        ]
        values += own
        if own:
            smallest.append(min(1.0, min(own) * len(own)))
    return {"values": sorted(values), "below_0.001": share([p < 1e-3 for p in smallest])}


def rivals(answers: Sequence[Answer]) -> dict:
    """The rivals' first names: right on strong and medium effects, given to nothing hidden, and to the outside."""
    table = {}
    for rival in RIVALS:
        asked = [a for a in answers if "named" in a.rivals.get(rival, {})]
        if not asked:
            continue
        said = {a.name: a.rivals[rival]["named"] for a in asked}
        seen = _of(asked, "one", "confusable", strengths=("strong", "medium"))
        table[rival] = {
            "right": share([said[a.name] in a.truth["missing"] for a in seen]),
            "false_names": share([bool(said[a.name]) for a in _of(asked, "nothing")]),
            "outside_named": share([bool(said[a.name]) for a in _of(asked, "outside")]),
            "seconds": median([a.rivals[rival]["seconds"] for a in asked]),
        }
    return table


def confusion(answers: Sequence[Answer]) -> dict:
    """Counts of what was said (columns) for what was concealed (rows), single effects."""
    some = _of(answers, "one", "confusable")
    rows = sorted({a.truth["missing"][0] for a in some})
    said = {a.name: a.named[0] if a.named else a.verdict["verdict"] for a in some}
    words = sorted(set(said.values()) - set(rows) - {"adequate", "unknown", "failed"})
    columns = rows + words + ["unknown", "adequate"]
    counts = np.zeros((len(rows), len(columns)), int)
    for a in some:
        if said[a.name] in columns:
            counts[rows.index(a.truth["missing"][0]), columns.index(said[a.name])] += 1
    return {"rows": rows, "columns": columns, "counts": counts.tolist()}


def overlap(answers: Sequence[Answer]) -> dict:
    """Mean absolute cosine of the effects' columns over all cases that have both, base parameters projected out."""
    found = [a.rivals["geometry"] for a in answers if a.rivals.get("geometry", {}).get("names")]
    names = sorted({name for g in found for name in g["names"]})
    total, count = np.zeros((len(names), len(names))), np.zeros((len(names), len(names)))
    for g in found:
        at = np.ix_([names.index(n) for n in g["names"]], [names.index(n) for n in g["names"]])
        total[at] += np.asarray(g["cosines"])
        count[at] += 1.0
    return {"names": names, "cosines": np.round(total / np.maximum(count, 1.0), 3).tolist()}


_NOTHING = 1e-12  # below this an effect left no trace at all in the recordings, and its size says nothing


def _without_units(value: float, unit: str, verdict: dict) -> tuple[float, str] | None:
    """A size in units of the machine (Coulomb friction, break-away deflection), of 1 or of s; None for others."""
    base = {k: p["value"] for k, p in verdict["base"]["parameters"].items()}
    if unit in ("1", "s"):
        return value, unit
    if unit == verdict["units"]["force"]:
        return value / base["Fc"], "Fc"
    if unit == verdict["units"]["position"]:
        return value * base["sigma0"] / base["Fs"], "Fs/sigma0"
    return None


def detectable(answers: Sequence[Answer]) -> dict:
    """Minimum detectable sizes as the verdicts state them, over all cases, in units of the machine: median, 5 and 95 %
    quantile of each "effect: parameter, unit"."""
    found: dict[str, list[float]] = {}
    for a in answers:
        for c in a.verdict.get("candidates", []):
            for name, value in c["minimum_detectable"].items():
                size = _without_units(value, c["units"].get(name, ""), a.verdict) if value else None
                if size is not None and size[0] > _NOTHING:
                    found.setdefault(f"{c['effect']}: {name}, {size[1]}", []).append(size[0])
    return {
        name: dict(zip(("low", "median", "high"), map(float, np.quantile(v, [0.05, 0.5, 0.95])), strict=True))
        | {"cases": len(v)}
        for name, v in sorted(found.items())
    }


def stated_together(answers: Sequence[Answer]) -> dict[str, int]:
    """Names that verdicts could not tell apart, and in how many cases."""
    classes = (tuple(sorted(m["class"])) for a in answers for m in a.verdict["missing"])
    return dict(Counter(", ".join(names) for names in classes if len(names) > 1).most_common())


def scores(answers: Sequence[Answer]) -> dict:
    """Everything."""
    two = _of(answers, "two")
    seconds = [a.verdict["seconds"]["wall"] for a in answers]
    return {
        "cases": len(answers),
        "failed": sum(a.verdict["verdict"] == "failed" for a in answers),
        "naming": naming(answers),
        "by_family": by_family(answers),
        "alarms": alarms(answers),
        "two_f1": bootstrapped(two, f1),
        "sizes": sizes(answers),
        "localisation": localisation(answers),
        "held_out": held_out(answers),
        "calibration": calibration(answers),
        "null_p_values": null_p_values(answers),
        "rivals": rivals(answers),
        "confusion": confusion(answers),
        "overlap": overlap(answers),
        "detectable": detectable(answers),
        "stated_together": stated_together(answers),
        "seconds": median(seconds) | {"largest": max(seconds, default=None)},
    }
