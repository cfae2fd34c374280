"""JSON: a list of numbers for each channel, or a list of samples, or one sample a line."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.packed import contents
from frictionjax.recordings.words import shown

_CURE = (
    'Write {"t": [...], "u": [...], "x": [...]}, or a list of samples [{"t": ..., "u": ..., "x": ...}, ...]'
)


def open_json(path: Path) -> ArrayTable:
    """Open a JSON file: `{"t": [...], "x": [...]}`, also nested (`run.x`), `[{"t": 0.0, "x": 1.0}, ...]`, one such
    object a line, or `{"columns": [...], "data": [[...], ...]}`.

    **Arguments:**

    - `path`: an existing file, also gzipped.

    **Returns:** its table; null is NaN.

    **Raises:** `InputError` for what is not JSON, and for JSON without a list of numbers.
    """
    content = _parsed(contents(path), path)
    found = Collected("list")
    if (
        isinstance(content, dict)
        and isinstance(content.get("columns"), list)
        and isinstance(content.get("data"), list)
    ):
        names, rows = [str(name) for name in content["columns"]], content["data"]
        if not all(isinstance(row, list) and len(row) == len(names) for row in rows):
            raise InputError(
                "a row of `data` has another length than `columns`",
                file=shown(path, 200),
                cure="Complete the rows",
            )
        content = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    _collect("", content, found)
    return found.table(path)


def _parsed(data: bytes, path: Path) -> Any:
    try:
        text = data.decode("utf-8-sig")
        try:
            return json.loads(text)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2 or not lines[0].lstrip().startswith("{") or not lines[0].rstrip().endswith("}"):
                raise
            return [json.loads(line) for line in lines]
    except json.JSONDecodeError as error:
        raise InputError(
            f"is not JSON: {error.msg}", file=shown(path, 200), place=f"line {error.lineno}", cure=_CURE
        ) from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:  # the last: a number of too many digits
        raise InputError(f"is not JSON ({shown(error, 80)})", file=shown(path, 200), cure=_CURE) from None


def _collect(name: str, content: Any, found: Collected) -> None:
    """Add what `content` holds under a `name`: lists of numbers, samples, and objects of these."""
    if isinstance(content, dict):
        for key, value in content.items():
            _collect(f"{name}.{key}" if name else str(key), value, found)
    elif isinstance(content, list) and content and all(isinstance(sample, dict) for sample in content):
        keys = dict.fromkeys(key for sample in content for key in sample)
        for key in keys:
            _collect(f"{name}.{key}" if name else str(key), [sample.get(key) for sample in content], found)
    elif isinstance(content, list):
        try:
            values = np.array([np.nan if value is None else value for value in content])
        except (ValueError, OverflowError):  # lists of different lengths
            found.refused[name] = "holds lists of different lengths, not numbers"
            return
        found.add(name, values)
