"""A study as a file, design.toml: read, checked, and an example with every key."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from frictionjax.diagnosis.intake.own_model import OwnModel
    from frictionjax.physics import Drive
    from frictionjax.physics.effects import AbstractEffect
    from frictionjax.studies import Axis, Experiment, Study

EXAMPLE = """\
# frictionjax study design.toml --out study.zarr

[study]
task = "response"       # simulate, response (FRF, then stiffness and damping), fit, diagnose, or discriminate
seed = 0
design = "factorial"    # factorial (every combination), random, or sobol
repeats = 20            # of each combination; a random or sobol design has `cases` instead
# units = {stiffness = "N/m"}

# Each axis has values, or low, high and count (of a factorial design). Its name is a parameter of the machine or of one
# of its effects, or level, noise, encoder_step or signal of the experiment.
[axes.noise]
low = 1e-9
high = 1e-7
count = 3
scale = "log"           # linear, log, or normal (random and sobol: 95 % of the cases from low to high)
unit = "m"

[axes.sigma0]
values = [5e4, 1e5]
unit = "N/m"

[machine]
motor_constant = 1.0
parameters = {J = 1.0, sigma0 = 1e5, sigma1 = 316.0, sigma2 = 0.4, Fc = 1.0, Fs = 1.5, vs = 1e-3}
effects = [{name = "constant_load", load = 0.05}]

# Several [[experiment]] for the tasks fit and diagnose; a diagnosis needs one with role = "holdout".
[[experiment]]
signal = "prbs"         # prbs, gaussian, multisine, or ramp
samples = 8192
sample_rate = 2000.0    # Hz
level = 0.1             # rms of the input over the static friction; of a ramp, its end
bandwidth = 500.0       # Hz
noise = 0.0             # standard deviation of the position, position units
encoder_step = 0.0      # position units; zero: none
substeps = 2            # integration steps per sample

[response]
band = [3.0, 150.0]     # Hz
segment = 1024          # samples

# [fit]
# free = ["Fc", "Fs", "vs"]

# Could the experiment distinguish these two effects? The axis `size` multiplies their strengths.
# [discriminate]
# first = {name = "maxwell_slip", share = 0.5}
# second = {name = "elasto_plastic", plasticity = 0.8}    # without it: the machine as it is
"""
"""What `frictionjax study --example` prints."""

_TASKS = ("simulate", "response", "fit", "diagnose", "discriminate")
_DESIGNS = ("factorial", "random", "sobol")
_KEYS = {
    "": ("study", "axes", "machine", "experiment", "response", "fit", "discriminate"),
    "study": ("task", "seed", "design", "design_seed", "repeats", "cases", "same_draws", "units"),
    "axis": ("values", "low", "high", "scale", "count", "unit"),
    "machine": ("motor_constant", "parameters", "effects"),
    "experiment": (
        *(
            "signal",
            "samples",
            "sample_rate",
            "level",
            "bandwidth",
            "noise",
            "encoder_step",
            "substeps",
            "role",
        ),
    ),
    "response": ("band", "segment"),
    "fit": ("free",),
    "discriminate": ("first", "second", "free", "refit_steps"),
}


def study_of(path: Path) -> "Study":
    """The study in the file `path`.

    **Raises:** `InputError` where it cannot be read, lacks something, or has a key or a value that makes no sense; with
        the file and the key.
    """
    from frictionjax.core import InputError

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            "there is no such file", file=path, cure="`frictionjax study --example > design.toml` writes one"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", file=path, cure="Give a design file") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is no TOML ({error})", file=path, cure="Correct that line") from error
    file = _File(path)
    file.keys("", tables)
    study = file.table(tables, "study")
    file.keys("study", study)
    try:
        return _study(file, tables, study)
    except InputError as error:
        if error.file is None:
            raise InputError(error.problem, file=path, place=error.place, cure=error.cure) from error
        raise
    except TypeError as error:
        raise InputError(
            f"a value is of the wrong kind: {error}", file=path, cure="Compare the example"
        ) from error


class _File:
    """The file at `path`, for messages."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, problem: str, place: str, cure: str) -> NoReturn:
        """Raise the `InputError` of a `problem` at a `place`, with its `cure`."""
        from frictionjax.core import InputError

        raise InputError(problem, file=self.path, place=place, cure=cure)

    def keys(self, kind: str, table: dict[str, Any], place: str | None = None) -> None:
        """Refuse keys that no table of this `kind` has."""
        place = f"[{kind}]" if place is None and kind else place or ""
        for key in table:
            if key not in _KEYS[kind]:
                self.fail(f"`{key}` is no key", place, f"Known: {', '.join(_KEYS[kind])}")

    def table(self, tables: dict[str, Any], name: str) -> dict[str, Any]:
        """The table with this `name`, which must be there."""
        found = tables.get(name)
        if not isinstance(found, dict) or not found:
            self.fail(f"there is no table [{name}]", "", f"Write [{name}] on a line, and its keys below it")
        return found

    def choice(self, table: dict[str, Any], key: str, known: tuple[str, ...], default: str) -> str:
        """One of the texts `known`."""
        found = table.get(key, default)
        if found not in known:
            self.fail(f"`{key}` is {found!r}", "[study]", f"Choose one of: {', '.join(known)}")
        return found


def _study(file: _File, tables: dict[str, Any], study: dict[str, Any]) -> "Study":
    from frictionjax.studies import Factorial, RandomDesign, SobolDesign, Study

    axes = _axes(file, tables.get("axes", {}))
    kind = file.choice(study, "design", _DESIGNS, "factorial")
    wrong = ("cases", "design_seed") if kind == "factorial" else ("repeats", "same_draws")
    for key in wrong:
        if key in study:
            file.fail(
                f"a {kind} design has no `{key}`", "[study]", "Leave it out, or choose another `design`"
            )
    if kind == "factorial":
        design = Factorial(*axes, repeats=study.get("repeats", 1), same_draws=study.get("same_draws", False))
    else:
        if "cases" not in study:
            file.fail(f"a {kind} design needs the number of its `cases`", "[study]", "Write cases = 1024")
        made = RandomDesign if kind == "random" else SobolDesign
        design = made(*axes, cases=study["cases"], design_seed=study.get("design_seed", 0))
    return Study(design, _task(file, tables, study), seed=study.get("seed", 0))


def _axes(file: _File, tables: Any) -> "list[Axis]":
    from frictionjax.studies import Axis

    if not isinstance(tables, dict) or not all(isinstance(one, dict) for one in tables.values()):
        file.fail("an axis is no table", "[axes]", "Write [axes.noise] on a line, and its keys below it")
    axes = []
    for name, table in tables.items():
        file.keys("axis", table, f"[axes.{name}]")
        axes.append(Axis(name, **table))
    return axes


def _task(file: _File, tables: dict[str, Any], study: dict[str, Any]) -> Any:
    from frictionjax.studies import DiagnosisTask, DiscriminationTask, FitTask, ResponseTask, SimulationTask

    name = file.choice(study, "task", _TASKS, "response")
    machine, experiments = _machine(file, tables), _experiments(file, tables.get("experiment", []))
    units = study.get("units", {})
    for other in ("response", "fit", "discriminate"):
        if other in tables:
            file.keys(other, tables[other])
            if other != name:
                file.fail(f"the task is {name!r}", f"[{other}]", "Leave this table out")
    if name in ("simulate", "response", "discriminate") and len(experiments) > 1:
        file.fail(f"there are {len(experiments)} experiments", "[[experiment]]", f"The task {name!r} has one")
    if name == "simulate":
        return SimulationTask(machine, experiments[0], units=units)
    if name == "response":
        own = dict(tables.get("response", {}))
        if "band" in own:
            own["band"] = tuple(own["band"])
        return ResponseTask(machine, experiments[0], units=units, **own)
    if name == "fit":
        return FitTask(machine, experiments, units=units, **tables.get("fit", {}))
    if name == "discriminate":
        own = dict(file.table(tables, "discriminate"))
        first, second = (_effect(file, own.pop(key, None), key) for key in ("first", "second"))
        return DiscriminationTask(machine, first, second, experiments[0], units=units, **own)
    return DiagnosisTask(machine, experiments, units=units)


def _experiments(file: _File, tables: Any) -> "list[Experiment]":
    from frictionjax.studies import Experiment

    tables = [tables] if isinstance(tables, dict) else tables
    for number, table in enumerate(tables, start=1):
        file.keys("experiment", table, f"[[experiment]] {number}")
    return [Experiment(**table) for table in tables] or [Experiment()]


def _machine(file: _File, tables: dict[str, Any]) -> "Drive":
    from frictionjax.physics import Drive, LuGre

    table = dict(file.table(tables, "machine"))
    file.keys("machine", table)
    constant = table.pop("motor_constant", 1.0)
    model = _model(file, table, "[machine]")
    needed = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    if missing := [name for name in needed if name not in model.values]:
        file.fail(f"`{missing[0]}` has no value", "[machine] parameters", f"Give all of: {', '.join(needed)}")
    J, *law = (model.values[name] for name in needed)
    return Drive(J, LuGre(*law), constant, model.effects)


def _effect(file: _File, table: Any, key: str) -> "AbstractEffect | None":
    """The effect with the name and the strengths of the `table`; None without one."""
    if table is None:
        return None
    (effect,) = _model(file, {"effects": [table]}, f"[discriminate] {key}").effects
    return effect


def _model(file: _File, table: dict[str, Any], place: str) -> "OwnModel":
    """The parameters and the effects of a `table`."""
    from frictionjax.core import InputError
    from frictionjax.diagnosis.intake.own_model import own_model
    from frictionjax.recordings import Case, Plant
    from frictionjax.recordings.model_table import parse_model

    try:
        return own_model(Case("machine", Plant(), (), parse_model(table, None)))
    except InputError as error:  # it speaks of the [model] of a case
        raise InputError(error.problem, file=file.path, place=place, cure=error.cure) from error
