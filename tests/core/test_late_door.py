"""Doors that load late: they give the same names as an import at once would, and no module in their place."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import frictionjax

ROOT = Path(frictionjax.__file__).parent
DOORS = sorted(
    path.parent for path in ROOT.rglob("__init__.py") if "late_door(" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("folder", DOORS, ids=lambda folder: folder.name)
def test_type_checkers_see_the_names_that_are_loaded(folder):
    tree = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    (seen,) = (node.body for node in tree.body if isinstance(node, ast.If))
    package = ".".join(("frictionjax", *folder.relative_to(ROOT).parts))
    typed = {one.names[0].asname: one.module.removeprefix(f"{package}.") for one in seen}
    (call,) = (
        node.value for node in tree.body if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    )
    assert ast.literal_eval(call.args[1]) == typed
    door = sys.modules.get(package) or __import__(package, fromlist=["_"])
    assert set(typed) <= set(dir(door))
    for name in typed:
        assert getattr(door, name).__module__.startswith(package)


def test_a_module_does_not_take_the_place_of_a_name():
    """`frictionjax.diagnosis.diagnose` is a module as well, and loading it must not hide the verb."""
    code = """
import frictionjax.diagnosis.diagnose
from frictionjax.diagnosis import diagnose
assert callable(diagnose) and frictionjax.diagnosis.diagnose is diagnose
import frictionjax.diagnosis.warm, frictionjax.diagnosis.rule
assert callable(frictionjax.diagnosis.warm)
assert frictionjax.diagnosis.rule.Rule is frictionjax.diagnosis.Rule
try:
    frictionjax.diagnosis.nothing
except AttributeError as error:
    assert "no attribute 'nothing'" in str(error)
else:
    raise SystemExit("no error")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
