"""Saving the diagnosis of an arm: the result of each joint, arm.json, and index.html last."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from frictionjax.arm import ArmDiagnosis
from frictionjax.core import InputError
from frictionjax.core.files import write_whole
from frictionjax.core.json import plain_json
from frictionjax.report.arm_page import render_arm
from frictionjax.report.fit_csv import fit_files
from frictionjax.report.replace import CURE
from frictionjax.report.save import check_writable, save_diagnosis

SCHEMA = "frictionjax.arm/1"
ARM, PAGE = "arm.json", "index.html"


def arm_json(diagnosis: ArmDiagnosis) -> dict[str, Any]:
    """The content of arm.json, schema `frictionjax.arm/1`, as plain JSON types: a row for each joint, and the base
    parameters of the rigid bodies.

    **Arguments:**

    - `diagnosis`: what `diagnose_arm` found.
    """
    folders = _folders(diagnosis)
    content = {
        "schema": SCHEMA,
        "arm": diagnosis.name,
        "summary": diagnosis.summary,
        "joints": [row | {"folder": folders.get(row["joint"])} for row in diagnosis.table()],
        "base_parameters": diagnosis.rigid_body.parameters,
        "logs": [{"name": log.name, "role": log.role} for log in diagnosis.rigid_body.logs],
        "warnings": diagnosis.warnings,
        "seconds": diagnosis.seconds,
        "frictionjax": version("frictionjax"),
    }
    return plain_json(content)


def check_arm_writable(directory: str | Path) -> None:
    """Raise `InputError` unless `save_arm_diagnosis` could write into `directory` now; changes nothing."""
    directory = Path(directory)
    check_writable(directory)
    for name in (ARM, PAGE):
        if (directory / name).is_dir():
            raise InputError("is a directory where a file is to go", file=directory / name, cure=CURE)
    if (directory / PAGE).exists() and not (directory / ARM).exists():
        problem = "exists and was not written by frictionjax, so it is not overwritten"
        raise InputError(problem, file=directory / PAGE, cure="Choose another output directory")


def save_arm_diagnosis(diagnosis: ArmDiagnosis, directory: str | Path, *, report: bool = True) -> Path:
    """Write a folder `joints/<joint>` as `save_diagnosis` does for each joint, then arm.json, and index.html last: a
    folder with that page is complete.

    **Arguments:**

    - `diagnosis`: what `diagnose_arm` found.
    - `directory`: where to write; created with its parents when missing. Results of an earlier run are replaced.
    - `report`: whether the pages are written, too.

    **Returns:** `directory`, as a Path.

    **Raises:** `InputError` when it cannot be written.
    """
    directory, folders = Path(directory), _folders(diagnosis)
    check_arm_writable(directory)
    content = json.dumps(arm_json(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        (directory / PAGE).unlink(missing_ok=True)
        for one in diagnosis.joints:
            if one.diagnosis is not None:
                save_diagnosis(one.diagnosis, directory / folders[one.joint], report=report)
        directory.mkdir(parents=True, exist_ok=True)
        _write(directory / ARM, content)
        if report:
            _write(directory / PAGE, render_arm(diagnosis, folders))
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", file=error.filename or directory, cure=CURE
        ) from error
    return directory


def _folders(diagnosis: ArmDiagnosis) -> dict[str, str]:
    """Joint -> its folder; joints that were not diagnosed have none."""
    names = [one.joint for one in diagnosis.joints if one.diagnosis is not None]
    return {joint: f"joints/{file.removesuffix('.csv')}" for joint, file in fit_files(names).items()}


def _write(path: Path, text: str) -> None:
    data = text.encode("utf-8", "backslashreplace")
    write_whole(path, lambda stream: stream.write(data))
