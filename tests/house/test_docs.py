"""The documents: links lead somewhere, examples are true of the package, and what a program writes is up to date."""

import ast
import re
import runpy
import tomllib
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import frictionjax as fj
from frictionjax.diagnosis.intake.own_model import own_model
from frictionjax.recordings import Case, Plant
from frictionjax.recordings.model_table import parse_model
from frictionjax.recordings.readers import READERS
from frictionjax.recordings.schema import (
    CASE_KEYS,
    PLANT_KEYS,
    RECORDING_KEYS,
    ROLES,
    Spot,
    parse_entry,
    parse_plant,
)

REPOSITORY = next(folder for folder in Path(__file__).parents if (folder / "pyproject.toml").is_file())
DOCS = REPOSITORY / "docs"
PAGES = sorted(
    [*DOCS.rglob("*.md"), *REPOSITORY.glob("*.md"), *(REPOSITORY / "benchmarks").glob("*.md")],
    key=lambda page: page.relative_to(REPOSITORY).as_posix(),
)
GENERATOR = DOCS / "make_effects.py"

pytestmark = pytest.mark.skipif(
    not (REPOSITORY / "benchmarks").is_dir(), reason="a source archive has only a part of what is linked"
)


def _named(pages):
    return pytest.mark.parametrize(
        "page", pages, ids=lambda page: page.relative_to(REPOSITORY).as_posix().removesuffix(".md")
    )


def _prose(text):
    return re.sub(r"```.*?```", "", text, flags=re.S)


def _anchors(page):
    """The anchors of the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", _prose(page.read_text(encoding="utf-8")), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@_named(PAGES)
def test_links_lead_somewhere(page):
    for target, anchor in re.findall(
        r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", _prose(page.read_text(encoding="utf-8"))
    ):
        if "://" in target:
            continue
        linked = (page.parent / target).resolve() if target else page
        assert linked.exists(), target
        if anchor:
            assert anchor in _anchors(linked), f"{target}#{anchor}"


def test_every_page_is_linked_from_the_index():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    linked = {(DOCS / target).resolve() for target in re.findall(r"\]\(([^)#]+)\)", index)}
    assert set(DOCS.rglob("*.md")) - {DOCS / "index.md"} <= linked


def test_the_page_of_the_effects_is_what_its_program_writes():
    written = runpy.run_path(str(GENERATOR))["page"]()
    assert (DOCS / "effects.md").read_text(encoding="utf-8") == written, "run `python docs/make_effects.py`"


@_named([page for page in PAGES if "```python" in page.read_text(encoding="utf-8")])
def test_examples_use_public_names(page):
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S):
        names = {ast.unparse(node) for node in ast.walk(ast.parse(block)) if isinstance(node, ast.Attribute)}
        for name in names:
            if re.fullmatch(r"fj\.[\w.]+", name):
                attrgetter(name.removeprefix("fj."))(fj)  # an AttributeError names what is missing


def test_the_example_of_a_case_file_has_every_key_and_is_right():
    text = (DOCS / "case-file.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)
    table = tomllib.loads(block)
    assert set(table) == set(CASE_KEYS)
    assert set(table["plant"]) == set(PLANT_KEYS)
    assert {key for recording in table["recording"] for key in recording} == set(RECORDING_KEYS)
    spot = Spot("case.toml")
    parse_plant(table["plant"], spot)
    model = parse_model(table["model"], "case.toml")
    assert model is not None and {one.fixed for one in model.parameters.values()} == {True, False}
    own_model(Case("arm", Plant(), (), model))
    entries = [parse_entry(recording, spot) for recording in table["recording"]]
    assert {entry.role for entry in entries} == {"fit", "holdout"}
    assert all(f"`{role}`" in text for role in ROLES)


def test_every_suffix_that_is_read_is_on_the_page_of_your_data():
    text = (DOCS / "your-data.md").read_text(encoding="utf-8")
    assert all(f"`{suffix}`" in text for suffix in READERS)


def test_the_example_of_a_case_file_loads(tmp_path):
    text = (DOCS / "case-file.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)
    (tmp_path / "case.toml").write_text(block, encoding="utf-8")
    t = np.arange(26_000) / 2000.0
    u, x = np.sin(7.0 * t), 0.5 * np.sin(7.0 * t + 0.3)
    np.savetxt(
        tmp_path / "noise.csv",
        np.column_stack([1e3 * t, u, x])[:1000],
        fmt="%.9g",
        delimiter=",",
        header="t,u,x",
        comments="",
    )
    scipy.io.savemat(tmp_path / "moves.mat", {"data": np.column_stack([u, 1e3 * x])})
    with pytest.warns(fj.FrictionjaxWarning, match="ms"):
        case = fj.load_case(tmp_path / "case.toml")
    assert [one.role for one in case.recordings] == ["fit", "holdout"]
    assert case.recordings[1].x.size == 25_000 and np.ptp(case.recordings[1].x) < 1.1


def test_the_effect_of_the_page_on_effects_of_your_own_acts(capsys):
    text = (DOCS / "adding-an-effect.md").read_text(encoding="utf-8")
    definition, use = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    exec(compile(f"{definition}\n{use}", "adding-an-effect.md", "exec"), {"__name__": "page"})
    assert abs(2e3 * float(capsys.readouterr().out) ** 3 - 40.0) < 0.7  # what the friction may hold


def test_every_effect_has_its_picture():
    drawn = runpy.run_path(str(DOCS / "make_pictures.py"))["SIZES"]
    files = {file.stem for file in (DOCS / "pictures" / "effects").glob("*.png")}
    assert set(drawn) == files == set(fj.catalogue())


def test_the_changelog_is_short_and_tells_of_this_version():
    text = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    releases = re.split(r"^## ", text, flags=re.M)[1:]
    lengths = {release.partition("\n")[0]: release.count("\n") for release in releases}
    assert max(lengths.values()) <= 41, lengths
    version = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert any(heading.startswith(f"[{version}]") for heading in lengths)


def test_the_page_of_the_benchmarks_is_short():
    assert (REPOSITORY / "benchmarks" / "README.md").stat().st_size <= 6000
