"""A fit as JSON and back: `save_fit` and `load_fit`, schema `frictionjax.fit/1`.

The data are not saved. Numbers that are not finite are null, as in verdict.json; all others are read back to the
last bit.
"""

import json
import math
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

from jaxtyping import Array, Float

from frictionjax.core import Estimate, InputError, require_x64
from frictionjax.core.json import plain_json
from frictionjax.estimation import FitResult, RecordingNoise
from frictionjax.exchange.table import AGAIN, FRICTION, HOLDS, FieldTable, drive_of, fields_of
from frictionjax.physics import Drive
from frictionjax.recordings.words import require_file, shown

SCHEMA = "frictionjax.fit/1"
FIELDS = (
    *("schema", "frictionjax", "success", "message", "cost", "at_bounds", "drive", "parameters"),
    *("names", "covariance", "covariance_white", "noise"),
)
ESTIMATE = ("value", "stderr", "unit", "identified")
NOISE = ("position", "push", "power")


def fit_to_json(result: FitResult) -> str:
    """`result` as strict JSON text of the schema `frictionjax.fit/1`.

    **Arguments:**

    - `result`: what `fit` found; numbers stay in the units of the case.

    **Returns:**

    The text: all of `result` but `posterior` and `vector`, because the data are not saved.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` for a drive with arrays in place of numbers.
    """
    require_x64()
    content = {
        "schema": SCHEMA,
        "frictionjax": version("frictionjax"),
        "success": bool(result.success),
        "message": result.message,
        "cost": result.cost,
        "at_bounds": result.at_bounds,
        "drive": drive_json(result.drive),
        "parameters": result.parameters,
        "names": result.names,
        "covariance": result.covariance,
        "covariance_white": result.covariance_white,
        "noise": result.noise,
    }
    return json.dumps(plain_json(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def fit_from_json(text: str, *, file: object = None) -> FitResult:
    """The fit that `fit_to_json` wrote.

    **Arguments:**

    - `text`: JSON of the schema `frictionjax.fit/1`.
    - `file`: where the text comes from, for messages.

    **Returns:**

    A `FitResult`, equal to the one written but for `posterior` and `vector`: both are None, because the data are
    not saved. Null is read as infinite in standard errors, covariances and cost, as NaN elsewhere.

    **Raises:**

    `InputError` for text that is not JSON, for another schema, an unknown effect, a field that is not known, missing
    or of the wrong kind, and names that have no parameter; `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    try:
        content = json.loads(text, parse_constant=_not_strict)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {shown(error)}", file=file, cure=AGAIN) from error
    if not isinstance(content, dict):
        raise InputError("is JSON, but not a table with a `schema`", file=file, cure=AGAIN)
    root = FieldTable(content, "", file)
    if content.get("schema") != SCHEMA:
        root.fail(
            "schema",
            f"the schema is {shown(json.dumps(content.get('schema')))}, not {json.dumps(SCHEMA)}",
            "Give a file that `save_fit` of this version of frictionjax wrote",
        )
    root.only(FIELDS)
    parameters = {label: _estimate_of(entry) for label, entry in root.table("parameters").tables()}
    names = _known(root, "names", parameters)
    return FitResult(
        drive=drive_of(root.table("drive")),
        parameters=parameters,
        names=names,
        covariance=root.matrix("covariance", len(names), math.inf),
        covariance_white=root.matrix("covariance_white", len(names), math.inf),
        noise={name: _noise_of(entry) for name, entry in root.table("noise").tables()},
        cost=root.number("cost", math.inf),
        success=root.flag("success"),
        message=root.text("message"),
        at_bounds=_known(root, "at_bounds", parameters),
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

    A `FitResult` whose `posterior` and `vector` are None, because the data are not saved; else as in `fit_from_json`.

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


def _estimate_of(table: FieldTable) -> Estimate:
    table.only(ESTIMATE)
    value, stderr = table.number("value"), table.number("stderr", math.inf)
    return Estimate(value, stderr, table.text("unit"), table.flag("identified"))


def _noise_of(table: FieldTable) -> RecordingNoise:
    table.only(NOISE)
    return RecordingNoise(*(table.number(key) for key in NOISE))


def _known(root: FieldTable, key: str, parameters: dict[str, Estimate]) -> tuple[str, ...]:
    """The labels under `key`, all of them of `parameters`."""
    labels = root.texts(key)
    for label in labels:
        if label not in parameters:
            root.fail(key, f"`{shown(label)}` is not one of `parameters`")
    return labels


def drive_json(drive: Drive) -> dict[str, Any]:
    """A `drive` as `drive_of` reads it.

    **Raises:** `ValueError` for a drive with arrays in place of numbers.
    """

    def number(value: Float[Array, "..."]) -> Float[Array, "..."]:
        if value.ndim:
            raise ValueError(f"A drive of shape {value.shape} has no file: save its members one by one.")
        return value

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
        **({} if drive.hold == HOLDS[0] else {"hold": drive.hold}),
    }


def _not_strict(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number of strict JSON")
