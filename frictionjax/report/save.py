"""Saving a diagnosis: verdict.json, comparisons.json and fit/*.csv in one step, then report.html."""

import dataclasses
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.core.json import plain_json
from frictionjax.diagnosis.checked import Check
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.table import SCHEMA as COMPARISONS
from frictionjax.diagnosis.table import table_json
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.recordings import Case
from frictionjax.recordings.words import shown
from frictionjax.report.claim import Claim, claimed, uninterrupted
from frictionjax.report.fit_csv import fit_files, write_fit_csv
from frictionjax.report.page import write_report
from frictionjax.report.replace import CURE, FILES, VERDICT, put_in_place, refuse_foreign

SCHEMA = "frictionjax.verdict/1"
_BYTES = 16  # of a number of fit/*.csv and comparisons.json: up to 15 characters and a sign
_NUMBERS = 11  # a sample; one more where there is a simulation of the user's


def verdict_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of verdict.json, schema `frictionjax.verdict/1`, as plain JSON types.

    Numbers that are not finite become None, so that the file is strict JSON.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    A dictionary with the schema's keys in the schema's order; lengths, forces and inputs are in `units`.
    """
    plant, unexplained = diagnosis.plant, diagnosis.unexplained
    files = fit_files(recording.name for recording in diagnosis.recordings)
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
                "evidence": found.evidence,
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
        "fit": {
            recording.name: _fit_json(recording) | {"file": f"fit/{files[recording.name]}"}
            for recording in diagnosis.recordings
        },
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
        "plant": plant,
        "units": {"position": plant.position_unit, "force": plant.force_unit, "input": plant.input_unit},
        "mismatch_within": [
            {
                "axis": part.axis,
                "bin": part.bin,
                "phrase": part.phrase,
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
        "ceiling": diagnosis.ceiling and dataclasses.asdict(diagnosis.ceiling),
        "as_given": diagnosis.given and dataclasses.asdict(diagnosis.given),
        "check": diagnosis.check and _check_json(diagnosis.check),
        "frictionjax": version("frictionjax"),
    }
    return plain_json(content)


def comparisons_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of comparisons.json, schema `frictionjax.comparisons/1`: every comparison of two models that
    the `diagnosis` made, what else it decided by numbers, with the rule and the effort of the search; and the residual
    force of the extended model along each recording, for which fit/*.csv has no column."""
    content = {
        "schema": COMPARISONS,
        "case": diagnosis.case,
        "rule": dataclasses.asdict(diagnosis.rule),
        "effort": dataclasses.asdict(diagnosis.effort),
        "tables": [table_json(table) for table in diagnosis.comparisons],
        "decided": [dataclasses.asdict(one) for one in diagnosis.decided],
        "experiments": {found.effect: found.next_experiment for found in diagnosis.missing},
        "residual_force_extended": {
            recording.name: [float(f"{force:.9g}") for force in recording.residual_force_extended.tolist()]
            for recording in diagnosis.recordings
        },
        "frictionjax": version("frictionjax"),
    }
    return plain_json(content)


def check_writable(directory: str | Path, case: Case | None = None) -> None:
    """Raise `InputError` unless `save_diagnosis` could write into `directory` now; changes nothing.

    Called before a long computation, so that its result is not lost to a mistyped path.

    **Arguments:**

    - `directory`: where the result is to go; it and its parents need not exist.
    - `case`: what is to be diagnosed; with it, the files of its recordings are checked, too.
    """
    directory = Path(directory).absolute()
    recordings = () if case is None else case.recordings
    files = list(fit_files(recording.name for recording in recordings).values())
    with _sentences(directory):
        anchor = _nearest_existing(directory)
        if not anchor.is_dir():
            raise InputError("is a file, so no result can be written there", file=anchor, cure=CURE)
        # Trying beats asking: permission bits do not show read-only file systems, nor do they bind root.
        tempfile.TemporaryFile(dir=anchor).close()
        longest = os.pathconf(anchor, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255
        for name in (*directory.relative_to(anchor).parts, *files):
            if len(os.fsencode(name)) > longest:
                problem = f'"{shown(name)}" is too long for a name there, by {len(os.fsencode(name)) - longest} bytes'
                raise InputError(problem, file=anchor, cure="Shorten it")
        for name in FILES:
            if (directory / name).is_dir():
                raise InputError("is a directory where a file is to go", file=directory / name, cure=CURE)
        if (directory / "fit").exists() and not (directory / "fit").is_dir():
            raise InputError("is a file where a directory is to go", file=directory / "fit", cure=CURE)
        refuse_foreign(directory, [Path("fit", name) for name in files])
        modelled = case is not None and case.model is not None
        counts = (_NUMBERS + (modelled or one.simulated is not None) for one in recordings)
        needed = _BYTES * sum(count * one.x.size for count, one in zip(counts, recordings, strict=True))
        if shutil.disk_usage(anchor).free < needed:
            problem = f"has no room for the result, which takes {needed / 1e6:.3g} MB"
            raise InputError(problem, file=anchor, cure=CURE)


@contextmanager
def reserved(directory: str | Path, case: Case | None = None) -> Iterator[None]:
    """Keep an output directory for this run, from before the work until its result is written.

    **Arguments:** `directory` and `case`, as `check_writable` has them.

    **Raises:** `InputError` as `check_writable` does, and where another run writes into the directory.
    """
    check_writable(directory, case)
    with ExitStack() as stack:
        with _sentences(Path(directory).absolute()):
            stack.enter_context(claimed(Path(directory)))
        yield


def save_diagnosis(diagnosis: Diagnosis, directory: str | Path, *, report: bool = True) -> Path:
    """Write verdict.json, comparisons.json, fit/*.csv and report.html into `directory`.

    The numbers come first, all of them in one step; then the report is drawn. A report that cannot be drawn is left
    out, with a `FrictionjaxWarning`. Results of an earlier run in `directory` are replaced; any other file in it is
    left alone.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.
    - `directory`: where to write; created with its parents when missing.
    - `report`: whether report.html, whose figures take a second or two, is written too.

    **Returns:**

    `directory`, as a Path. Raises `InputError` when it cannot be written: then an earlier result is still there.
    """
    check_writable(directory)
    with _sentences(Path(directory).absolute()), claimed(Path(directory)) as claim:
        fresh = claim.staging / "new"
        fresh.mkdir()
        _write_numbers(diagnosis, fresh)
        with uninterrupted():
            put_in_place(fresh, claim.target, claim.staging)
        if report:
            _add_report(diagnosis, claim)
    return Path(directory)


def rescue_diagnosis(diagnosis: Diagnosis) -> Path:
    """Write what `save_diagnosis` writes, without the report, into a new folder for temporary files; returns it.

    **Arguments:**

    - `diagnosis`: what `diagnose` found, and no other directory took.

    **Raises:** `InputError` where no folder for temporary files takes it either.
    """
    with _sentences(Path("TMPDIR")):  # no folder at all may have room
        directory = Path(tempfile.mkdtemp(prefix="frictionjax-"))
    with _sentences(directory):
        _write_numbers(diagnosis, directory)
    return directory


def _check_json(check: Check) -> dict[str, Any]:
    names = [
        dataclasses.asdict(name) | {"interval": name.interval, "sentence": name.sentence}
        for name in check.names
    ]
    return dataclasses.asdict(check) | {"names": names, "right": check.right, "sentences": check.sentences}


def _fit_json(recording: RecordingFit) -> dict[str, Any]:
    models = ("base", "extended", *(("given",) if recording.free_run_rmse_given is not None else ()))
    kinds = ("free_run_rmse", "prediction_rmse", "increment_rmse")
    errors: dict[str, dict[str, Any]] = {
        model: {kind: getattr(recording, f"{kind}_{model}") for kind in kinds} for model in models
    }
    for model in ("base", "extended"):
        if errors[model]["increment_rmse"] is None:
            del errors[model]["increment_rmse"]
        lacking = getattr(recording, f"unmeasured_{model}")
        errors[model]["unmeasured_force"] = lacking and dataclasses.asdict(lacking)
    horizons = [dataclasses.asdict(horizon) for horizon in recording.horizons]
    found = {"role": recording.role, "noise_floor": recording.noise_floor, **errors, "horizons": horizons}
    if recording.sensor_noise is not None:
        found["sensor_noise"] = recording.sensor_noise
    if recording.closed_loop is not None:
        # What it has not is absent: null is a number that is not finite.
        closed = dataclasses.asdict(recording.closed_loop)
        found["closed_loop"] = {name: value for name, value in closed.items() if value is not None}
    return found


def _write_numbers(diagnosis: Diagnosis, directory: Path) -> None:
    for name, content, indent in (
        (VERDICT, verdict_json(diagnosis), 1),
        ("comparisons.json", comparisons_json(diagnosis), None),
    ):
        text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
        # Half a character, of a file name that is not UTF-8, is written as JSON escapes it.
        (directory / name).write_bytes((text + "\n").encode("utf-8", "backslashreplace"))
    (directory / "fit").mkdir()
    files = fit_files(recording.name for recording in diagnosis.recordings)
    for recording in diagnosis.recordings:
        write_fit_csv(recording, directory / "fit" / files[recording.name])


def _add_report(diagnosis: Diagnosis, claim: Claim) -> None:
    """report.html beside the numbers; whatever prevents it, these are there."""
    drawn = claim.staging / "report"
    drawn.mkdir(exist_ok=True)  # a run may save twice: without its check, and with it
    try:
        write_report(diagnosis, drawn)
        (drawn / "report.html").replace(claim.target / "report.html")
    except Exception as error:
        said = f"report.html is missing, as it could not be written ({type(error).__name__}: {error})."
        warnings.warn(FrictionjaxWarning(said), stacklevel=3)


def _nearest_existing(directory: Path) -> Path:
    """The first of a directory and its parents that is there; raises `InputError` for a link to nothing among them."""
    for path in (directory, *directory.parents):
        with suppress(OSError):  # a name too long for a file system: there is none
            if path.exists():
                return path
            if path.is_symlink():
                raise InputError("is a link to a folder that does not exist", file=path, cure=CURE)
    raise InputError("does not exist", file=directory.anchor, cure=CURE)


@contextmanager
def _sentences(directory: Path) -> Iterator[None]:
    """An error of the file system becomes an `InputError` about the output directory."""
    try:
        yield
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise InputError(problem, file=error.filename or directory, cure=CURE) from error
