"""The commands that compute one thing: `fit`, `frf`, `simulate`."""

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from frictionjax.cli.case_options import CaseOptions
from frictionjax.cli.cases import case_of
from frictionjax.cli.kinds import AsJson, Effects, File, Name, Number, Screen
from frictionjax.cli.terminal import say, say_json

if TYPE_CHECKING:
    from frictionjax.core import Estimate
    from frictionjax.physics import Drive
    from frictionjax.recordings import Case, Recording


def fit(
    files: list[File],
    /,
    *,
    effect: Effects = None,
    out: File | None = None,
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    r"""Fit the LuGre model and the inertia, by maximum likelihood.

    Fit the base model, with effects that are already known, to the recordings that are not held out.

    **Arguments:**

    - `files`: one case file (.toml), or the recordings to fit
    - `effect`: effects to fit beside the base model
    - `out`: also write the result there, as JSON
    - `as_json`: print the fit as JSON on stdout, and nothing else
    - `source`: what a case file would say
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax fit run1.csv run2.csv --holdout run3.csv --motor-constant 16 \
          --out fit.json
        frictionjax fit case.toml --effect return_spring constant_load
    """
    from frictionjax.estimation import fit
    from frictionjax.exchange import save_fit
    from frictionjax.exchange.fit_file import fit_to_json
    from frictionjax.report.format import shown_estimates

    _check_folder(out)
    case = case_of(files, source)
    plant = case.plant
    units = {"force": plant.force_unit, "position": plant.position_unit, "input": plant.input_unit}
    terminal.progress("starting values", 0.0)
    results = {}
    decides = plant.hold == "auto" and case.fit_recordings[0].drive == "force"
    holds = ("zero", "linear") if decides else (plant.hold,)
    for hold in holds:
        own = dataclasses.replace(case, plant=dataclasses.replace(plant, hold=hold))
        starts, fixed = _starts(own, effect or [])
        results[hold] = fit(
            starts,
            own.fit_recordings,
            fixed=fixed,
            encoder_step=plant.encoder_step,
            units=units,
            progress=terminal.progress,
        )
    hold = min(holds, key=lambda one: results[one].cost) if decides else plant.hold
    result = results[hold]
    if out is not None:
        save_fit(result, out)
    terminal.close()
    if as_json:
        say_json(json.loads(fit_to_json(result)))
        return
    say(_estimate_lines(shown_estimates(result.parameters, plant)))
    say(["", result.message or "The fit converged."])
    if decides:
        gain = max(one.cost for one in results.values()) - result.cost
        words = {"zero": "held", "linear": "linear"}
        say([f"The input is taken to be {words[hold]} between samples, which is likelier by {gain:.3g} in the "
             "log-likelihood."])  # fmt: skip
    if out is not None:
        say(["", f"Written: {out}"])


def _starts(case: "Case", effects: list[str]) -> "tuple[list[Drive], tuple[str, ...]]":
    """Starting values from the recordings of a `case`: its own model, with `effects` at zero strength beside it; and
    the labels of the parameters that the case fixes."""
    from frictionjax.cli.catalogue import forms_of
    from frictionjax.diagnosis.intake.starting_point import starts_of
    from frictionjax.estimation.parameters import effect_labels

    start, own = starts_of(case)
    beside = tuple(forms_of(name)[0]() for name in effects)  # type: ignore[call-arg]
    drives = [drive.with_effects(*beside) for drive in start.drives]
    labels = effect_labels(drives[0])
    return drives, tuple(sorted(labels.get(path, path.removeprefix("friction.")) for path in own.fixed))


def frf(
    files: list[File],
    /,
    *,
    recording: Name | None = None,
    band: Annotated[tuple[float, float] | None, Parameter(metavar="LOW HIGH")] = None,
    segment: Number = 8192,
    out: File | None = None,
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    """Frequency response of a recording in stick, and the second-order system in it.

    Estimate the frequency response from input to position, and fit inertia, stiffness and damping to it.

    **Arguments:**

    - `files`: one case file (.toml), or the recordings to fit
    - `recording`: which recording of the case (default: the first)
    - `band`: Hz that the second-order system is fitted to
    - `segment`: samples of a segment
    - `out`: write frequency, response and coherence there, CSV
    - `as_json`: print the fitted system as JSON on stdout, and nothing else
    - `source`: what a case file would say
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax frf noise.csv --band 2 150 --motor-constant 16
    """
    import numpy as np

    from frictionjax.core import InputError
    from frictionjax.core.json import plain_json
    from frictionjax.frequency import estimate_frf, fit_sk

    _check_folder(out)
    case = case_of(files, source, needs_holdout=False)
    chosen, plant = _chosen(case, recording), case.plant
    if chosen.drive == "motion":
        raise InputError(
            "its motion is imposed, so it has no input that the position answers to",
            file=chosen.name,
            cure='Give a recording with drive = "force"',
        )
    response = estimate_frf(chosen.u, chosen.x, chosen.sample_rate, segment=segment)
    fitted = None
    if band is not None:
        units = {"force": plant.force_unit, "position": plant.position_unit}
        fitted = fit_sk(response, band, motor_constant=plant.motor_constant or 1.0, units=units)
    if out is not None:
        values = np.asarray(response.response)
        columns = (response.frequency, np.real(values), np.imag(values), response.coherence, response.std)
        _write_csv(out, "frequency,real,imaginary,coherence,std", columns)
    terminal.close()
    names = ("J", "stiffness", "damping", "natural_frequency", "damping_ratio")
    found = {} if fitted is None else {name: getattr(fitted, name) for name in names}
    if as_json:
        content = {"recording": chosen.name, "segment": segment, "band": band}
        content |= {"parameters": found, "warnings": () if fitted is None else fitted.warnings}
        say_json(plain_json(content))
        return
    frequency, coherence = np.asarray(response.frequency), np.asarray(response.coherence)
    say([f"{chosen.name}: {frequency.size} frequencies to {frequency[-1]:.5g} Hz, {frequency[1]:.4g} Hz apart; "
         f"{float(response.averages_effective):.3g} independent averages; median coherence "
         f"{float(np.median(coherence[1:])):.2f}."])  # fmt: skip
    if fitted is None:
        say(
            [
                "No system was fitted: give the band of frequencies in which the machine sticks, --band LOW HIGH."
            ]
        )
    else:
        say(_estimate_lines(found))
        say(fitted.warnings)
    if out is not None:
        say(["", f"Written: {out}"])


def simulate(
    fit: File,
    files: list[File],
    /,
    *,
    recording: Name | None = None,
    out: File,
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    """Run a fitted drive on a recorded input.

    Simulate a fit of `frictionjax fit` on the inputs of recordings, from their first sample on.

    **Arguments:**

    - `fit`: a fit, as `frictionjax fit --out` writes it
    - `files`: one case file (.toml), or recordings
    - `recording`: which recording of the case (default: the first)
    - `out`: where t, u, measured and simulated x go, CSV
    - `as_json`: print the error of the simulation as JSON on stdout, and nothing else
    - `source`: what a case file would say
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax simulate fit.json run3.csv --out simulated.csv
    """
    import numpy as np

    from frictionjax.core.json import plain_json
    from frictionjax.exchange import load_fit
    from frictionjax.simulation import simulate, simulate_imposed

    _check_folder(out)
    drive = load_fit(fit).drive
    case = case_of(files, source, needs_holdout=False)
    chosen, plant = _chosen(case, recording), case.plant
    terminal.progress("simulating", 0.5)
    if chosen.drive == "motion":
        answer, unit, measured = "force", plant.force_unit, np.asarray(chosen.force)
        simulated = np.asarray(simulate_imposed(drive, chosen.x, chosen.sample_rate).friction)
    else:
        answer, unit, measured = "x", plant.position_unit, chosen.x
        simulated = np.asarray(simulate(drive, chosen.u, chosen.sample_rate, x0=chosen.x[0]).x)
    cause = chosen.x if answer == "force" else chosen.u
    header = f"t,{'x' if answer == 'force' else 'u'},{answer},{answer}_simulated"
    _write_csv(out, header, (chosen.t, cause, measured, simulated))
    terminal.close()
    error = float(np.sqrt(np.mean((simulated - measured) ** 2)))
    if as_json:
        found = {"recording": chosen.name, "of": answer, "error_rms": error, "unit": unit}
        say_json(plain_json(found | {"written": str(out)}))
        return
    say([f"{chosen.name}: {answer} simulated from the input alone differs by {error:.4g} {unit} (root mean square).",
         f"Written: {out}"])  # fmt: skip


def _chosen(case: "Case", name: str | None) -> "Recording":
    """The recording of a case with this name; the first one where none is given."""
    from frictionjax.core import InputError
    from frictionjax.recordings.words import listed

    names = [recording.name for recording in case.recordings]
    if name is not None and name not in names:
        raise InputError(
            f"there is no recording {name!r}",
            file=case.name,
            cure=f"`--recording` is one of: {listed(names)}",
        )
    return case.recordings[0 if name is None else names.index(name)]


def _check_folder(out: Path | None) -> None:
    """Refuse an output in a folder that is not there, before the work."""
    from frictionjax.core import InputError

    if out is not None and not out.parent.is_dir():
        raise InputError(
            "there is no such folder", file=out.parent, cure="Make it, or choose another name for `--out`"
        )
    if out is not None and out.is_dir():
        raise InputError("is a folder", file=out, cure="Name a file in it for `--out`")


def _write_csv(path: Path, header: str, columns: tuple) -> None:
    """Columns of numbers as CSV, whole or not at all."""
    import os

    import numpy as np

    from frictionjax.core import InputError

    fresh = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            np.savetxt(fresh, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})", file=path, cure="Choose another name for `--out`"
        ) from error


def _estimate_lines(found: "dict[str, Estimate]") -> list[str]:
    """One line an estimate: name, value, standard error, unit."""
    width = max((len(name) for name in found), default=0)
    lines = []
    for name, one in found.items():
        unit = "" if one.unit == "1" else f" {one.unit}"
        value = (
            f"{one.value:.5g} +- {one.stderr:.2g}{unit}"
            if one.identified
            else f"{one.value:.5g}{unit} (not determined)"
        )
        lines.append(f"{name:<{width}}  {value}")
    return lines
