"""What is published: one address, a README whose links work away from the repository, extras that exist, a citation."""

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
FOUND = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = FOUND["project"]
ADDRESS = PROJECT["urls"]["Repository"]
HOOK = FOUND["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]


def _readme_of_an_index():
    text = "".join((REPOSITORY / part["path"]).read_text(encoding="utf-8") for part in HOOK["fragments"])
    for change in HOOK["substitutions"]:
        text = re.sub(change["pattern"], change["replacement"], text)
    return text


def test_nothing_lies_about_at_the_top():
    tracked = subprocess.run(["git", "ls-files"], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if tracked.returncode:
        pytest.skip("this is no checkout")
    papers = {
        "ARCHITECTURE.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "LICENSE",
        "README.md",
        "SECURITY.md",
    }
    assert {name for name in tracked.stdout.split("\n") if name and "/" not in name} == papers | {
        ".gitignore",
        "pyproject.toml",
    }


def test_there_is_one_address():
    text = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    found = re.findall(r"https://github\.com/[\w.-]+/[\w.-]+", text + citation)
    assert len(found) > len(PROJECT["urls"]) and set(found) == {ADDRESS}


def test_pictures_and_links_of_the_readme_lead_into_the_repository():
    links = re.findall(r"\]\(([^)\s]+)\)", _readme_of_an_index())
    pictures = [link for link in links if link.endswith(".png")]
    assert len(links) > 10 and pictures
    assert all(link.startswith(f"{ADDRESS}/raw/main/") for link in pictures)
    for link in links:
        place, _, _ = link.removeprefix(f"{ADDRESS}/").partition("#")
        assert link.startswith("https://")
        if link.startswith(ADDRESS):
            assert (REPOSITORY / place.split("/", 2)[2]).exists(), link


def test_each_tested_python_is_a_classifier():
    lowest = int(PROJECT["requires-python"].removeprefix(">=3."))
    versions = [int(v) for c in PROJECT["classifiers"] for v in re.findall(r"Python :: 3\.(\d+)", c)]
    assert versions == list(range(lowest, lowest + len(versions)))
    said = f"Python 3.{versions[0]} to 3.{versions[-1]}"
    assert said in (REPOSITORY / "README.md").read_text(encoding="utf-8")


def test_the_citation_is_of_this_version():
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (.*)$", citation, re.M)
    (date,) = re.findall(r'^date-released: "(.*)"$', citation, re.M)
    assert version == PROJECT["version"]
    assert f"## [{version}] - {date}" in (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    assert PROJECT["license"] in citation and all(word in citation for word in PROJECT["keywords"])


def test_extras_that_are_named_exist():
    extras = PROJECT["optional-dependencies"]
    pages = [*REPOSITORY.glob("*.md"), *(REPOSITORY / "docs").rglob("*.md")]
    sources = [*pages, *(REPOSITORY / "frictionjax").rglob("*.py")]
    texts = [path.read_text(encoding="utf-8") for path in sources] + [
        line for v in extras.values() for line in v
    ]
    found = {
        name
        for text in texts
        for names in re.findall(r"frictionjax\[([\w,-]+)\]", text)
        for name in names.split(",")
    }
    assert found <= set(extras), found - set(extras)
    assert {"gpu", "files", "cluster", "docs", "mujoco"} <= set(extras)
