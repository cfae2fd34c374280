"""index.html of an arm: one table over its joints, each with a link to its own report, and the refitted model."""

import math
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from markupsafe import Markup

from frictionjax.arm import ArmDiagnosis
from frictionjax.report.format import number, quantities, quantity, unit_text
from frictionjax.report.html import Cell, pair, table
from frictionjax.report.page import own_file
from frictionjax.report.template import fill

_ERRORS = "Errors are root mean square over the held-out logs, predicted 0.1 s ahead."
_LEFT = (
    "What the rigid bodies leave of a torque is friction, and whatever else the model lacks; root mean square, on the "
    "held-out logs. Friction was free in the refit, and held-out logs had no part in it."
)
_BASE = "Each stands for a combination of masses, centres of mass and inertias, by the name of the one that leads it."


def render_arm(diagnosis: ArmDiagnosis, folders: Mapping[str, str]) -> str:
    """The page of an arm as HTML, with its styles inside.

    **Arguments:**

    - `diagnosis`: what `diagnose_arm` found.
    - `folders`: joint -> the folder of its report, relative to the page; joints without one have no link.
    """
    rows = diagnosis.table()
    held_out = sum(log.role == "holdout" for log in diagnosis.rigid_body.logs)
    facts = (
        f"{len(rows)} joints · {len(diagnosis.rigid_body.logs) - held_out} logs to fit, {held_out} held out"
    )
    header = Markup("<h1>{}</h1>").format(diagnosis.summary or "No joint was diagnosed.")
    header += Markup('<p class="byline">arm {} · {}</p>').format(diagnosis.name, facts)
    header += Markup("").join(Markup("<p>{}</p>").format(said) for said in diagnosis.warnings)
    sections = [
        {"title": "Joints", "anchor": "joints", "body": _joints(rows, folders)},
        {"title": "Rigid bodies", "anchor": "rigid-bodies", "body": _rigid_bodies(diagnosis, rows)},
    ]
    page = fill(
        "page.html.j2",
        summary=diagnosis.summary,
        case=diagnosis.name,
        css=own_file("page.css"),
        script=Markup(""),
        header=header,
        sections=sections,
        version=version("frictionjax"),
    )
    return str(page)


def _joints(rows: list[dict[str, Any]], folders: Mapping[str, str]) -> Markup:
    head = ["joint", "verdict", "named", "parameters", "held-out error"]
    body = table(head, [_joint(row, folders.get(row["joint"])) for row in rows])
    return fill("prose.html.j2", sentences=[_ERRORS], below=body)


def _joint(row: dict[str, Any], folder: str | None) -> list[Cell]:
    name: Cell = row["joint"]
    if folder is not None:
        name = Markup('<a href="{}/report.html">{}</a>').format(folder, row["joint"])
    badge = Markup('<span class="badge {}">{}</span>').format(row["verdict"].split()[0], row["verdict"])
    named: Cell = row["effects"] or row["reason"]
    if row["effects"]:
        named = Markup("{}<small>confidence {}</small>").format(row["effects"], number(row["confidence"], 2))
    if not math.isfinite(row["error_base"]):
        return [name, badge, named, "", ""]
    before, after = quantities([row["error_base"], row["error_extended"]], row["unit"], 3)
    errors = Markup("{}<small>noise floor {}</small>").format(
        pair(before, after if row["verdict"] in ("named", "unknown") else None),
        quantity(row["noise_floor"], row["unit"], 2),
    )
    return [name, badge, named, row["parameters"].replace("*", "·"), errors]


def _rigid_bodies(diagnosis: ArmDiagnosis, rows: list[dict[str, Any]]) -> Markup:
    torques = table(
        ["joint", "torque", "left, model as given", "left, refitted"],
        [
            [
                row["joint"],
                *quantities([row["torque"], row["left_as_given"], row["left_holdout"]], row["unit"], 3),
            ]
            for row in rows
        ],
    )
    fit = diagnosis.rigid_body
    given = fit.base.of(fit.arm.values)
    parameters = table(
        ["base parameter", "unit", "model", "refitted", "standard error"],
        [
            [
                name,
                unit_text(found.unit),
                number(float(before), 4),
                number(found.value, 4) if found.identified else "as in the model",
                number(found.stderr, 2) if found.identified else "not determined",
            ]
            for (name, found), before in zip(fit.parameters.items(), given, strict=True)
        ],
    )
    first = fill("prose.html.j2", sentences=[_LEFT], below=torques)
    return first + fill("prose.html.j2", sentences=[_BASE], below=parameters)
