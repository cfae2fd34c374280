"""Charts: points where the numbers are, ticks that are round, gaps where nothing was measured."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from frictionjax.report.chart import COLUMNS, ROWS, Chart, Panel, Series, svg, ticks

T = np.linspace(0.0, 2.0, 5)


def _drawn(*series, limits=(-1.0, 1.0), **how):
    panel = Panel("force", "N", series, limits, 130)
    return ElementTree.fromstring(svg(Chart("time", "s", (panel,), (0.0, 2.0), **how), "a & b"))


def _points(path):
    """The points of path data, as the page's script reads them."""
    found = []
    for part in path.get("d").split("M")[1:]:
        numbers = [int(word) for word in re.findall(r"-?\d+", part.replace("h0", ""))]
        points = np.cumsum(np.reshape(numbers, (-1, 2)), axis=0)
        found.append(points)
    return found


def _paths(chart):
    return [one for one in chart.iter() if one.tag.endswith("path") and one.get("data-label")]


def test_points_lie_where_the_numbers_are():
    (path,) = _paths(_drawn(Series("y", "base", T, np.array([-1.0, 0.0, 1.0, 0.5, -0.5]))))
    (points,) = _points(path)
    np.testing.assert_array_equal(points[:, 0], COLUMNS * T / 2.0)
    np.testing.assert_array_equal(points[:, 1], ROWS * np.array([1.0, 0.5, 0.0, 0.25, 0.75]))


def test_what_is_not_finite_is_a_gap():
    (path,) = _paths(_drawn(Series("y", "base", T, np.array([0.0, 0.5, np.nan, 0.5, np.inf]))))
    # A sample alone is a line of no length, which round ends make a dot.
    assert [part.tolist() for part in _points(path)][1] == [[3 * COLUMNS // 4, ROWS // 4]] * 2
    assert len(_points(path)) == 2
    (none,) = _paths(_drawn(Series("y", "base", T, np.full(5, np.nan), np.full(5, np.nan))))
    assert none.get("d") == ""


def test_dots_bands_and_decades():
    low = np.full(5, -0.5)
    dots, band = _paths(
        _drawn(Series("d", "measured", T, 0.1 * T, style="dots"), Series("b", "band", T, -low, low))
    )
    assert [len(part) for part in _points(dots)] == [1] * 5
    assert band.get("d").endswith("z")
    assert {row for _, row in _points(band)[0].tolist()} == {ROWS // 4, 3 * ROWS // 4}
    panel = Panel("force", "N", (Series("y", "base", np.array([0.01, 0.1, 1.0]), np.zeros(3)),), (-1.0, 1.0))
    decades = ElementTree.fromstring(
        svg(Chart("speed", "m/s", (panel,), (0.01, 1.0), logarithmic=True), "words")
    )
    (path,) = _paths(decades)
    np.testing.assert_array_equal(_points(path)[0][:, 0], [0, COLUMNS // 2, COLUMNS])
    words = [one.text for one in decades.iter() if one.tag.endswith("text")]
    assert {"0.01", "0.1", "1", "speed (m/s)", "force (N)"} <= set(words)


def test_a_long_series_keeps_its_extremes_in_few_points():
    y = np.zeros(30_000)
    y[12_345], y[20_000] = 0.9, -0.9
    (path,) = _paths(_drawn(Series("y", "base", np.linspace(0.0, 2.0, y.size), y)))
    rows = _points(path)[0][:, 1]
    assert rows.size < 1000
    assert (rows.min(), rows.max()) == (ROWS // 20, ROWS - ROWS // 20)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.0, 1.0, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (-520.0, 610.0, ["−500", "−250", "0", "250", "500"]),
        (4.96, 5.29, ["5.0", "5.1", "5.2"]),
        (0.0, 5e-7, ["0", "10⁻⁷", "2×10⁻⁷", "3×10⁻⁷", "4×10⁻⁷", "5×10⁻⁷"]),
    ],
)
def test_ticks_are_round(low, high, words):
    found = ticks(low, high, 5)
    assert [word for _, word in found] == words
    assert all(low <= at <= high * (1 + 1e-9) for at, _ in found)


def test_the_close_up_is_tinted_and_words_are_escaped():
    chart = _drawn(Series("<y>", "base", T, 0.1 * T), tinted=(0.5, 1.0))
    (box,) = [one for one in chart.iter() if one.get("class") == "tinted"]
    assert (float(box.get("x")), float(box.get("width"))) == (COLUMNS / 4, COLUMNS / 4)
    assert chart.get("aria-label") == "a & b"
    assert _paths(chart)[0].get("data-label") == "<y>"
