"""report.html: the sections in one self-contained file that loads nothing from the network."""

from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.canvas import drawing
from frictionjax.report.html import text
from frictionjax.report.sections import SECTIONS

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="description" content="{summary}">
<title>{case} – frictionjax</title>
<style>
{css}</style>
</head>
<body>
<main>
{header}
{contents}
{sections}
</main>
<footer>frictionjax {version}</footer>
</body>
</html>
"""


def write_report(diagnosis: Diagnosis, directory: Path) -> None:
    """Write `directory`/report.html.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.
    - `directory`: an existing directory.
    """
    # A name that is not UTF-8 is written with escapes.
    (directory / "report.html").write_bytes(render(diagnosis).encode("utf-8", "backslashreplace"))


def render(diagnosis: Diagnosis) -> str:
    """The report as one HTML page with its styles and figures inside.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    HTML that opens with the summary sentence.
    """
    with drawing():
        bodies = [(section.title, section.body(diagnosis)) for section in SECTIONS]
    header = "".join(f"<header>{body}</header>" for title, body in bodies if not title)
    titled = [(title, body) for title, body in bodies if title and body]
    entries = "".join(f'<a href="#{_anchor(title)}">{text(title)}</a>' for title, _ in titled)
    return _PAGE.format(
        summary=text(diagnosis.summary),
        case=text(diagnosis.case),
        css=files("frictionjax.report").joinpath("page.css").read_text(encoding="utf-8"),
        header=header,
        contents=f'<nav aria-label="Contents">{entries}</nav>',
        sections="\n".join(
            f'<section id="{_anchor(title)}"><h2>{text(title)}</h2>{body}</section>' for title, body in titled
        ),
        version=version("frictionjax"),
    )


def _anchor(title: str) -> str:
    return "-".join("".join(c for c in word if c.isalnum()) for word in title.lower().split())
