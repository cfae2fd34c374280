"""The import rule of ARCHITECTURE.md, held by walking the syntax tree of every file: nothing is imported or run."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

REPOSITORY = Path(__file__).parents[1]
PACKAGE = REPOSITORY / "frictionjax"

STEPS = ["core", "physics", "recordings", "excitation", "simulation", "frequency"]
STEPS += ["estimation", "information", "exchange", "diagnosis", "studies", "report", "paper", "api"]
MAY_IMPORT = {unit: set(STEPS[:place]) for place, unit in enumerate(STEPS)} | {
    "recordings": {"core"},
    "excitation": {"core"},
    "simulation": {"core", "physics", "recordings", "excitation"},
    "frequency": {"core", "recordings", "excitation"},
    "exchange": {"core", "physics", "recordings", "simulation", "estimation"},
    "demo": {"core"},
    "cli": {*STEPS, "demo"},
    "__main__": {"cli"},
}
"""Unit (a subpackage or a module at the top) to the units that it may import; itself is always allowed."""

DOORS_THAT_LOAD_LATE = ("cli.py", "__init__.py")
ADAPTERS_THAT_LOAD_LATE = {
    "diffrax": "simulation/reference.py",
    "optimistix": "estimation/least_squares.py",
    "lineax": "estimation/least_squares.py",
}
"""Solver libraries that take a while to load, and that the program's main job needs none of."""
ONE_FILE_EACH = ("diffrax", "optimistix")
ONLY_UNDER = {"matplotlib": ("report/", "paper/figures/"), "argparse": ("cli.py",)}
JAX_CONFIG_READERS = ("cli.py", "core/precision.py", "core/setup.py")
JAX_CONFIG_SETTERS = ("cli.py", "core/setup.py")
MAX_LINES = 400


class Import(NamedTuple):
    """One name imported by a file: dotted module, imported name ("" for a plain import), and how it is imported."""

    module: str
    name: str
    line: int
    in_function: bool
    type_only: bool


def violations(package: Path) -> list[str]:
    """Every breach of the import rule by the files under the folder `package`, one sentence each."""
    files = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    modules = {_module_name(path, package): path for path in files}
    imports = {path: list(_imports(tree, _door_of(path, package))) for path, tree in files.items()}
    found = []
    for path, tree in files.items():
        file = path.relative_to(package).as_posix()
        found += _layer_breaches(file, imports[path], package.name)
        found += _habit_breaches(file, imports[path])
        found += _jax_config_breaches(file, tree)
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > MAX_LINES:
            found.append(f"{file}: {lines} lines; above {MAX_LINES}, split it by meaning.")
    for library in ONE_FILE_EACH:
        users = [f.relative_to(package).as_posix() for f in files if _uses(imports[f], library)]
        if len(users) > 1:
            found.append(f"{', '.join(users)}: {library} is imported in one file, not in {len(users)}.")
    graph = {name: _needs(name, imports[path], modules) for name, path in modules.items()}
    found += [f"{' -> '.join(cycle)}: modules import each other." for cycle in _cycles(graph)]
    return found


def _uses(imports: Iterable[Import], library: str) -> bool:
    return any(item.module.split(".")[0] == library for item in imports)


def _layer_breaches(file: str, imports: list[Import], root: str) -> Iterator[str]:
    unit = file.split("/")[0].removesuffix(".py")
    if unit == "__init__":
        early = [item for item in imports if not item.in_function and not item.type_only]
        yield from (f"{file}:{i.line}: the door loads late." for i in early if i.module.split(".")[0] == root)
        return
    if unit not in MAY_IMPORT:
        yield f"{file}: `{unit}` is not in the picture; draw it in ARCHITECTURE.md first."
        return
    for item in imports:
        path = [*item.module.split("."), item.name]
        if path[0] != root or unit == "cli":
            continue
        if path[1] not in MAY_IMPORT:
            yield f"{file}:{item.line}: import names from the module that defines them, not from `{root}`."
        elif path[1] != unit and path[1] not in MAY_IMPORT[unit]:
            yield f"{file}:{item.line}: `{unit}` may not import `{path[1]}`."


def _habit_breaches(file: str, imports: list[Import]) -> Iterator[str]:
    for item in imports:
        top = item.module.split(".")[0]
        if item.name == "*" and not (file == "__init__.py" and item.type_only):
            yield f"{file}:{item.line}: star import of {item.module}."
        late = file in DOORS_THAT_LOAD_LATE or ADAPTERS_THAT_LOAD_LATE.get(top) == file
        if item.in_function and not late:
            yield f"{file}:{item.line}: import of {item.module} inside a function."
        if top in ONLY_UNDER and not file.startswith(ONLY_UNDER[top]):
            yield f"{file}:{item.line}: {top} is imported in {' and '.join(ONLY_UNDER[top])} only."


def _jax_config_breaches(file: str, tree: ast.Module) -> Iterator[str]:
    """Uses of `jax.config` outside the files that may read it, and settings of it outside cli.py; one for a line."""
    found = {}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.ImportFrom)
            and node.module == "jax"
            and "config" in [a.name for a in node.names]
        ):
            found[node.lineno] = "write jax.config in full, so that it is seen."
        elif isinstance(node, ast.Attribute) and f"{ast.unparse(node)}.".startswith("jax.config."):
            if file not in JAX_CONFIG_READERS:
                found[node.lineno] = (
                    "jax.config is the caller's; only cli.py and core/setup.py, which is asked to, may set it."
                )
            elif file not in JAX_CONFIG_SETTERS and (
                node.attr == "update" or isinstance(node.ctx, ast.Store)
            ):
                found[node.lineno] = "jax.config may be read here, not set."
    yield from (f"{file}:{line}: {breach}" for line, breach in found.items())


def _imports(tree: ast.Module, door: str) -> Iterator[Import]:
    """Every import of a file; `door` is the package that a relative import starts from."""

    def walk(node: ast.AST, in_function: bool, type_only: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, "", node.lineno, in_function, type_only)
        elif isinstance(node, ast.ImportFrom):
            base = door.split(".")[: door.count(".") + 2 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                yield Import(module, alias.name, node.lineno, in_function, type_only)
        elif isinstance(node, ast.Call) and ast.unparse(node).startswith("importlib.import_module('"):
            yield Import(ast.literal_eval(node.args[0]), "", node.lineno, in_function, type_only)
        inside = in_function or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            for child in node.body:
                yield from walk(child, inside, True)
            for child in node.orelse:
                yield from walk(child, inside, type_only)
        else:
            for child in ast.iter_child_nodes(node):
                yield from walk(child, inside, type_only)

    yield from walk(tree, False, False)


def _needs(importer: str, imports: list[Import], modules: dict[str, Path]) -> set[str]:
    """The modules that run when `importer` is loaded: what it names, and the doors on the way that are not its own."""
    needed = set()
    for item in imports:
        if item.in_function or item.type_only:
            continue
        submodule = f"{item.module}.{item.name}"
        target = submodule if submodule in modules else item.module
        if target in modules:
            needed.add(target)
        parts = target.split(".")
        on_the_way = (".".join(parts[:k]) for k in range(1, len(parts)))
        needed |= {
            door for door in on_the_way if door in modules and not f"{importer}.".startswith(f"{door}.")
        }
    return needed - {importer}


def _cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """One closed walk, first module repeated at its end, for each group of modules that import each other."""
    cycles, settled = [], set()
    for start in sorted(graph):
        parents: dict[str, str] = {}
        queue = [start]
        while queue and start not in parents:
            here = queue.pop(0)
            for there in sorted(graph[here] - settled):
                if there not in parents:
                    parents[there] = here
                    queue.append(there)
        if start in parents:
            walk = [start, parents[start]]
            while walk[-1] != start:
                walk.append(parents[walk[-1]])
            cycles.append(walk[::-1])
        settled.add(start)
    return cycles


def _module_name(path: Path, package: Path) -> str:
    parts = [package.name, *path.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _door_of(path: Path, package: Path) -> str:
    return ".".join([package.name, *path.relative_to(package).parts[:-1]])


def test_the_package_keeps_the_import_rule():
    found = violations(PACKAGE)
    assert not found, "\n".join(found)


@pytest.mark.parametrize("library", ONE_FILE_EACH)
def test_each_solver_library_has_its_one_adapter(library):
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")}
    users = [path.name for path, tree in trees.items() if _uses(_imports(tree, ""), library)]
    assert len(users) == 1


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
    "core/__init__.py": "from frictionjax.core.errors import InputError as InputError\n",
    "core/errors.py": "class InputError(ValueError): ...\n",
    "core/precision.py": "import jax\nON = jax.config.read('jax_enable_x64')\n",
    "physics/__init__.py": "from frictionjax.physics.lugre import LuGre as LuGre\n",
    "physics/lugre.py": "from frictionjax.core import InputError\nclass LuGre: ...\n",
    "simulation/adaptive.py": "import diffrax\nfrom frictionjax.physics import LuGre\n",
    "estimation/least_squares.py": "import optimistix as optx\nfrom frictionjax.simulation import adaptive\n",
    "report/figures.py": "import matplotlib.pyplot as plt\n",
    "paper/figures/sheet.py": "import matplotlib.pyplot as plt\n",
    "demo/plant.py": "from frictionjax.core import InputError\n",
    "api.py": "from frictionjax.physics import LuGre\n",
    "__main__.py": "import sys\nfrom frictionjax.cli import main\nsys.exit(main())\n",
    "cli.py": "import argparse\ndef main():\n    import jax\n    jax.config.update('jax_enable_x64', True)\n"
    "    from frictionjax.demo.plant import InputError\n",
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
        "estimation/a.py",
        "from diffrax import Tsit5",
        "diffrax is imported in one file, not in 2",
    ),
    "second optimistix": (
        "diagnosis/a.py",
        "import optimistix",
        "optimistix is imported in one file, not in 2",
    ),
    "matplotlib": (
        "diagnosis/a.py",
        "import matplotlib.pyplot as plt",
        "matplotlib is imported in report/ and paper/figures/ only",
    ),
    "matplotlib with the numbers": (
        "paper/experiments/a.py",
        "from matplotlib.figure import Figure",
        "matplotlib is imported in report/ and paper/figures/ only",
    ),
    "argparse": ("report/a.py", "import argparse", "argparse is imported in cli.py only"),
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
