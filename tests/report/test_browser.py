"""The report in a browser: nothing overflows, nothing is cut, its script works; on a screen, a telephone, and paper."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from helpers_diagnosis import fake_diagnosis

from frictionjax.recordings import Plant
from frictionjax.report.page import render
from frictionjax.report.sections import SECTIONS

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
PDF = shutil.which("pdftotext")
MEASURED = (Path(__file__).parent / "measure_page.js").read_text(encoding="utf-8")

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")


@pytest.fixture(scope="module")
def page():
    """A whole report, with a recording and a unit of long names."""
    found = fake_diagnosis(n=600)
    long = replace(
        found.recordings[0], name="a_recording_with_a_name_that_is_far_too_long_for_a_telephone_" * 2
    )
    plant = Plant(16.0, position_unit="rad", force_unit="N*m", input_unit="V")
    return render(replace(found, plant=plant, recordings=(long, *found.recordings[1:])))


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


@pytest.mark.skipif(PDF is None, reason="there is no pdftotext on this machine")
def test_paper_has_no_heading_without_what_follows_it(page, tmp_path):
    file, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    file.write_text(page, encoding="utf-8")
    _chromium("--no-pdf-header-footer", f"--print-to-pdf={paper}", file.as_uri(), folder=tmp_path)
    text = subprocess.run([PDF, "-layout", paper, "-"], capture_output=True, check=True, text=True).stdout
    pages = [[line.strip() for line in one.splitlines() if line.strip()] for one in text.split("\f")]
    titles = {section.title for section in SECTIONS if section.title} | {"Warnings", "Data", "Timings"}
    printed = {line for one in pages for line in one}
    assert {"What is missing", "Parameters", "Glossary", "Timings"} <= printed
    for lines in filter(None, pages):
        assert lines[-1] not in titles
    assert "Move over a chart" not in text  # what only a screen can do
