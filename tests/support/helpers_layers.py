"""The import rule of ARCHITECTURE.md, checked on the syntax tree of every file: nothing is imported or run."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).parents[2]
PACKAGE = REPOSITORY / "frictionjax"

STEPS = ["core", "physics", "recordings", "excitation", "simulation", "frequency"]
STEPS += ["estimation", "information", "exchange", "diagnosis", "arm", "studies", "report", "paper", "api"]
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

ROOMS = {
    "estimation": [
        *("parameters", "constraints", "data", "start", "evidence", "scales"),
        *("objective", "uncertainty", "descent", "result", "fit", "fit_many", "profile"),
    ],
    "diagnosis": [
        *("rule", "effort", "table", "explain", "checked", "recording_fit", "verdict"),
        *("evidence", "intake", "base_model"),
        *("screening", "refitting", "selection", "mismatch_map", "findings", "warm", "diagnose"),
    ],
}
"""Inside a large unit: its rooms (folders, and modules beside them) in order; a room imports only rooms before it."""

DOORS_THAT_LOAD_LATE = ("cli/", "__init__.py")
"""A folder and a file at the top."""
ADAPTERS_THAT_LOAD_LATE = {
    "diffrax": "simulation/reference.py",
    "optimistix": "estimation/descent/levenberg_marquardt.py",
    "lineax": "estimation/descent/levenberg_marquardt.py",
    "pandas": "core/frames.py",
    "xarray": "core/frames.py",
    "cloudpickle": "studies/worker.py",
    "matplotlib": "report/plots/sheet.py",
}
"""Libraries that take a while to load or may be missing, and that the program's main job needs none of."""
THROUGH_THE_FRONT_DOOR = ("core/front_door.py",)
"""The file whose `public_verb` gives a method of a noun a public verb of a later step, when the method is called:
`Diagnosis.save` writes what the report makes, `.plot()` draws."""
ONE_FILE_EACH = ("diffrax", "optimistix")
ONLY_UNDER = {
    "matplotlib": ("report/", "paper/figures/"),
    "cyclopts": ("cli/",),
    "pandas": ("core/frames.py",),
    "xarray": ("core/frames.py",),
}
JAX_CONFIG_READERS = ("core/precision.py", "core/setup.py")
JAX_CONFIG_SETTERS = ("core/setup.py",)
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
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(package.rglob("*.py"))}
    files = {path: ast.parse(text) for path, text in texts.items()}
    modules = {_module_name(path, package): path for path in files}
    imports = {
        path: list(imports_of(tree, _door_of(path, package), by_name="import_module" in texts[path]))
        for path, tree in files.items()
    }
    found = []
    for path, tree in files.items():
        file = path.relative_to(package).as_posix()
        found += _layer_breaches(file, imports[path], package.name)
        found += _room_breaches(file, imports[path], package.name)
        found += _habit_breaches(file, imports[path])
        found += _jax_config_breaches(file, tree) if "config" in texts[path] else ()
        lines = len(texts[path].splitlines())
        if lines > MAX_LINES:
            found.append(f"{file}: {lines} lines; above {MAX_LINES}, split it by meaning.")
    for library in ONE_FILE_EACH:
        users = [f.relative_to(package).as_posix() for f in files if uses(imports[f], library)]
        if len(users) > 1:
            found.append(f"{', '.join(users)}: {library} is imported in one file, not in {len(users)}.")
    graph = {name: _needs(name, imports[path], modules) for name, path in modules.items()}
    found += [f"{' -> '.join(cycle)}: modules import each other." for cycle in _cycles(graph)]
    return found


def uses(imports: Iterable[Import], library: str) -> bool:
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
        if path[0] != root or unit == "cli" or _through_the_front_door(file, item, root):
            continue
        if path[1] not in MAY_IMPORT:
            yield f"{file}:{item.line}: import names from the module that defines them, not from `{root}`."
        elif path[1] != unit and path[1] not in MAY_IMPORT[unit]:
            yield f"{file}:{item.line}: `{unit}` may not import `{path[1]}`."


def _room_breaches(file: str, imports: list[Import], root: str) -> Iterator[str]:
    unit, *inside = file.removesuffix(".py").split("/")
    rooms = ROOMS.get(unit, [])
    if not rooms or inside[0] == "__init__":
        return
    if inside[0] not in rooms:
        yield f"{file}: `{unit}/{inside[0]}` is not in the picture; draw it in ARCHITECTURE.md first."
        return
    for item in imports:
        path = [*item.module.split("."), item.name]
        if path[:2] == [root, unit] and rooms.index(inside[0]) < (
            rooms.index(path[2]) if path[2] in rooms else -1
        ):
            yield f"{file}:{item.line}: `{unit}/{inside[0]}` may not import `{unit}/{path[2]}`."


def _through_the_front_door(file: str, item: Import, root: str) -> bool:
    return file in THROUGH_THE_FRONT_DOOR and item.in_function and (item.module, item.name) == (root, "")


def _habit_breaches(file: str, imports: list[Import]) -> Iterator[str]:
    for item in imports:
        top = item.module.split(".")[0]
        if item.name == "*" and not (file == "__init__.py" and item.type_only):
            yield f"{file}:{item.line}: star import of {item.module}."
        door = file in DOORS_THAT_LOAD_LATE or file.startswith(DOORS_THAT_LOAD_LATE[0])
        late = door or ADAPTERS_THAT_LOAD_LATE.get(top) == file
        if item.in_function and not late and not _through_the_front_door(file, item, "frictionjax"):
            yield f"{file}:{item.line}: import of {item.module} inside a function."
        if top in ONLY_UNDER and not file.startswith(ONLY_UNDER[top]):
            yield f"{file}:{item.line}: {top} is imported in {' and '.join(ONLY_UNDER[top])} only."


def _jax_config_breaches(file: str, tree: ast.Module) -> Iterator[str]:
    """Uses of `jax.config` outside the files that may read it, and settings of it outside setup.py; one a line."""
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
                    "jax.config is the caller's; only core/setup.py, which is asked to, may set it."
                )
            elif file not in JAX_CONFIG_SETTERS and (
                node.attr == "update" or isinstance(node.ctx, ast.Store)
            ):
                found[node.lineno] = "jax.config may be read here, not set."
    yield from (f"{file}:{line}: {breach}" for line, breach in found.items())


def imports_of(tree: ast.Module, door: str, *, by_name: bool = True) -> Iterator[Import]:
    """Every import of a file; `door` is the package that a relative import starts from. `by_name`: also calls of
    `importlib.import_module`, which may stand in any expression: to look into all of them takes the longest."""

    def walk(node: ast.AST, in_function: bool, type_only: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, "", node.lineno, in_function, type_only)
        elif isinstance(node, ast.ImportFrom):
            base = door.split(".")[: door.count(".") + 2 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                yield Import(module, alias.name, node.lineno, in_function, type_only)
        elif isinstance(node, ast.Call) and _is_import(node):
            yield Import(ast.literal_eval(node.args[0]), "", node.lineno, in_function, type_only)
        inside = in_function or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            for child in node.body:
                yield from walk(child, inside, True)
            for child in node.orelse:
                yield from walk(child, inside, type_only)
        else:
            for child in ast.iter_child_nodes(node):
                if by_name or not isinstance(child, ast.expr):
                    yield from walk(child, inside, type_only)

    yield from walk(tree, False, False)


def _is_import(call: ast.Call) -> bool:
    if not (isinstance(call.func, ast.Attribute) and call.func.attr == "import_module"):
        return False  # most calls: to write them out takes the longest of all
    return ast.unparse(call.func) == "importlib.import_module" and isinstance(call.args[0], ast.Constant)


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
