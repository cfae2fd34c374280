"""The site: built from the pages, a warning of its builder being an error."""

import re
import runpy
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

import frictionjax as fj
from frictionjax import api

REPOSITORY = Path(__file__).parents[1]

pytest.importorskip("zensical", reason="needs the extra docs")
pytest.importorskip("mkdocstrings", reason="needs the extra docs")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    run = subprocess.run(
        [sys.executable, REPOSITORY / "docs" / "make_site.py", folder], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return folder / "site"


def _text(page):
    return unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))


def test_every_page_of_the_documents_is_there(site):
    pages = [page.relative_to(REPOSITORY / "docs") for page in (REPOSITORY / "docs").rglob("*.md")]
    assert len(pages) > 20
    assert not [page for page in pages if not (site / page.with_suffix(".html")).is_file()]


@pytest.mark.parametrize("name", fj.catalogue())
def test_every_effect_has_a_page_with_its_equation_and_picture(site, name):
    page, about = site / "effects" / f"{name}.html", fj.catalogue()[name][0].about
    (source,) = re.findall(rf'src="([^"]*/{name}\.png)"', page.read_text(encoding="utf-8"))
    assert (page.parent / source).is_file()
    said = " ".join(_text(page).split())
    assert all(
        " ".join(words.split()) in said for words in (about.equation, *about.confused_with, about.split_by)
    )


@pytest.mark.parametrize("name", ["index", "effects/creep", "benchmarks/bank"])
def test_every_page_has_the_styles_of_the_site(site, name):
    page = site / f"{name}.html"
    (styles,) = re.findall(r'href="([^"]*site\.css)"', page.read_text(encoding="utf-8"))
    assert "pre-wrap" in (page.parent / styles).read_text(encoding="utf-8")


def test_choices_of_an_option_are_shown_without_an_escape(site):
    """GitHub wants a bar in a table escaped, also in code; the builder of the site shows the backslash."""
    assert "\\|" in (REPOSITORY / "docs" / "your-data.md").read_text(encoding="utf-8")
    assert not [page for page in site.rglob("*.html") if "\\|" in _text(page)]
    assert "--hold zero|linear|auto" in _text(site / "your-data.html")


def test_every_effect_leads_back_to_all_of_them(site):
    pages = list((site / "effects").glob("*.html"))
    assert pages and all(
        "../effects.html" in re.findall(r'<a href="([^"]+)">All effects', page.read_text("utf-8"))
        for page in pages
    )


def test_the_reference_has_every_public_name_with_what_it_takes(site):
    said = _text(site / "api.html")
    missing = [name for name in api.__all__ if name != "excitation" and f"fj.{name}" not in said]
    assert not missing and "fj.excitation.prbs" in said
    assert "samples per second" in said and "sample_rate" in said


def test_a_link_that_leads_nowhere_stops_the_build(site, tmp_path):
    """In another folder, as the pages of the first one are done."""
    gathered = runpy.run_path(str(REPOSITORY / "docs" / "make_site.py"))
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "index.md").write_text("[nowhere](nowhere.md)\n", encoding="utf-8")
    (tmp_path / "zensical.toml").write_text(
        '[project]\nsite_name = "x"\ndocs_dir = "pages"\n', encoding="utf-8"
    )
    with pytest.raises(subprocess.CalledProcessError):
        gathered["make"](tmp_path)
