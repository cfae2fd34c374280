"""Saving a diagnosis: verdict.json, comparisons.json, fit/*.csv and report.html, all of it or nothing."""

import dataclasses
import json
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.core.json import plain_json
from frictionjax.diagnosis.table import SCHEMA as COMPARISONS
from frictionjax.diagnosis.table import table_json
from frictionjax.diagnosis.verdict import Diagnosis, RecordingFit
from frictionjax.report.page import write_report

SCHEMA = "frictionjax.verdict/1"
COLUMNS = (
    "t",
    "u",
    "x",
    "free_base",
    "free_extended",
    "predicted_base",
    "predicted_extended",
    "residual_force",
    "residual_force_std",
)
_HEADER = ",".join(COLUMNS)
_CURE = "Choose another output directory, or make room for this one."


def verdict_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of verdict.json, schema `frictionjax.verdict/1`, as plain JSON types.

    Numbers that are not finite become None, so that the file is strict JSON.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    A dictionary with the schema's keys in the schema's order; lengths, forces and inputs are in `units`.
    """
    plant, unexplained = diagnosis.plant, diagnosis.unexplained
    content = {
        "schema": SCHEMA,
        "case": diagnosis.case,
        "verdict": diagnosis.verdict,
        "summary": diagnosis.summary,
        "missing": [
            {
                "effect": found.effect,
                "class": found.effect_class,
                "confidence": found.confidence,
                "p_value": found.p_value,
                "parameters": found.parameters,
                "where": found.where,
                "split_by": found.split_by,
                "sentence": found.sentence,
            }
            for found in diagnosis.missing
        ],
        "unexplained": {
            "present": unexplained.present,
            "share": unexplained.share,
            "where": unexplained.where,
            "carried_by": unexplained.carried_by,
            "explains": unexplained.explains,
        },
        "mismatch": [
            {
                "axis": cell.axis,
                "bin": cell.bin,
                "share": cell.share,
                "excess": cell.excess,
                "excess_extended": cell.excess_extended,
                "count": cell.count,
                "p_value": cell.p_value,
            }
            for cell in diagnosis.mismatch
        ],
        "base": {"parameters": diagnosis.base},
        "extended": {"parameters": diagnosis.extended},
        "fit": {recording.name: _fit_json(recording) for recording in diagnosis.recordings},
        "candidates": [
            {
                "effect": candidate.effect,
                "p_value": candidate.p_value,
                "minimum_detectable": candidate.minimum_detectable,
                "tested": candidate.tested,
                "reason": candidate.reason,
                "gain_fit": candidate.gain_fit,
                "gain_holdout": candidate.gain_holdout,
                "one_step": candidate.one_step,
                "units": candidate.units,
            }
            for candidate in diagnosis.candidates
        ],
        "warnings": diagnosis.warnings,
        "seconds": diagnosis.seconds,
        "units": {"position": plant.position_unit, "force": plant.force_unit, "input": plant.input_unit},
        "mismatch_within": [
            {
                "axis": part.axis,
                "bin": part.bin,
                "given": part.given,
                "only": part.only,
                "share": part.share,
                "samples": part.samples,
                "excess": part.excess,
                "excess_elsewhere": part.excess_elsewhere,
                "p_value": part.p_value,
            }
            for part in diagnosis.within
        ],
        "unmeasured_force": diagnosis.unmeasured and dataclasses.asdict(diagnosis.unmeasured),
        "frictionjax": version("frictionjax"),
    }
    return plain_json(content)


def comparisons_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of comparisons.json, schema `frictionjax.comparisons/1`: every comparison of two models that the
    search of the `diagnosis` made, with the rule and the effort of the search."""
    content = {
        "schema": COMPARISONS,
        "case": diagnosis.case,
        "rule": dataclasses.asdict(diagnosis.rule),
        "effort": dataclasses.asdict(diagnosis.effort),
        "tables": [table_json(table) for table in diagnosis.comparisons],
        "frictionjax": version("frictionjax"),
    }
    return plain_json(content)


def check_writable(directory: str | Path) -> None:
    """Raise `InputError` unless `save_diagnosis` could write into `directory` now; changes nothing.

    Called before a long computation, so that its result is not lost to a mistyped path.

    **Arguments:**

    - `directory`: where the result is to go; it and its parents need not exist.
    """
    directory = Path(directory).absolute()
    with _sentences(directory):
        anchor = _nearest_existing(directory)
        if not anchor.is_dir():
            raise InputError("is a file, so no result can be written there", file=anchor, cure=_CURE)
        # Trying beats asking: permission bits do not tell of read-only file systems, nor do they bind root.
        Path(tempfile.mkdtemp(dir=anchor, prefix=".frictionjax-")).rmdir()
        for name in ("verdict.json", "comparisons.json", "report.html"):
            if (directory / name).is_dir():
                raise InputError("is a directory where a file is to go", file=directory / name, cure=_CURE)
        if (directory / "fit").exists() and not (directory / "fit").is_dir():
            raise InputError("is a file where a directory is to go", file=directory / "fit", cure=_CURE)


def save_diagnosis(diagnosis: Diagnosis, directory: str | Path, *, report: bool = True) -> Path:
    """Write verdict.json, comparisons.json, fit/*.csv and report.html into `directory`: all of them, or none.

    Everything is written into a temporary directory first and moved into place by renaming. Results of an
    earlier run in `directory` are replaced; any other file in it is left alone.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.
    - `directory`: where to write; created with its parents when missing.
    - `report`: whether report.html, whose figures take a second or two, is written too.

    **Returns:**

    `directory`, as a Path. Raises `InputError` when it cannot be written.
    """
    target = Path(directory).absolute()
    check_writable(target)
    with _sentences(target):
        # Inside the target when there is one: its parent may be read-only, or another file system.
        staging = Path(tempfile.mkdtemp(dir=_nearest_existing(target), prefix=".frictionjax-"))
        try:
            fresh = (
                staging / "new"
            )  # mkdtemp is private to its owner; this one gets the user's own permissions
            fresh.mkdir()
            _write_all(diagnosis, fresh, report)
            _move_into_place(fresh, target, staging / "old")
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    return Path(directory)


def write_fit_csv(recording: RecordingFit, file: Path) -> None:
    """Write one recording's fit/<recording>.csv: columns `COLUMNS`, one row a sample, nine significant digits;
    the measured `force` after them where it is the answer.

    **Arguments:**

    - `recording`: arrays of shape `(n,)`; t in s, the others in the units of the plant.
    - `file`: the file to write.
    """
    columns = COLUMNS if recording.force is None else (*COLUMNS, "force")
    table = np.column_stack([np.asarray(getattr(recording, name), float) for name in columns])
    row = ",".join(["%.9g"] * len(columns)) + "\n"
    with file.open("w", encoding="ascii", newline="") as stream:
        stream.write(",".join(columns) + "\n")
        # One `%` for thousands of rows: three times as fast as row by row.
        for start in range(0, len(table), 4096):
            chunk = table[start : start + 4096]
            stream.write((row * len(chunk)) % tuple(chunk.ravel().tolist()))


def _fit_json(recording: RecordingFit) -> dict[str, Any]:
    return {
        "role": recording.role,
        "noise_floor": recording.noise_floor,
        "base": {
            "free_run_rmse": recording.free_run_rmse_base,
            "prediction_rmse": recording.prediction_rmse_base,
        },
        "extended": {
            "free_run_rmse": recording.free_run_rmse_extended,
            "prediction_rmse": recording.prediction_rmse_extended,
        },
    }


def _write_all(diagnosis: Diagnosis, directory: Path, report: bool) -> None:
    text = json.dumps(verdict_json(diagnosis), indent=1, ensure_ascii=False, allow_nan=False)
    (directory / "verdict.json").write_text(text + "\n", encoding="utf-8")
    text = json.dumps(comparisons_json(diagnosis), ensure_ascii=False, allow_nan=False)
    (directory / "comparisons.json").write_text(text + "\n", encoding="utf-8")
    (directory / "fit").mkdir()
    for recording in diagnosis.recordings:
        stem = re.sub(r"[/\\\0]", "_", recording.name)
        write_fit_csv(recording, directory / "fit" / f"{stem}.csv")
    if report:
        write_report(diagnosis, directory)


def _move_into_place(fresh: Path, target: Path, old: Path) -> None:
    """Rename `fresh` into `target`, an earlier result making way into `old`; any failure puts everything back."""
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        fresh.rename(target)
        return
    new_files = [path.relative_to(fresh) for path in sorted(fresh.rglob("*")) if path.is_file()]
    for name in new_files:
        if name.parent.name == "fit" and (target / name).exists() and not _is_fit_csv(target / name):
            problem = "exists and was not written by frictionjax, so it is not overwritten"
            raise InputError(problem, file=target / name, cure="Choose another output directory.")
    earlier = [path for path in (target / "fit").glob("*.csv") if _is_fit_csv(path)]
    earlier += [target / name for name in new_files if name.parent.name != "fit" and (target / name).exists()]
    moves = [(path, old / path.relative_to(target)) for path in earlier]
    moves += [(fresh / name, target / name) for name in new_files]
    done: list[tuple[Path, Path]] = []
    try:
        for source, destination in moves:
            destination.parent.mkdir(parents=True, exist_ok=True)
            source.rename(destination)
            done.append((source, destination))
    except BaseException:
        for source, destination in reversed(done):
            destination.rename(source)
        raise


def _is_fit_csv(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(_HEADER)) == _HEADER.encode("ascii")


def _nearest_existing(directory: Path) -> Path:
    return next(path for path in (directory, *directory.parents) if path.exists())


@contextmanager
def _sentences(directory: Path) -> Iterator[None]:
    """An error of the file system becomes an `InputError` about the output directory."""
    try:
        yield
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise InputError(problem, file=error.filename or directory, cure=_CURE) from error
