"""The pictures of the report: each takes scores or answers and returns a matplotlib Figure, or None without data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from benchmarks.concealed.answers import Answer
from benchmarks.concealed.intervals import share
from benchmarks.concealed.scores import METHODS, STRENGTHS

INK, GREY, BASE, GOOD = "#1a1a1a", "#8a8a8a", "#c0504d", "#1f6f8b"
_LABELS = {"base": "base", "extended": "named", "free_form": "free form", "oracle": "oracle"}


def _sheet(width: float, height: float, columns: int = 1):
    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _words(name: str) -> str:
    return name.replace("outside:", "").replace("_", " ")


def hero_of(answers: Sequence[Answer]) -> Answer | None:
    """The case for the hero figure, chosen by rule: named right, whose base model was nearest to the noise among those
    with at least nine tenths of the error recovered (all named right if there is none)."""
    right = [a for a in answers if a.right and a.verdict.get("trace") and a.held_out("base") is not None]
    clean = [a for a in right if (a.recovery or 0.0) > 0.9]
    return min(clean or right, key=lambda a: a.held_out("base") or np.inf, default=None)


def hero(answer: Answer | None) -> Figure | None:
    """One case: fine by eye; where the excess is; the error before and after on a held-out recording."""
    if answer is None:
        return None
    figure, (eye, places, after) = _sheet(13, 3.8, 3)
    trace = {
        key: value if key == "recording" else np.asarray(value, float)  # None becomes NaN
        for key, value in answer.verdict["trace"].items()
    }
    eye.plot(trace["t"], trace["x"], color=INK, lw=1.6, label="measured")
    eye.plot(
        trace["t"], trace["predicted_base"], color=BASE, lw=0.9, ls="--", label="base model, 0.1 s ahead"
    )
    unit = answer.verdict.get("units", {}).get("position", "position units")
    eye.set(
        xlabel="time, s",
        ylabel=f"position, {unit}",
        title=f"{answer.name}: fine by eye ({trace['recording']})",
    )
    eye.legend(frameon=False, fontsize=8)
    cells = [c for c in answer.verdict["mismatch"] if c["axis"] == "regime"]
    places.barh([c["bin"].split(" (")[0] for c in cells], [100 * c["share"] for c in cells], color=GOOD)
    places.set(xlabel="share of the excess, %", title="the map")
    after.semilogy(trace["stretch"], trace["error_base"], color=BASE, label="base model")
    after.semilogy(trace["stretch"], trace["error_extended"], color=GOOD, label="with what was named")
    after.axhline(1.0, color=GREY, lw=0.8, ls=":")
    truth = " + ".join(_words(name) for name in answer.truth["missing"])
    named = " + ".join(_words(name) for name in answer.named)
    after.set(xlabel="time, s", ylabel="error / noise")
    after.set_title(f"named: {named}\nunsealed: {truth}", fontsize=9)
    after.legend(frameon=False, fontsize=8)
    return figure


def confusion(scores: dict) -> Figure | None:
    """What was said for what was concealed, beside the overlap of the effects' columns, which predicts it."""
    found, overlap = scores["confusion"], scores["overlap"]
    if not found["rows"]:
        return None
    figure, (left, right) = _sheet(15, 1.6 + 0.24 * max(len(found["rows"]), len(overlap["names"]), 4), 2)
    counts = np.array(found["counts"], float)
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    pairs = [
        (left, shares, found["rows"], found["columns"], "measured: what was said, share of the cases"),
        (
            right,
            np.array(overlap["cosines"]),
            overlap["names"],
            overlap["names"],
            "predicted: |cosine|, base projected out",
        ),
    ]
    for ax, values, rows, columns, title in pairs:
        if not len(rows):
            ax.text(0.5, 0.5, "not computed: solve with --rivals", ha="center", transform=ax.transAxes)
            continue
        image = ax.imshow(values, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        ax.set_yticks(range(len(rows)), [_words(r) for r in rows], fontsize=7)
        ax.set_xticks(range(len(columns)), [_words(c) for c in columns], rotation=90, fontsize=7)
        ax.set_title(title, fontsize=10)
        figure.colorbar(image, ax=ax, shrink=0.6)
    return figure


def power(answers: Sequence[Answer]) -> Figure | None:
    """Noticed and named right within class, by strength, with 95 % intervals; false alarms at strength zero."""
    figure, (ax,) = _sheet(6, 3.8)
    nothing = [a for a in answers if a.stratum == "nothing"]
    places = ["nothing", *reversed(STRENGTHS)]
    lines = {
        "noticed (not adequate)": (BASE, lambda a: a.verdict["verdict"] in ("named", "unknown")),
        "right within class": (GOOD, lambda a: a.right_within_class),
    }
    drawn = False
    for number, (label, (colour, hit)) in enumerate(lines.items()):
        for place, strength in enumerate(places):
            some = (
                nothing
                if strength == "nothing"
                else [
                    a
                    for a in answers
                    if a.stratum in ("one", "confusable") and a.truth["strength"] == strength
                ]
            )
            if not some or (strength == "nothing" and number == 1):
                continue
            s = share([bool(hit(a)) for a in some])
            x = place + 0.1 * (number - 0.5)
            ax.errorbar(
                x,
                s["value"],
                [[s["value"] - s["low"]], [s["high"] - s["value"]]],
                color=colour,
                fmt="o",
                capsize=3,
                label=label,
            )
            label, drawn = "_", True
    ax.set_xticks(range(len(places)), places)
    ax.set(
        ylim=(-0.03, 1.03),
        xlabel="strength of the effect",
        ylabel="share of cases",
        title="power against strength",
    )
    ax.legend(frameon=False, fontsize=8)
    return figure if drawn else None


def held_out(answers: Sequence[Answer]) -> Figure | None:
    """Held-out error over the noise of every case, by method."""
    some = [a for a in answers if a.stratum in ("one", "two", "confusable", "outside")]
    figure, (ax,) = _sheet(6, 3.8)
    rng = np.random.default_rng(0)
    drawn = False
    # An oracle's observer may run away; it must not press all others into a line.
    plain = [v for a in some for m in METHODS if m != "oracle" and (v := a.held_out(m)) is not None]
    top = 30.0 * max(plain, default=1.0)
    for place, method in enumerate(METHODS):
        for strata, colour in (("one two confusable", GOOD), ("outside", BASE)):
            values = [
                v for a in some if a.stratum in strata.split() and (v := a.held_out(method)) is not None
            ]
            if values:
                across, shown = place + 0.25 * (rng.random(len(values)) - 0.5), np.minimum(values, top)
                for marker, these in (("o", shown < top), ("^", shown == top)):
                    ax.semilogy(across[these], shown[these], marker, ms=4, alpha=0.6, color=colour)
                ax.hlines(np.median(values), place - 0.25, place + 0.25, color=colour, lw=2)
                drawn = True
    ax.axhline(1.0, color=GREY, lw=0.8, ls=":")
    ax.set_xticks(range(len(METHODS)), [_LABELS[m] for m in METHODS])
    ax.set(
        ylabel="error 0.1 s ahead / noise",
        title="held-out recordings (blue: in the catalogue, red: outside; bar: median; triangle: beyond)",
    )
    ax.title.set_fontsize(8)
    return figure if drawn else None


def reliability(scores: dict) -> Figure | None:
    """How often the first name is right, against the confidence it was given; p-values under nothing hidden."""
    curve, values = scores["calibration"]["curve"], scores["null_p_values"]["values"]
    if not curve and not values:
        return None
    figure, (left, right) = _sheet(9.5, 4, 2)
    for ax in (left, right):
        ax.plot([0, 1], [0, 1], color=GREY, lw=0.8, ls=":")
    if curve:
        x, y = [c["confidence"] for c in curve], np.array([c["value"] for c in curve])
        bars = [y - [c["low"] for c in curve], [c["high"] for c in curve] - y]
        left.errorbar(x, y, bars, fmt="o-", color=GOOD, capsize=3)
    left.set(xlim=(0, 1), ylim=(0, 1), xlabel="confidence", ylabel="share named right", title="reliability")
    if values:
        right.plot((np.arange(len(values)) + 0.5) / len(values), values, ".", color=BASE, ms=4)
    right.set(xlim=(0, 1), ylim=(0, 1), xlabel="expected", ylabel="p-value", title="p-values, nothing hidden")
    return figure


def cannot_tell(scores: dict) -> Figure | None:
    """The smallest sizes that show, by effect: median and the middle 90 % of the cases."""
    found = scores["detectable"]
    if not found:
        return None
    figure, (ax,) = _sheet(8, 0.8 + 0.2 * len(found))
    for place, value in enumerate(found.values()):
        ax.plot([value["low"], value["high"]], [place, place], color=GREY, lw=1.2)
        ax.plot(value["median"], place, "o", color=GOOD, ms=4)
    ax.set_yticks(range(len(found)), [_words(name) for name in found], fontsize=7)
    ax.invert_yaxis()
    ax.set(
        xscale="log",
        xlabel="smallest size that shows, in the unit beside the name",
        title="what it cannot tell",
    )
    return figure


def figures(answers: Sequence[Answer], scores: dict) -> dict[str, Figure]:
    """Name -> figure, those that have data."""
    found = {
        "hero": hero(hero_of(answers)),
        "confusion": confusion(scores),
        "power": power(answers),
        "held_out": held_out(answers),
        "reliability": reliability(scores),
        "cannot_tell": cannot_tell(scores),
    }
    return {name: figure for name, figure in found.items() if figure is not None}
