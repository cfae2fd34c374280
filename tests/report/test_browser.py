"""The report in a browser: nothing overflows, nothing is cut, its script works; on a screen, a telephone, and paper."""

import json
import re
import shutil
import subprocess
from collections import defaultdict
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import NamedTuple

import pypdf
import pytest
from helpers_diagnosis import fake_diagnosis

from frictionjax.diagnosis.verdict import Ceiling, OneStep
from frictionjax.physics import catalogue
from frictionjax.recordings import Plant
from frictionjax.report.page import render

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
MEASURED, MARKED = (
    (Path(__file__).parent / name).read_text(encoding="utf-8") for name in ("measure_page.js", "mark_page.js")
)
MARGIN = 14.0 / 25.4 * 72.0  # points, as the page's style sets it

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")


@pytest.fixture(scope="module")
def page():
    """A whole report, with a recording and a unit of long names, and a table of several pages."""
    found = fake_diagnosis(n=600)
    steps = (OneStep("holdout_stick", 6.0, 2.0, 1.1),)
    ceiling = Ceiling(0.3, 0.1, 0.7, 0.6, 8.0, 0.025, 0.05, 0.02, "velocity", True, steps)
    waves = {f"{part}{number}": 0.01 * number for number in range(1, 4) for part in ("sine", "cosine")}
    tried = replace(
        found.candidates[0], minimum_detectable=waves, one_step=waves,
        reason="not clearly likelier: log-likelihood +4510 ± 2400 on the fit, +197 ± 220 on the held-out recordings",
    )  # fmt: skip
    candidates = (*found.candidates, *(replace(tried, effect=name) for name in catalogue()))
    long = replace(
        found.recordings[0], name="a_recording_with_a_name_that_is_far_too_long_for_a_telephone_" * 2
    )
    plant = Plant(16.0, position_unit="rad", force_unit="N*m", input_unit="V")
    return render(
        replace(
            found,
            plant=plant,
            recordings=(long, *found.recordings[1:]),
            candidates=candidates,
            ceiling=ceiling,
        )
    )


def _chromium(*options, folder):
    """What Chromium prints, and what it complains of."""
    fixed = (
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--enable-logging=stderr",
        "--v=0",
    )
    done = subprocess.run(
        [BROWSER, *fixed, f"--user-data-dir={folder / 'profile'}", *options],
        capture_output=True, check=True, text=True, encoding="utf-8", timeout=120,
    )  # fmt: skip
    return done.stdout, re.findall(r"CONSOLE.*", done.stderr)


@pytest.mark.parametrize("width", [1280, 390])
def test_a_screen_shows_all_of_it(page, width, tmp_path):
    """In a frame of the width, as a browser's window may be wider than is asked for."""
    file = tmp_path / "report.html"
    file.write_text(page.replace("</body>", f"<script>{MEASURED}</script></body>"), encoding="utf-8")
    frame = tmp_path / "frame.html"
    frame.write_text(
        f'<iframe src="report.html" style="width:{width}px;height:900px;border:0"></iframe><pre id="found"></pre>'
        "<script>onmessage = (event) => { document.getElementById('found').textContent = event.data; };</script>",
        encoding="utf-8",
    )
    printed, console = _chromium(
        "--virtual-time-budget=4000", "--allow-file-access-from-files", "--window-size=1400,900", "--dump-dom",
        frame.as_uri(), folder=tmp_path,
    )  # fmt: skip
    found = json.loads(unescape(re.search(r'<pre id="found">(.*?)</pre>', printed, re.S).group(1)))
    assert found["width"] == width
    assert console == []
    assert found["errors"] == []
    assert found["overflowing"] == []
    assert found["cut"] == []
    assert found["torn"] == []
    assert found["smallest_text"] >= 8.0
    # The script reads a chart and zooms it: values with a unit, other ticks, and back again.
    assert found["reading"][0].startswith("time ") and found["reading"][0].endswith(" s")
    assert any(re.match(r"base, 0.1 s ahead: −?[\d.]+ \S*rad", line) for line in found["reading"])
    assert found["ticks_zoomed"] != found["ticks_before"] == found["ticks_after"]
    assert float(found["ticks_zoomed"][-1]) < float(found["ticks_before"][-1])


class Mark(NamedTuple):
    """A mark on paper: the number of its page, its left end and the width of the paper (points), its size (points)."""

    page: int
    left: float
    paper: float
    size: float


class Paper(NamedTuple):
    """A printed page: its text, and the marks by what they belong to (row, picture, heading) and number."""

    text: str
    marks: dict[tuple[str, str], list[Mark]]

    def split(self, kind):
        """The groups of a `kind` whose marks are not all on one page."""
        return [
            key for key, marks in self.marks.items() if key[0] == kind and len({m.page for m in marks}) > 1
        ]


@pytest.fixture(scope="module", params=["letter", "a4", "210mm 245mm", "210mm 225mm"])
def paper(page, tmp_path_factory, request):
    """The page on sheets of several heights, so that they end at many places of it."""
    folder = tmp_path_factory.mktemp("paper")
    file, printed = folder / "report.html", folder / "report.pdf"
    sized = page.replace("</head>", f"<style>@page {{ size: {request.param} }}</style></head>")
    file.write_text(sized.replace("</body>", f"<script>{MARKED}</script></body>"), encoding="utf-8")
    _chromium("--no-pdf-header-footer", f"--print-to-pdf={printed}", file.as_uri(), folder=folder)
    marks, texts = defaultdict(list), []
    for number, sheet in enumerate(pypdf.PdfReader(printed).pages):

        def note(text, outer, inner, font, size, number=number, width=float(sheet.mediabox.width)):
            left, scale = inner[4] * outer[0] + outer[4], abs(inner[0] * outer[0])
            for kind, group in re.findall(r"@([RPH])(\d+)@", re.sub(r"\s", "", text)):
                marks[kind, group].append(Mark(number, left, width, size * scale))

        texts.append(sheet.extract_text(visitor_text=note))
    return Paper("\n".join(texts), marks)


def test_paper_has_all_sections_and_nothing_that_only_a_screen_can_do(paper):
    assert all(words in paper.text for words in ("What is missing", "Parameters", "Glossary", "Timings"))
    assert "Move over a chart" not in paper.text
    assert max(mark.page for marks in paper.marks.values() for mark in marks) > 4
    assert {kind for kind, _ in paper.marks} == {"R", "P", "H"}


def test_paper_cuts_no_row_of_a_table(paper):
    assert paper.split("R") == []
    assert sum(kind == "R" for kind, _ in paper.marks) > 40


def test_paper_splits_no_picture_from_its_caption(paper):
    assert paper.split("P") == []
    pictures = [marks for (kind, _), marks in paper.marks.items() if kind == "P"]
    assert len(pictures) > 12 and {len(marks) for marks in pictures} == {3}


def test_paper_has_no_heading_without_what_follows_it(paper):
    assert paper.split("H") == []
    headings = [marks for (kind, _), marks in paper.marks.items() if kind == "H"]
    assert len(headings) > 20 and {len(marks) for marks in headings} == {2}


def test_paper_is_as_wide_as_the_page(paper):
    """A browser prints a page that is too wide in a smaller size, rather than cut it."""
    marks = [mark for (kind, _), own in paper.marks.items() if kind == "R" for mark in own]
    assert {round(mark.size, 2) for mark in marks} == {2.25}  # three pixels
    assert all(0.0 < mark.left < mark.paper - MARGIN for mark in marks)
