"""What no file of the project holds: paths of one person's machine, unfinished business, swallowed errors, prints."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_house import tracked_files

REPOSITORY = Path(__file__).parents[2]
PERSONAL_PATH = re.compile(r"(?<![\w.~:/-])(?:/(?:home|Users|root|work)/|[A-Z]:\\Users\\)\w")
UNFINISHED = re.compile(r"\b(?:TO[D]O|FIX[M]E|XX[X])\b")  # brackets, so that this line is not found
PICTURE = re.compile(r'"image/png": "[^"]*"')  # of a notebook: letters by chance
CATCH_ALL = ("Exception", "BaseException")


def text_breaches(text: str) -> Iterator[str]:
    """Forbidden words of one text file; pictures in it hold none."""
    for number, line in enumerate(PICTURE.sub("", text).splitlines(), start=1):
        if found := PERSONAL_PATH.search(line):
            yield f"{number}: the path of a machine, {found.group()}..."
        if found := UNFINISHED.search(line):
            yield f"{number}: {found.group()}; finish it or open an issue."


def code_breaches(text: str, *, in_package: bool) -> Iterator[str]:
    """Swallowed errors, and in the package prints, of one Python file."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ExceptHandler):
            caught = ast.unparse(node.type) if node.type else ""
            if not caught:
                yield f"{node.lineno}: a bare except."
            elif caught in CATCH_ALL and all(_does_nothing(statement) for statement in node.body):
                yield f"{node.lineno}: every error is swallowed."
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called.endswith("suppress") and any(ast.unparse(a) in CATCH_ALL for a in node.args):
                yield f"{node.lineno}: every error is swallowed."
            if in_package and called == "print":
                yield f"{node.lineno}: a verb returns, it does not print."


def _does_nothing(statement: ast.stmt) -> bool:
    constant = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    return constant or isinstance(statement, ast.Pass | ast.Continue)


def test_no_file_holds_what_it_should_not():
    found = []
    for path in tracked_files(REPOSITORY):
        name = path.relative_to(REPOSITORY).as_posix()
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:  # not a text
            continue
        found += [f"{name}:{breach}" for breach in text_breaches(text)]
        if path.suffix == ".py":
            in_package = name.startswith("frictionjax/")
            found += [f"{name}:{breach}" for breach in code_breaches(text, in_package=in_package)]
    assert not found, "\n".join(found)


def test_the_files_are_found():
    names = {path.name for path in tracked_files(REPOSITORY)}
    assert {"pyproject.toml", "conftest.py", "LICENSE"} <= names


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("read |home|ann|run.csv", 1),
        ("read '|root|run.csv'", 1),
        ("C:\\~Users\\ann", 1),
        ("https://example.org/home/page and ./jobs/run.csv", 0),
        ("x = 1  # FIX~ME", 1),
        ("the fixme of XXXL", 0),
        ('{"image/png": "abc/XX~X+FIX~ME/"}', 0),
        ('{"text/plain": "FIX~ME"}', 1),
    ],
)
def test_a_planted_word_is_caught(text, count):
    planted = text.replace("|", "/").replace("~", "")  # written so that this file itself passes
    assert len(list(text_breaches(planted))) == count


@pytest.mark.parametrize(
    ("body", "count"),
    [
        ("except: raise", 1),
        ("except Exception: pass", 1),
        ("except Exception:\n    'never mind'", 1),
        ("except Exception as error: raise ValueError from error", 0),
        ("except KeyError: pass", 0),
    ],
)
def test_a_planted_swallow_is_caught(body, count):
    assert len(list(code_breaches(f"try: ...\n{body}\n", in_package=True))) == count


def test_a_print_is_caught_in_the_package_only():
    assert len(list(code_breaches("print(1)", in_package=True))) == 1
    assert list(code_breaches("print(1)", in_package=False)) == []
    assert list(code_breaches("'''>>> print(1)'''", in_package=True)) == []
