"""A fit as JSON and back: `save_fit` and `load_fit`, schema `frictionjax.fit/1`.

The recordings stay behind. Numbers that are not finite are null, as in verdict.json; all others come back to the last
bit.
"""

import json
import math
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

import jax.numpy as jnp
import numpy as np

from frictionjax.core import Estimate, InputError, require_x64
from frictionjax.estimation.fit import FitResult
from frictionjax.exchange.table import AGAIN, FRICTION, Table, drive_of, fields_of, problem_of
from frictionjax.physics import Drive
from frictionjax.recordings.words import require_file, shown

SCHEMA = "frictionjax.fit/1"


def fit_to_json(result: FitResult) -> str:
    """`result` as strict JSON text of the schema `frictionjax.fit/1`.

    **Arguments:**

    - `result`: what `fit` found; numbers stay in the units of the case.

    **Returns:**

    The text. It holds everything but the recordings, which `problem` carries.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` for a drive that holds arrays in place of numbers.
    """
    require_x64()
    setting = result.problem.setting
    content = {
        "schema": SCHEMA,
        "frictionjax": version("frictionjax"),
        "success": bool(result.success),
        "message": result.message,
        "mismatch": _plain(result.mismatch),
        "drive": _drive_json(result.drive),
        "parameters": {label: _estimate_json(found) for label, found in result.parameters.items()},
        "covariance": _plain(result.covariance),
        "vector": _plain(result.vector),
        "problem": {
            "drive": _drive_json(setting.drive),
            "start": _plain(setting.start),
            "prior": _plain(setting.prior),
            "layout": [
                {
                    "path": free.path,
                    "label": free.label,
                    "scale": _plain(free.scale),
                    "upper": _plain(free.upper),
                }
                for free in result.problem.layout
            ],
        },
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def fit_from_json(text: str, *, file: object = None) -> FitResult:
    """The fit that `fit_to_json` wrote.

    **Arguments:**

    - `text`: JSON of the schema `frictionjax.fit/1`.
    - `file`: where the text comes from, for messages.

    **Returns:**

    A `FitResult`, equal to the one written in all but `problem`: its layout, start and prior are there, so that
    `problem.drive(vector)` works, but not its recordings, weights and observer. Null is read as infinite in standard
    errors, covariance, misfit and upper bounds, as NaN elsewhere.

    **Raises:**

    `InputError` for text that is not JSON, for another schema, an unknown effect, and for a field that is missing or
    of the wrong kind; `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    try:
        content = json.loads(text, parse_constant=_not_strict)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {shown(error)}", file=file, cure=AGAIN) from error
    if not isinstance(content, dict):
        raise InputError("is JSON, but no table with a `schema`", file=file, cure=AGAIN)
    root = Table(content, "", file)
    if content.get("schema") != SCHEMA:
        root.fail(
            "schema",
            f"the schema is {shown(json.dumps(content.get('schema')))}, not {json.dumps(SCHEMA)}",
            "Give a file that `save_fit` of this version of frictionjax wrote",
        )
    drive = drive_of(root.table("drive"))
    found = {
        label: Estimate(
            entry.number("value"),
            entry.number("stderr", math.inf),
            entry.text("unit"),
            entry.flag("identified"),
        )
        for label, entry in root.table("parameters").tables()
    }
    problem = problem_of(root.table("problem"))
    size = problem.setting.start.size
    return FitResult(
        drive=drive,
        parameters=found,
        covariance=root.matrix("covariance", size, math.inf),
        mismatch=root.number("mismatch", math.inf),
        success=root.flag("success"),
        message=root.text("message"),
        problem=problem,
        vector=jnp.asarray(root.vector("vector", size)),
    )


def save_fit(result: FitResult, path: str | Path) -> Path:
    """Write `result` to the file `path`, whole or not at all.

    **Arguments:**

    - `result`: what `fit` found.
    - `path`: the file, by custom `....json`; its folder must exist, an earlier file is replaced.

    **Returns:**

    `path`, as a Path.

    **Raises:**

    `InputError` when the file cannot be written, and what `fit_to_json` raises.
    """
    text, path = fit_to_json(result), Path(path)
    try:
        fresh = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            fresh.write_text(text, encoding="utf-8")
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except (OSError, ValueError) as error:  # the second is what a name with a null character gives
        problem = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise InputError(problem, file=shown(path, 120), cure="Choose another file or folder") from error
    return path


def load_fit(path: str | Path) -> FitResult:
    """The fit in the file `path`, which `save_fit` wrote.

    **Arguments:**

    - `path`: the file.

    **Returns:**

    A `FitResult`, without recordings: see `fit_from_json`.

    **Raises:**

    `InputError` when there is no such file, and what `fit_from_json` raises.
    """
    path = require_file(Path(path))
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError("is not text in UTF-8", file=path, cure=AGAIN) from error
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", file=path, cure="Choose another file"
        ) from error
    return fit_from_json(text, file=path)


def _plain(values) -> Any:
    """Nested lists of floats; what is not finite becomes None."""
    values = np.asarray(values, dtype=float)
    if values.ndim:
        return [_plain(row) for row in values]
    return float(values) if np.isfinite(values) else None


def _estimate_json(found: Estimate) -> dict[str, Any]:
    return found.to_json() | {"value": _plain(found.value), "stderr": _plain(found.stderr)}


def _drive_json(drive: Drive) -> dict[str, Any]:
    def number(value) -> float | None:
        if value.ndim:
            raise ValueError(f"A drive of shape {value.shape} has no file: save its members one by one.")
        return _plain(value)

    return {
        "J": number(drive.J),
        "motor_constant": number(drive.motor_constant),
        "friction": {name: number(getattr(drive.friction, name)) for name in FRICTION},
        "effects": [
            {
                "name": effect.name,
                "form": type(effect).__name__,
                "parameters": {name: number(getattr(effect, name)) for name in fields_of(type(effect))},
            }
            for effect in drive.effects
        ],
    }


def _not_strict(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number of strict JSON")
