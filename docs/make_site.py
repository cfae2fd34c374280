"""Build the site: `python docs/make_site.py [FOLDER]`, by default in out/site; needs the extra `docs`.

The pages are those of this folder. A page for each effect and the reference of the public names are made from the
package. Links to files outside of this folder lead to the repository. A warning of the builder is an error.
"""

import inspect
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import frictionjax as fj
from frictionjax import api

DOCS = Path(__file__).resolve().parent
REPOSITORY = DOCS.parent
ADDRESS = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"][
    "Repository"
]
_ROOMS = {
    "recordings": "Recordings and cases",
    "diagnosis": "Diagnosis",
    "arm": "Arms: many joints",
    "report": "Results: saving, reading, drawing",
    "physics": "The drive and its friction",
    "simulation": "Simulation",
    "excitation": "What to apply",
    "frequency": "Frequency responses",
    "estimation": "Fits",
    "information": "Planning experiments",
    "studies": "Studies",
    "exchange": "Other simulators",
    "core": "Set-up, numbers, errors",
}
"""Room of the package -> its heading in the reference, in the order of the page."""


def build(folder: Path) -> Path:
    """Gather the pages in a `folder` and build the site there.

    **Returns:** the folder of the site.

    **Raises:** `subprocess.CalledProcessError` where the builder warns of anything.
    """
    pages = folder / "pages"
    if pages.exists():
        shutil.rmtree(pages)
    shutil.copytree(DOCS, pages, ignore=shutil.ignore_patterns("*.py", "*.toml", "__pycache__"))
    for page in pages.rglob("*.md"):
        source = DOCS / page.relative_to(pages)
        page.write_text(_for_site(page.read_text(encoding="utf-8"), source), encoding="utf-8")
    effects = runpy.run_path(str(DOCS / "make_effects.py"))
    (pages / "effects").mkdir()
    for name, text in effects["pages"]().items():
        (pages / "effects" / f"{name}.md").write_text(text, encoding="utf-8")
    (pages / "effects.md").write_text(effects["overview"](), encoding="utf-8")
    (pages / "api.md").write_text(reference(), encoding="utf-8")
    settings = (DOCS / "zensical.toml").read_text(encoding="utf-8")
    settings = settings.replace('paths = ["."]', f"paths = [{str(REPOSITORY)!r}]")
    settings = settings.replace("https://example.invalid/", f"{ADDRESS}/")
    (folder / "zensical.toml").write_text(settings, encoding="utf-8")
    return make(folder)


def make(folder: Path) -> Path:
    """Build the site from the pages in a `folder`.

    **Returns:** the folder of the site.

    **Raises:** `subprocess.CalledProcessError` where the builder warns of anything.
    """
    subprocess.run([sys.executable, "-m", "zensical", "build", "--clean", "--strict"], cwd=folder, check=True)
    return folder / "site"


def _for_site(text: str, source: Path) -> str:
    """The `text` of a page: links to files outside of this folder lead to the repository, and a bar in the code of a
    table, which GitHub wants escaped, stands alone, as the builder would show the backslash."""

    def link(found: re.Match[str]) -> str:
        target, _, anchor = found[1].partition("#")
        if not target or "://" in target or (source.parent / target).resolve().is_relative_to(DOCS):
            return found[0]
        place = (source.parent / target).resolve().relative_to(REPOSITORY).as_posix()
        return f"]({ADDRESS}/blob/main/{place}{'#' + anchor if anchor else ''})"

    def code(found: re.Match[str]) -> str:
        return found[0].replace("\\|", "|")

    rows = re.sub(r"(?m)^\|.*$", lambda row: re.sub(r"`[^`]+`", code, row[0]), text)
    return re.sub(r"\]\(([^)\s]+)\)", link, rows)


def reference() -> str:
    """The page of the public names, as Markdown with a directive for each."""
    found: dict[str, list[tuple[str, Any]]] = {room: [] for room in _ROOMS}
    for name in sorted(api.__all__, key=str.lower):
        thing = getattr(fj, name)
        if isinstance(thing, ModuleType):
            parts = [(part, value) for part, value in vars(thing).items() if inspect.isfunction(value)]
            found["excitation"] += [(f"{name}.{part}", value) for part, value in parts]
        else:
            found[thing.__module__.split(".")[1]].append((name, thing))
    lines = [
        "# API",
        "",
        "The public names, written `fj.` after `import frictionjax as fj`, by what they are for.",
        "",
    ]
    for room, title in _ROOMS.items():
        lines += [f"## {title}", ""]
        for name, thing in found[room]:
            members = _documented(thing)
            lines += [
                f"::: {thing.__module__}.{thing.__qualname__}",
                "    options:",
                f"      heading: fj.{name}",
            ]
            lines += ["      members:", *(f"        - {member}" for member in members)] if members else []
            lines.append("")
    return "\n".join(lines)


def _documented(thing: Any) -> list[str]:
    """The public methods and properties that a class defines with a docstring."""
    if not isinstance(thing, type):
        return []
    own = {name: value for name, value in vars(thing).items() if not name.startswith("_")}
    return [name for name, value in own.items() if callable(value) or isinstance(value, property)]


if __name__ == "__main__":
    print(build(Path(sys.argv[1] if len(sys.argv) > 1 else "out/site")))
