"""Tests stand where the code that they test stands, and a test file that a text names is there."""

import re
from collections.abc import Iterable
from pathlib import Path

from helpers_house import tracked_files

REPOSITORY = Path(__file__).parents[2]
OF_THE_PROJECT = {"house", "support", "benchmarks"}
"""Folders of tests that mirror none of the package: rules of the project, what tests share, the benchmarks."""
TEST_FILE = re.compile(r"(?<![\w/])tests/(?:\w+/)*test_\w+\.py")


def strangers(tests: Iterable[str], package: Iterable[str]) -> list[str]:
    """Folders of `tests` (paths of its files) that are no folders of the `package` (paths of its files)."""
    rooms = {folder for file in package for folder in Path(file).parents}
    folders = {folder for file in tests for folder in Path(file).parents if folder != Path()}
    return sorted(folder.as_posix() for folder in folders - rooms if folder.parts[0] not in OF_THE_PROJECT)


def test_every_folder_of_tests_is_a_folder_of_the_package():
    tests, package = (
        [path.relative_to(REPOSITORY / top).as_posix() for path in (REPOSITORY / top).rglob("*.py")]
        for top in ("tests", "frictionjax")
    )
    assert "diagnosis/evidence/test_judge.py" in tests
    assert strangers(tests, package) == []


def test_every_test_file_that_a_text_names_is_there():
    named = {}
    for path in tracked_files(REPOSITORY):
        if path.suffix not in (".py", ".md", ".toml", ".ipynb", ""):
            continue
        for name in TEST_FILE.findall(path.read_text(encoding="utf-8")):
            named.setdefault(name, path.relative_to(REPOSITORY).as_posix())
    assert "tests/diagnosis/test_other_cases.py" in named  # in ARCHITECTURE.md
    gone = [f"{path}: {name}" for name, path in named.items() if not (REPOSITORY / name).is_file()]
    assert not gone, "\n".join(gone)


def test_a_folder_that_the_package_lacks_is_caught():
    package = ["core/json.py", "diagnosis/evidence/pace.py"]
    assert strangers(["test_cli.py", "house/deep/test_a.py", "diagnosis/evidence/test_a.py"], package) == []
    assert strangers(["evidence/test_a.py", "diagnosis/pace/test_b.py"], package) == [
        "diagnosis/pace",
        "evidence",
    ]
