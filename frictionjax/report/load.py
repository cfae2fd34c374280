"""`load_diagnosis`: a saved diagnosis, read back."""

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_args

import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate, InputError
from frictionjax.diagnosis.checked import Check, CheckedAnswer, CheckedName
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.explain import explain_effect
from frictionjax.diagnosis.recording_fit import ClosedLoop, Horizon, RecordingFit, Unmeasured
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import SCHEMA as COMPARISONS
from frictionjax.diagnosis.table import OtherDecision, table_of
from frictionjax.diagnosis.verdict import (
    Candidate,
    Ceiling,
    Diagnosis,
    MismatchBin,
    MissingEffect,
    NextExperiment,
    OneStep,
    SimulationAsGiven,
    Unexplained,
    Verdict,
    Within,
)
from frictionjax.exchange.table import FieldTable
from frictionjax.recordings import Plant
from frictionjax.recordings.words import require_file, shown
from frictionjax.report.fit_csv import COLUMNS, OPTIONAL
from frictionjax.report.save import SCHEMA

_T = TypeVar("_T")
_AGAIN = "Diagnose the case again and save it with this version of frictionjax"


def load_diagnosis(directory: str | Path) -> Diagnosis:
    """The diagnosis that `Diagnosis.save`, `save_diagnosis` or the program wrote into `directory`.

    Time series come from the CSV files, with nine significant digits; all other numbers are those that were saved.

    **Arguments:**

    - `directory`: the folder, or the verdict.json in it.

    **Returns:**

    The `Diagnosis`: it can be printed, drawn, explained and saved again. Null in a file is read as infinite in standard
    errors, as NaN elsewhere.

    **Raises:**

    `InputError` for a file that is missing, is not JSON, was written by another version, or lacks a field.
    """
    folder = Path(directory)
    folder = folder.parent if folder.name == "verdict.json" else folder
    root = _json(folder / "verdict.json", SCHEMA)
    searched = _json(folder / "comparisons.json", COMPARISONS)
    verdict = root.text("verdict")
    if verdict not in get_args(Verdict):
        root.fail("verdict", f"{shown(verdict)} is not a verdict")
    experiments = dict(searched.table("experiments").content)
    try:
        return Diagnosis(
            case=root.text("case"),
            plant=Plant(**root.table("plant").content),
            verdict=cast(Verdict, verdict),
            summary=root.text("summary"),
            missing=tuple(_missing(entry, experiments) for entry in root.listed("missing")),
            unexplained=Unexplained(**_numbered(root.table("unexplained").content)),
            mismatch=tuple(MismatchBin(**_numbered(entry.content)) for entry in root.listed("mismatch")),
            base=_estimates(root.table("base").table("parameters")),
            extended=_estimates(root.table("extended").table("parameters")),
            recordings=tuple(
                _recording(folder, name, entry, searched.content["residual_force_extended"][name])
                for name, entry in root.table("fit").tables()
            ),
            candidates=_candidates(root),
            warnings=tuple(root.content["warnings"]),
            seconds=dict(root.table("seconds").content),
            within=tuple(Within(**_numbered(entry.content)) for entry in root.listed("mismatch_within")),
            comparisons=tuple(table_of(entry.content) for entry in searched.listed("tables")),
            decided=tuple(map(_decision_of, searched.content.get("decided", ()))),
            rule=_rebuilt(Rule(), searched.table("rule").content),
            effort=_rebuilt(Effort(), searched.table("effort").content),
            unmeasured=_if_there(root, "unmeasured_force", Unmeasured),
            ceiling=_ceiling(root),
            given=_as_given(root),
            check=None if root.content.get("check") is None else _check(root.table("check")),
        )
    except (TypeError, KeyError, ValueError) as error:
        raise _other_fields(error, folder / "verdict.json") from error


def _decision_of(content: Mapping[str, Any]) -> OtherDecision:
    """The decision of this `content`; JSON has no infinity."""
    numbers = {name: math.inf if value is None else value for name, value in content["numbers"].items()}
    return OtherDecision(content["about"], numbers)


def _if_there(root: FieldTable, name: str, kind: Callable[..., _T]) -> _T | None:
    """The numbers `name` of a verdict as a noun of this `kind`; None where it has none."""
    return None if root.content.get(name) is None else kind(**_numbered(root.table(name).content))


def _ceiling(root: FieldTable) -> Ceiling | None:
    """What a free force would explain; None where it was not asked."""
    if root.content.get("ceiling") is None:
        return None
    table = root.table("ceiling")
    # Earlier versions did not say it of each recording.
    rows = table.listed("recordings") if "recordings" in table.content else ()
    whole = {name: value for name, value in table.content.items() if name != "recordings"}
    return Ceiling(**_numbered(whole), recordings=tuple(OneStep(**_numbered(row.content)) for row in rows))


def _as_given(root: FieldTable) -> SimulationAsGiven | None:
    """The comparison with the user's own simulation; None where there is none."""
    if root.content.get("as_given") is None:
        return None
    table = root.table("as_given")
    bins = tuple(MismatchBin(**_numbered(entry.content)) for entry in table.listed("mismatch"))
    return SimulationAsGiven(
        cast(Any, table.text("source")), table.text("sentence"), table.text("where"), bins
    )


def _check(entry: FieldTable) -> Check:
    names = tuple(
        CheckedName(**{field.name: one.content[field.name] for field in dataclasses.fields(CheckedName)})
        for one in entry.listed("names")
    )
    answers = tuple(
        CheckedAnswer(
            tuple(one.content["acting"]),
            one.text("verdict"),
            tuple(one.content["named"]),
            one.flag("right"),
            one.content["machines"],
        )
        for one in entry.listed("answers")
    )
    return Check(entry.content["machines"], entry.content["failed"], names, answers)


class _Searched(NamedTuple):
    """The part of a verdict that an explanation needs."""

    candidates: tuple[Candidate, ...]
    missing: tuple[MissingEffect, ...]


def explain_saved(path: Path, effect: str) -> dict[str, Any]:
    """Why an `effect` was named or not, from the verdict.json at `path` alone.

    **Returns:** plain JSON: `effect`; `named`, whether it was; `explanation`, as `Diagnosis.explain` says it; and
    `candidate`, its entry in verdict.json.

    **Raises:** `InputError` as `load_diagnosis` does, and for a name that is not among its candidates.
    """
    root = _json(path, SCHEMA)
    try:
        searched = _Searched(
            _candidates(root), tuple(_missing(entry, {}) for entry in root.listed("missing"))
        )
    except (TypeError, KeyError, ValueError) as error:
        raise _other_fields(error, path) from error
    explanation = explain_effect(searched, effect)
    candidate = next(one.content for one in root.listed("candidates") if one.content["effect"] == effect)
    named = any(found.effect == effect for found in searched.missing)
    return {"effect": effect, "named": named, "explanation": explanation, "candidate": dict(candidate)}


def _candidates(root: FieldTable) -> tuple[Candidate, ...]:
    return tuple(Candidate(**_numbered(entry.content)) for entry in root.listed("candidates"))


def _other_fields(error: Exception, path: Path) -> InputError:
    """The error for what does not fit the fields of this version."""
    if isinstance(error, InputError):
        return error
    problem = f"has other fields than this version of frictionjax knows ({shown(error)})"
    return InputError(problem, file=path, cure=_AGAIN)


def _json(path: Path, schema: str) -> FieldTable:
    """The file `path` of a saved diagnosis, whose schema must be `schema`."""
    require_file(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {shown(error)}", file=path, cure=_AGAIN) from error
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path, cure="Check its rights") from error
    if not isinstance(content, dict):
        raise InputError("is JSON, but not a table with a `schema`", file=path, cure=_AGAIN)
    root = FieldTable(content, "", path, _AGAIN)
    if content.get("schema") != schema:
        found = json.dumps(content.get("schema"))
        root.fail("schema", f"the schema is {shown(found)}, not {json.dumps(schema)}")
    return root


def _missing(entry: FieldTable, experiments: Mapping[str, Any]) -> MissingEffect:
    content = dict(entry.content)
    own = experiments.get(content["effect"])
    return MissingEffect(
        effect=entry.text("effect"),
        effect_class=entry.texts("class"),
        confidence=entry.number("confidence"),
        p_value=entry.number("p_value"),
        parameters=_estimates(entry.table("parameters")),
        where=entry.text("where"),
        split_by=entry.text("split_by"),
        sentence=entry.text("sentence"),
        evidence=tuple(_number(value) for value in content["evidence"]),
        next_experiment=None if own is None else _planned(own),
    )


def _planned(content: Mapping[str, Any]) -> NextExperiment:
    fields: dict[str, Any] = {
        **_numbered(content),
        "between": tuple(content["between"]),
        "u": np.array(content["u"], dtype=float),
    }
    return NextExperiment(**fields)


def _estimates(table: FieldTable) -> dict[str, Estimate]:
    return {
        name: Estimate(
            entry.number("value"),
            entry.number("stderr", math.inf),
            entry.text("unit"),
            entry.flag("identified"),
        )
        for name, entry in table.tables()
    }


def _recording(folder: Path, name: str, entry: FieldTable, left: list[float | None]) -> RecordingFit:
    """The recording of this `name`, whose extended model leaves the residual force `left`."""
    role = entry.text("role")
    columns: dict[str, Any] = dict(_csv(require_file(folder / entry.text("file"))))
    models = ("base", "extended", *(("given",) if "given" in entry.content else ()))
    errors: dict[str, Any] = {
        f"{kind}_{model}": entry.table(model).number(kind)
        for model in models
        for kind in ("free_run_rmse", "prediction_rmse", "increment_rmse")
        # What a model has not is null, or absent in what earlier versions saved; what is not finite is null as well.
        if kind == "free_run_rmse" or entry.table(model).content.get(kind) is not None or _must(kind, model)
    }
    horizons = entry.listed("horizons") if "horizons" in entry.content else []
    return RecordingFit(
        name=name,
        role=cast(Any, role),
        horizons=tuple(Horizon(**_numbered(one.content)) for one in horizons),
        unmeasured_base=_if_there(entry.table("base"), "unmeasured_force", Unmeasured),
        unmeasured_extended=_if_there(entry.table("extended"), "unmeasured_force", Unmeasured),
        closed_loop=_if_there(entry, "closed_loop", ClosedLoop),
        drive="motion" if "force" in columns else "force",
        residual_force_extended=np.array([_number(force) for force in left]),
        noise_floor=entry.number("noise_floor"),
        sensor_noise=entry.number("sensor_noise") if "sensor_noise" in entry.content else None,
        **errors,
        **columns,
    )


def _must(kind: str, model: str) -> bool:
    """Whether every diagnosis has this error of this model: null is then a number that is not finite."""
    return kind == "prediction_rmse" and model != "given"


def _csv(path: Path) -> dict[str, Float[np.ndarray, " n"]]:
    """The columns of a recording's file, shape `(n,)` each."""
    with path.open(encoding="ascii", errors="replace") as stream:
        header = stream.readline().strip().split(",")
        needed = (*COLUMNS, *(name for name in OPTIONAL if name in header))
        lacking = [name for name in needed if name not in header]
        if lacking:
            raise InputError(f"there is no column `{lacking[0]}`", file=path, place="line 1", cure=_AGAIN)
        try:
            table = np.loadtxt(stream, delimiter=",", ndmin=2, usecols=[header.index(n) for n in needed])
        except ValueError as error:
            raise InputError(f"holds no table of numbers: {shown(error)}", file=path, cure=_AGAIN) from error
    return {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(needed)}


def _numbered(content: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a table of texts and numbers, in which null stands for what is not finite."""
    return {key: _plain(value) for key, value in content.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return _numbered(value)
    return math.nan if value is None else value


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _rebuilt(default: Any, content: Mapping[str, Any]) -> Any:
    """The frozen dataclass of numbers like `default`, with the values of `content`."""
    changes = {}
    for field in dataclasses.fields(default):
        value, before = content[field.name], getattr(default, field.name)
        if dataclasses.is_dataclass(before):
            value = _rebuilt(before, value)
        changes[field.name] = _tuples(value)
    return dataclasses.replace(default, **changes)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
