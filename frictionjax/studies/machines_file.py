"""The machines of a check in a file beside its store, so that a run that goes on has the same ones."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from frictionjax.core.files import write_whole
from frictionjax.core.json import plain_json
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.exchange.fit_file import drive_json
from frictionjax.exchange.table import FieldTable, drive_of
from frictionjax.studies.explanations import Explanation
from frictionjax.studies.shards import cannot_write

SCHEMA = "frictionjax.machines/1"
CHECK = "check_{}.{}"
"""Name of a check in an output folder: number of machines, and zarr or json."""


def keep_machines(path: Path | None, asked: str, machines: Sequence[Explanation]) -> None:
    """Write the `machines` of what was `asked` for into the file `path`; None: nowhere.

    **Raises:** `InputError` where it cannot be written.
    """
    if path is None:
        return
    content = {
        "schema": SCHEMA,
        "asked": asked,
        "machines": [
            {
                "acting": one.acting,
                "drive": drive_json(one.drive),
                "deflection": one.deflection,
                "misfit": one.misfit,
            }
            for one in machines
        ],
    }
    text = json.dumps(plain_json(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda stream: stream.write(text.encode()))
    except OSError as error:
        raise cannot_write(path.parent, error) from error


def is_asked(path: Path, asked: str) -> bool:
    """Whether the file `path` holds the machines of what is `asked` for."""
    return _content(path).get("asked") == asked


def kept_machines(path: Path | None, asked: str, diagnosis: Diagnosis) -> tuple[Explanation, ...] | None:
    """The machines in the file `path`; None where it is not there, or was made for something else than what is `asked`
    for, or for a `diagnosis` with other names."""
    if path is None or not is_asked(path, asked):
        return None
    machines = tuple(
        Explanation(
            entry.texts("acting"),
            drive_of(entry.table("drive")),
            np.array(entry.content["deflection"], dtype=float),
            entry.number("misfit"),
        )
        for entry in FieldTable(_content(path), "", path, "Remove it").listed("machines")
    )
    names = tuple(found.effect for found in diagnosis.missing)
    return machines if machines and machines[0].acting == names else None


def forget_other_checks(folder: Path, asked: str) -> None:
    """Remove the checks in the output `folder` that were of something else than what is `asked` for: they are results
    of an earlier run. What this package did not write stays."""
    for path in folder.glob(CHECK.format("*", "json")):
        if _content(path) and not is_asked(path, asked):
            store = path.with_suffix(".zarr")
            for old in (store, store.with_name(f"{store.name}.parts")):
                shutil.rmtree(old, ignore_errors=True)
            path.unlink(missing_ok=True)


def _content(path: Path) -> dict:
    """What the file holds; nothing where it is not there or is no file of machines."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return found if isinstance(found, dict) and found.get("schema") == SCHEMA else {}
