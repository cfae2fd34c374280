"""Text for users is written in the terms of the field: words that this project once used for them do not come back.

Text for users is every docstring and every string of several words in the package, the benchmarks and the programs of
the documents (messages, warnings, sentences of the report); the templates and scripts of the report; the documents; and
what the notebooks say between their cells.
"""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
INSTEAD = {
    "told": "reported, or distinguished",
    "kin": "related",
    "begun": "started",
    "aside": "held out",
    "mend": "correct",
    "mends": "corrects",
    "mended": "corrected",
    "foreseen": "predicted",
    "nobody": "no model",
    "likeness": "approximation",
    "seen": "observed, found, or recorded",
}
"""Word -> what the field says."""
BANNED = re.compile(rf"(?<![\w`-])(?:{'|'.join(INSTEAD)})(?![\w`(-])", re.IGNORECASE)
CODE = ("frictionjax", "benchmarks", "docs", "notebooks")
PAGES = ("docs", "benchmarks", "frictionjax/report")
"""Folders with documents and templates."""
DOCUMENTS = (".md", ".j2", ".js", ".css")
SEVERAL_WORDS = re.compile(r"[A-Za-z]+[,;:]? [a-z]+")


def texts_for_users(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of the docstrings of a Python file, and of its strings of several words."""
    tree = ast.parse(source)
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            docstrings.add(node.body[0].value)  # type: ignore[attr-defined]
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and (node in docstrings or SEVERAL_WORDS.search(text)):
            yield node.lineno, text


def breaches(text: str) -> list[str]:
    """Banned words of a `text`, each with what the field says."""
    return [f"`{word}`: say {INSTEAD[word.lower()]}" for word in BANNED.findall(text)]


def between_cells(notebook: str) -> list[str]:
    """The texts of a notebook, given as its JSON."""
    return [
        "".join(cell["source"]) for cell in json.loads(notebook)["cells"] if cell["cell_type"] == "markdown"
    ]


@pytest.mark.parametrize("folder", CODE)
def test_the_code_speaks_plain_english(folder):
    files = sorted((REPOSITORY / folder).rglob("*.py"))
    assert files
    found = []
    for path in files:
        for line, text in texts_for_users(path.read_text(encoding="utf-8")):
            name = path.relative_to(REPOSITORY).as_posix()
            found += [f"{name}:{line}: {breach}" for breach in breaches(text)]
    assert not found, "\n".join(found)


def test_the_documents_and_templates_speak_plain_english():
    inside = [path for folder in PAGES for path in sorted((REPOSITORY / folder).rglob("*"))]
    paths = [path for path in [*REPOSITORY.iterdir(), *inside] if path.suffix in DOCUMENTS]
    names = {path.relative_to(REPOSITORY).as_posix(): path for path in paths}
    assert {"CHANGELOG.md", "docs/benchmarks/log.md", "benchmarks/README.md"} < set(names)
    assert {"frictionjax/report/page.js", "frictionjax/report/templates/prose.html.j2"} < set(names)
    found = []
    for name, path in names.items():
        for n, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            found += [f"{name}:{n}: {breach}" for breach in breaches(line)]
    assert not found, "\n".join(found)


def test_the_notebooks_speak_plain_english():
    notebooks = sorted((REPOSITORY / "notebooks").glob("*.ipynb"))
    assert notebooks
    found = []
    for path in notebooks:
        texts = between_cells(path.read_text(encoding="utf-8"))
        assert texts, path.name
        found += [f"{path.name}: {breach}" for text in texts for breach in breaches(text)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('raise ValueError("what is told of it")', 1),
        ('def f():\n    """Recordings kept aside."""', 1),
        ('def f():\n    """Plain.\n\n    told"""', 1),
        ('x = "told"', 0),  # a key or a name
        ('x = f"{n} were mended, {n} were told"', 2),
        ('x = "`set_aside(case)` holds out the last third"', 0),
        ('x = "kindness is akin to it"', 0),
    ],
)
def test_a_planted_word_is_caught(source, count):
    assert sum(len(breaches(text)) for _, text in texts_for_users(source)) == count


def test_a_word_planted_in_a_notebook_is_caught():
    cells = [
        {"cell_type": "code", "source": ["# told\n"], "outputs": []},
        {"cell_type": "markdown", "source": ["# Title\n", "What is told of it"]},
    ]
    assert [len(breaches(text)) for text in between_cells(json.dumps({"cells": cells}))] == [1]
