"""Every argument and every return of the functions of the package bears a type.

That the types are true is checked where they are used: `pytest --types` runs the tests with the annotations of the
packages in conftest.py verified at each call.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "frictionjax"


def gaps(tree: ast.AST) -> Iterator[str]:
    """What lacks a type, one sentence each. Functions inside functions and lambdas may leave it out."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for argument in _arguments(node):
                if argument.annotation is None and argument.arg not in ("self", "cls"):
                    yield f"{node.lineno}: `{node.name}` gives no type for `{argument.arg}`."
            if node.returns is None:
                yield f"{node.lineno}: `{node.name}` gives no type for what it returns."
        elif not isinstance(node, ast.Lambda):
            yield from gaps(node)


def _arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.arg]:
    given = function.args
    rest = [argument for argument in (given.vararg, given.kwarg) if argument is not None]
    return [*given.posonlyargs, *given.args, *given.kwonlyargs, *rest]


def test_every_argument_and_return_has_a_type():
    files = sorted(PACKAGE.rglob("*.py"))
    assert PACKAGE / "physics" / "lugre.py" in files
    found = [
        f"{path.relative_to(PACKAGE)}:{gap}" for path in files for gap in gaps(ast.parse(path.read_text()))
    ]
    assert not found, "\n".join(found)


def test_the_types_reach_users():
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("def f(a: int, *b: int, c: int = 0, **d: int) -> int: ...", []),
        ("def f(a, /, b, *c, d, **e) -> int: ...", ["`a`", "`b`", "`d`", "`c`", "`e`"]),
        ("def f(a: int): ...", ["returns"]),
        ("class A:\n def f(self, a): ...", ["`a`", "returns"]),
        ("class A:\n @classmethod\n async def f(cls) -> int: ...", []),
        ("if True:\n def f(a) -> int: ...", ["`a`"]),
        ("def f() -> int:\n def inner(a): ...\n return lambda b: b", []),
    ],
)
def test_a_planted_gap_is_caught(code, words):
    found = list(gaps(ast.parse(code)))
    assert len(found) == len(words)
    assert all(word in sentence for word, sentence in zip(words, found, strict=True))
