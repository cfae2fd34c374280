"""The package keeps the import rule of ARCHITECTURE.md, and every kind of breach is caught."""

import ast
import re
from pathlib import Path

import pytest
from helpers_layers import (
    MAX_LINES,
    MAY_IMPORT,
    ONE_FILE_EACH,
    PACKAGE,
    REPOSITORY,
    ROOMS,
    imports_of,
    uses,
    violations,
)


def test_the_package_keeps_the_import_rule():
    found = violations(PACKAGE)
    assert not found, "\n".join(found)


@pytest.fixture(scope="module")
def imports():
    """The imports of every file of the package that names one of these libraries, path -> list."""
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    libraries = {path: text for path, text in texts.items() if any(name in text for name in ONE_FILE_EACH)}
    return {path: list(imports_of(ast.parse(text), "")) for path, text in libraries.items()}


@pytest.mark.parametrize("library", ONE_FILE_EACH)
def test_each_solver_library_has_its_one_adapter(imports, library):
    users = [path.name for path, own in imports.items() if uses(own, library)]
    assert len(users) == 1


def test_the_rooms_in_architecture_are_the_same():
    text = (REPOSITORY / "ARCHITECTURE.md").read_text(encoding="utf-8")
    for unit, rooms in ROOMS.items():
        line = next(line for line in text.splitlines() if line.startswith(f"- `{unit}`: "))
        assert re.findall(r"`(\w+)`", line)[1:] == rooms


def test_tests_and_benchmarks_are_short_too():
    folders = [REPOSITORY / "tests", REPOSITORY / "benchmarks"]
    paths = [path for folder in folders for path in folder.rglob("*.py")]
    assert [
        path.name for path in paths if len(path.read_text(encoding="utf-8").splitlines()) > MAX_LINES
    ] == []


def test_the_table_in_architecture_says_the_same():
    rows: dict[str, set[str]] = {}
    for line in (REPOSITORY / "ARCHITECTURE.md").read_text(encoding="utf-8").splitlines():
        unit, *cells = [cell.strip("` ") for cell in line.strip("|").split("|")]
        if unit in MAY_IMPORT and len(cells) == 1:
            allowed = {word.strip("` ") for word in cells[0].split(",")} - {"nothing"}
            rows[unit] = set(rows) if allowed == {"all above"} else allowed
    assert rows == MAY_IMPORT


SOUND = {
    "__init__.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from frictionjax.api import *\n",
    "core/front_door.py": "import importlib\ndef verb(name):\n"
    "    return getattr(importlib.import_module('frictionjax'), name)\n",
    "core/frames.py": "def frame():\n    import pandas\n    import xarray\n",
    "report/plots/sheet.py": "def sheet():\n    import matplotlib.pyplot as plt\n",
    "core/__init__.py": "from frictionjax.core.errors import InputError as InputError\n",
    "core/errors.py": "class InputError(ValueError): ...\n",
    "core/precision.py": "import jax\nON = jax.config.read('jax_enable_x64')\n",
    "physics/__init__.py": "from frictionjax.physics.lugre import LuGre as LuGre\n",
    "physics/lugre.py": "from frictionjax.core import InputError\nclass LuGre: ...\n",
    "simulation/adaptive.py": "import diffrax\nfrom frictionjax.physics import LuGre\n",
    "estimation/descent/levenberg_marquardt.py": "import optimistix as optx\n"
    "from frictionjax.simulation import adaptive\n",
    "report/canvas.py": "import matplotlib.pyplot as plt\n",
    "paper/figures/sheet.py": "import matplotlib.pyplot as plt\n",
    "demo/plant.py": "from frictionjax.core import InputError\n",
    "diagnosis/intake/checks.py": "from frictionjax.diagnosis.evidence.model import Model\n",
    "diagnosis/evidence/model.py": "class Model: ...\n",
    "api.py": "from frictionjax.physics import LuGre\n",
    "__main__.py": "import sys\nfrom frictionjax.cli import main\nsys.exit(main())\n",
    "core/setup.py": "import jax\ndef configure_jax():\n    jax.config.update('jax_enable_x64', True)\n",
    "cli/__init__.py": "from frictionjax.cli.program import main as main\n",
    "cli/program.py": "import cyclopts\ndef main():\n    from frictionjax.demo.plant import InputError\n",
}

PLANTED = {
    "upward": (
        "core/units.py",
        "from frictionjax.physics.lugre import LuGre",
        "`core` may not import `physics`",
    ),
    "relative": ("core/units.py", "from ..physics import lugre", "`core` may not import `physics`"),
    "type only": (
        "core/units.py",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from frictionjax.physics import LuGre",
        "`core` may not import `physics`",
    ),
    "by name": (
        "core/units.py",
        "import importlib\nLUGRE = importlib.import_module('frictionjax.physics.lugre')",
        "`core` may not import `physics`",
    ),
    "same level": ("recordings/a.py", "import frictionjax.physics", "`recordings` may not import `physics`"),
    "frequency": (
        "frequency/a.py",
        "from frictionjax import physics",
        "`frequency` may not import `physics`",
    ),
    "demo knows": ("demo/a.py", "from frictionjax.physics import LuGre", "`demo` may not import `physics`"),
    "demo known": ("api.py", "from frictionjax.demo import plant", "`api` may not import `demo`"),
    "main does more": ("__main__.py", "from frictionjax.api import LuGre", "`__main__` may not import `api`"),
    "root as source": ("studies/a.py", "import frictionjax as fj", "not from `frictionjax`"),
    "name of the root": ("studies/a.py", "from frictionjax import LuGre", "not from `frictionjax`"),
    "eager door": ("__init__.py", "from frictionjax.api import LuGre", "the door loads late"),
    "new room": ("magic/a.py", "", "`magic` is not in the picture"),
    "second diffrax": (
        "estimation/fit.py",
        "from diffrax import Tsit5",
        "diffrax is imported in one file, not in 2",
    ),
    "second optimistix": (
        "diagnosis/explain.py",
        "import optimistix",
        "optimistix is imported in one file, not in 2",
    ),
    "matplotlib": (
        "diagnosis/explain.py",
        "import matplotlib.pyplot as plt",
        "matplotlib is imported in report/ and paper/figures/ only",
    ),
    "pandas": (
        "studies/a.py",
        "import pandas",
        "pandas is imported in core/frames.py only",
    ),
    "late matplotlib": (
        "report/plots/a.py",
        "def f():\n    import matplotlib.pyplot",
        "import of matplotlib.pyplot inside a function",
    ),
    "cyclopts": ("report/a.py", "import cyclopts", "cyclopts is imported in cli/ only"),
    "config set": (
        "api.py",
        "import jax\njax.config.update('jax_enable_x64', True)",
        "jax.config is the caller's",
    ),
    "config set by reader": (
        "core/precision.py",
        "import jax\njax.config.update('a', 1)",
        "may be read here, not set",
    ),
    "config renamed": ("core/precision.py", "from jax import config", "write jax.config in full"),
    "upward room": (
        "diagnosis/evidence/a.py",
        "from frictionjax.diagnosis.intake.checks import Model",
        "`diagnosis/evidence` may not import `diagnosis/intake`",
    ),
    "new inner room": ("diagnosis/magic/a.py", "", "`diagnosis/magic` is not in the picture"),
    "front door": (
        "diagnosis/explain.py",
        "import importlib\nFIT = importlib.import_module('frictionjax').fit",
        "not from `frictionjax`",
    ),
    "star": ("physics/a.py", "from frictionjax.core import *", "star import of frictionjax.core"),
    "in function": ("physics/a.py", "def f():\n    import numpy", "import of numpy inside a function"),
    "cycle": (
        "physics/lugre.py",
        "import frictionjax.physics.lugre_twin",
        "lugre_twin -> frictionjax.physics.lugre",
    ),
    "own door": (
        "physics/lugre.py",
        "from frictionjax.physics import LuGre",
        "frictionjax.physics.lugre -> frictionj",
    ),
    "long": ("core/long.py", "x = 1\n" * 401, "401 lines; above 400"),
}


def _build(folder: Path, files: dict[str, str]) -> Path:
    package = folder / "frictionjax"
    for name, text in files.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return package


def test_a_sound_tree_passes(tmp_path):
    assert violations(_build(tmp_path, SOUND)) == []


@pytest.mark.parametrize("plant", PLANTED)
def test_a_planted_violation_is_caught(plant, tmp_path):
    file, text, message = PLANTED[plant]
    twin = {"physics/lugre_twin.py": "from frictionjax.physics.lugre import LuGre\n"}
    found = violations(_build(tmp_path, SOUND | (twin if plant == "cycle" else {}) | {file: text}))
    assert len(found) == 1
    assert message in found[0]
