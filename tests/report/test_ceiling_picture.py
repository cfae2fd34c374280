"""The picture of the ceiling: errors of both models beside the noise floor, and what a free force leaves."""

import math
import re
from dataclasses import replace

import pytest
from helpers_diagnosis import fake_diagnosis, fake_recording

from frictionjax.diagnosis.recording_fit import Horizon
from frictionjax.diagnosis.verdict import Ceiling, OneStep, Unexplained
from frictionjax.report.bars import BarGroup, Bars, bars_svg
from frictionjax.report.page import render
from frictionjax.report.sections.ceiling import CeilingsSection, bars_of

STEPS = OneStep("kept", 6.0, 2.0, 1.1)
CEILING = Ceiling(0.3, 0.1, 0.7, 0.6, 8.0, 0.025, 0.05, 0.02, "velocity", True, (STEPS,))
KEPT = replace(
    fake_recording("kept", n=400), noise_floor=1e-7, prediction_rmse_base=4e-6, prediction_rmse_extended=5e-7,
    horizons=(
        Horizon(0.0005, 7e-7, 2e-7, 1e-6), Horizon(0.1, 4e-6, 5e-7, 1e-4), Horizon(1.0, 9e-6, 3e-6, 1e-5),
        Horizon(6.0, 9e-2, 9e-2, 1e-3),
    ),
)  # fmt: skip


def _found(**changes):
    return replace(fake_diagnosis(n=400, recordings=(KEPT,)), ceiling=CEILING, **changes)


def _bars(svg):
    """Widths of the bars and their words, in the order of the picture."""
    return [
        (float(width), words)
        for width, words in re.findall(
            r'<rect class="\w+" [^>]*width="([\d.]+)"[^>]*><title>(.*?)</title>', svg
        )
    ]


def test_each_horizon_has_the_models_and_the_first_one_the_ceiling():
    drawn = bars_of(STEPS, KEPT, _found(), True)
    assert drawn.unit == "rad" and drawn.floor == 1e-7
    assert [group.title for group in drawn.groups] == [
        "one step ahead, robust rms",
        "0.1 s ahead, rms",
        "1.0 s ahead, rms (the longest that is better than standstill)",
    ]
    found = [[(css, value) for css, _, value in group.bars] for group in drawn.groups]
    assert dict(found[0]) == pytest.approx({"base": 6e-7, "extended": 2e-7, "free": 1.1e-7})
    assert found[1:] == [[("base", 4e-6), ("extended", 5e-7)], [("base", 9e-6), ("extended", 3e-6)]]
    never = replace(KEPT, horizons=KEPT.horizons[:2])
    assert len(bars_of(STEPS, never, _found(), True).groups) == 2
    alone = bars_of(STEPS, KEPT, _found(), False)
    assert [css for css, _, _ in alone.groups[0].bars] == ["base", "free"]
    assert alone.groups[0].bars[1][1] == "base model and a free force"


def test_bars_are_as_long_as_the_logarithm_and_the_text_beside_them_fits():
    svg = str(bars_svg(bars_of(STEPS, KEPT, _found(), True), "words"))
    bars = _bars(svg)
    assert bars[0][1] == "base model: 600 nrad (6.0 × floor)"
    assert bars[2][1] == "extended model and a free force: 110 nrad (1.1 × floor)"
    decade = (bars[5][0] - bars[0][0]) / math.log10(9e-6 / 6e-7)
    assert bars[3][0] - bars[4][0] == pytest.approx(decade * math.log10(8.0), abs=0.3)
    floor = float(re.search(r'<line class="floor" x1="([\d.]+)"', svg).group(1))
    left = float(re.search(r'<rect [^>]*x="(\d+)"', svg).group(1))
    assert bars[2][0] - (floor - left) == pytest.approx(decade * math.log10(1.1), abs=0.3)
    texts = re.findall(r'<text class="value" x="([\d.]+)"[^>]*>(.*?)</text>', svg)
    assert len(texts) == len(bars)
    assert all(float(x) + 6.5 * len(text) < 460.0 for x, text in texts)
    assert "error (µrad)" in svg and svg.count("<line x1") >= 2


def test_numbers_that_cannot_be_drawn_have_a_dash_and_no_bar():
    group = BarGroup(
        "one step ahead", (("base", "base model", math.inf), ("extended", "extended model", 2e-6))
    )
    bars = _bars(str(bars_svg(Bars("error", "m", (group,), 0.0), "words")))
    assert [bar[1] for bar in bars] == ["base model: –", "extended model: 2.00 µm"]
    assert bars[0][0] == 0.0 < bars[1][0]
    empty = str(
        bars_svg(Bars("error", "1", (BarGroup("none", (("base", "base model", math.nan),)),), math.nan), "w")
    )
    assert "noise floor" not in empty and ">error<" in empty


def test_the_section_says_whether_a_free_force_is_better_and_is_empty_where_none_was_tried():
    page = render(_found())
    assert "What any force could explain" in page and "extended model and a free force" in page
    assert "A force that is free in velocity predicts the held-out recordings significantly better" in page
    below = str(CeilingsSection().body(replace(_found(), ceiling=replace(CEILING, above=False))))
    assert (
        "No free force predicts the held-out recordings significantly better than the extended model" in below
    )
    for ceiling in (
        None,
        replace(CEILING, recordings=()),
        replace(CEILING, recordings=(replace(STEPS, recording="x"),)),
    ):
        assert str(CeilingsSection().body(replace(_found(), ceiling=ceiling))) == ""
    rest = Unexplained(True, 1.0, "sliding")
    nameless = replace(_found(), verdict="adequate", missing=(), unexplained=rest)
    assert "extended" not in str(CeilingsSection().body(nameless))
