"""report.html: the sections in one self-contained file that loads nothing from the network."""

from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.sections import SECTIONS
from frictionjax.report.template import fill


def write_report(diagnosis: Diagnosis, directory: Path) -> None:
    """Write `directory`/report.html.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.
    - `directory`: an existing directory.
    """
    # A name that is not UTF-8 is written with escapes.
    (directory / "report.html").write_bytes(render(diagnosis).encode("utf-8", "backslashreplace"))


def render(diagnosis: Diagnosis) -> str:
    """The report as one HTML page with its styles, script and charts inside.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    HTML that opens with what is missing, how much better the model is with it, and what to do next.
    """
    bodies = [(section.title, section.body(diagnosis)) for section in SECTIONS]
    page = fill(
        "page.html.j2",
        summary=diagnosis.summary,
        case=diagnosis.case,
        css=own_file("page.css"),
        script=own_file("page.js"),
        header=Markup("").join(body for title, body in bodies if not title),
        sections=[
            {"title": title, "body": body, "anchor": _anchor(title)}
            for title, body in bodies
            if title and body
        ],
        version=version("frictionjax"),
    )
    return str(page)


def own_file(name: str) -> Markup:
    """The file `name` of this package, as it stands in a page."""
    return Markup(files("frictionjax.report").joinpath(name).read_text(encoding="utf-8"))


def _anchor(title: str) -> str:
    return "-".join("".join(c for c in word if c.isalnum()) for word in title.lower().split())
