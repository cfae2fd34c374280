"""Every argument and every return of the functions of the package bears a type.

That the types are true is checked where they are used: `pytest --types` runs the tests with the annotations of the
packages in conftest.py verified at each call.
"""

import ast
import json
import os
import shutil
import subprocess
import sys
import sysconfig
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


SCRIPT = """import frictionjax as fj

case = fj.load_case("case.toml")
found = fj.diagnose(case)
reveal_type(fj.diagnose(case))
reveal_type(found.missing[0].confidence)
drive = fj.Drive(1.0, fj.LuGre(1e5, 300.0, 0.4, 1.0, 1.5, 1e-3), 16.0)
reveal_type(fj.fit(drive, case).parameters)
reveal_type(fj.simulate(drive, 0.5, 1000.0))
print(found.verdikt)
"""
"""What a user writes; its last line is a mistake."""


@pytest.fixture(scope="module")
def checked_script(tmp_path_factory):
    """What pyrefly says of the script, line by line, where the package is installed as in a user's environment."""
    program = shutil.which("pyrefly")
    if program is None:
        pytest.skip("pyrefly is not installed")
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    folder = tmp_path_factory.mktemp("user")
    site = folder / "site-packages"
    shutil.copytree(PACKAGE, site / "frictionjax", ignore=shutil.ignore_patterns("__pycache__"))
    settings = f"""python-version = "{sys.version_info.major}.{sys.version_info.minor}"
skip-interpreter-query = true
site-package-path = {json.dumps([str(site), sysconfig.get_path("purelib")])}
errors.unimported-directive = "ignore"
"""
    (folder / "pyrefly.toml").write_text(settings, encoding="utf-8")
    (folder / "script.py").write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [program, "check", "--output-format", "json"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env=clean,
    )
    said = json.loads(done.stdout)["errors"]
    return {one["line"]: one["description"] for one in said}


def test_the_types_reach_users(checked_script):
    """With a name that it cannot follow pyrefly says Any, or Unknown. Other checkers ask for py.typed; it does not."""
    assert (PACKAGE / "py.typed").is_file()
    lines = SCRIPT.splitlines()
    revealed = {k: said for k, said in checked_script.items() if lines[k - 1].startswith("reveal_type")}
    assert [said.removeprefix("revealed type: ") for said in revealed.values()] == [
        *("Diagnosis", "float", "dict[str, Estimate]", "Trajectory")
    ]
    (mistake,) = (said for k, said in checked_script.items() if k not in revealed)
    assert "verdikt" in mistake and "Diagnosis" in mistake


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
