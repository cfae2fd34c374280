"""Text for users is written in the terms of the field: words that this project once used for them do not come back.

Text for users is every string of several words in the package (messages, warnings, sentences of the report), the first
line of every docstring, and the documents.
"""

import ast
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
}
"""Word -> what the field says."""
BANNED = re.compile(rf"(?<![\w`-])(?:{'|'.join(INSTEAD)})(?![\w`(-])", re.IGNORECASE)
PAGES = [f"docs/{page.name}" for page in sorted((REPOSITORY / "docs").glob("*.md"))]
DOCUMENTS = ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", *PAGES]
SEVERAL_WORDS = re.compile(r"[A-Za-z]+[,;:]? [a-z]+")


def texts_for_users(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of the strings of several words in a Python file, and of the first lines of its docstrings."""
    tree = ast.parse(source)
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            constant = node.body[0].value  # type: ignore[attr-defined]
            docstrings.add(constant)
            yield constant.lineno, ast.get_docstring(node).strip().splitlines()[0]  # type: ignore[union-attr]
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and node not in docstrings and SEVERAL_WORDS.search(text):
            yield node.lineno, text


def breaches(text: str) -> list[str]:
    """Banned words of a `text`, each with what the field says."""
    return [f"`{word}`: say {INSTEAD[word.lower()]}" for word in BANNED.findall(text)]


def test_the_package_speaks_plain_english():
    found = []
    for path in sorted((REPOSITORY / "frictionjax").rglob("*.py")):
        for line, text in texts_for_users(path.read_text(encoding="utf-8")):
            name = path.relative_to(REPOSITORY).as_posix()
            found += [f"{name}:{line}: {breach}" for breach in breaches(text)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_the_documents_speak_plain_english(document):
    lines = (REPOSITORY / document).read_text(encoding="utf-8").splitlines()
    found = [f"{document}:{n}: {breach}" for n, line in enumerate(lines, 1) for breach in breaches(line)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('raise ValueError("what is told of it")', 1),
        ('def f():\n    """Recordings kept aside."""', 1),
        ('def f():\n    """Plain.\n\n    told"""', 0),
        ('x = "told"', 0),  # a key or a name
        ('x = f"{n} were mended, {n} were told"', 2),
        ('x = "`set_aside(case)` holds out the last third"', 0),
        ('x = "kindness is akin to it"', 0),
    ],
)
def test_a_planted_word_is_caught(source, count):
    assert sum(len(breaches(text)) for _, text in texts_for_users(source)) == count
