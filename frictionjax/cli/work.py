"""The commands that diagnose: `diagnose`, `demo`, `paper`; and `warm`, which compiles for them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from frictionjax.cli.case_options import CaseOptions
from frictionjax.cli.cases import case_of
from frictionjax.cli.kinds import AsJson, Count, Effects, File, Folder, Number, Screen
from frictionjax.cli.terminal import Terminal, say, say_json

_Asked = tuple[Sequence[str], Sequence[str]]
"""Effects that the user accepts, and those that are rejected."""

if TYPE_CHECKING:
    from frictionjax.core import InputError, Progress
    from frictionjax.diagnosis import Diagnosis
    from frictionjax.recordings import Case


def diagnose(
    files: list[File],
    /,
    *,
    out: Folder,
    known: Annotated[Effects, Parameter("--with")] = None,
    without: Effects = None,
    check: Count | None = None,
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    r"""Name what is missing in the model of a recorded machine.

    Diagnose one case: a case file, or recordings without one and the options below.

    **Arguments:**

    - `files`: one case file (.toml), or the recordings to fit
    - `out`: where verdict.json, report.html and fit/ go
    - `known`: effects that act: they become part of the base model, and the rest is judged again
    - `without`: effects that do not act: they are tested, but not named
    - `check`: also diagnose N simulated machines like this one: how often the name is right; goes on where it stopped
    - `as_json`: print verdict.json as JSON on stdout, and nothing else
    - `source`: what a case file would say
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax diagnose case.toml --out result
        frictionjax diagnose run1.csv run2.csv --holdout run3.csv \
          --motor-constant 16 --out result
        frictionjax diagnose case.toml --with gravity_pendulum --without ripple \
          --out again
        frictionjax diagnose case.toml --out result --check 20
        frictionjax diagnose log.csv --columns t=Time u="Motor Current" x=Angle \
          --unit t=ms x=deg --out result
    """
    from frictionjax.report import reserved
    from frictionjax.report.save import verdict_json

    with reserved(out):
        if check is not None:
            _require_stores()
        case, asked = case_of(files, source), (known or [], without or [])
        diagnosis, saved, lost = _diagnosed(case, out, terminal, start=0.0, asked=asked, machines=check)
        if as_json:
            say_json(verdict_json(diagnosis))
        else:
            _say_result(diagnosis, saved)
        if lost is not None:
            raise lost


def demo(
    *,
    out: Folder = Path("frictionjax-demo"),
    seed: Number | None = None,
    as_json: AsJson = False,
    terminal: Screen,
) -> None:
    """Diagnose a simulated machine, then compare with the truth.

    Write a case of a simulated machine, diagnose it, and print the true model beside the verdict.

    **Arguments:**

    - `out`: where the result and DIR/case go
    - `seed`: seed of the machine's parameters and of all noise
    - `as_json`: print the true model and verdict.json as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax demo
        frictionjax demo --seed 7 --out other-demo
    """
    from frictionjax.demo import write_demo_case
    from frictionjax.recordings import load_case
    from frictionjax.report import reserved, truth_lines
    from frictionjax.report.save import verdict_json

    seeded: dict[str, Any] = {} if seed is None else {"seed": seed}
    part = 0.1  # writing the case takes about a tenth of the time
    with reserved(out):
        file = write_demo_case(out / "case", progress=terminal.part(0.0, part), **seeded)
        diagnosis, saved, lost = _diagnosed(load_case(file), out, terminal, start=part)
        sealed = file.parent / "sealed" / "truth.json"
        truth = json.loads(sealed.read_text(encoding="utf-8"))
        if as_json:
            say_json({"truth": truth, "diagnosis": verdict_json(diagnosis)})
        else:
            _say_result(diagnosis, saved)
        if lost is not None:
            raise lost
    if not as_json:
        say(["", f"True model ({sealed}), not used by the diagnosis:", *truth_lines(truth, diagnosis)])


def paper(
    *,
    out: Folder = Path("frictionjax-paper"),
    real: Folder | None = None,
    diagnose: bool = False,
    quick: bool = False,
    seed: Number = 0,
    as_json: AsJson = False,
    terminal: Screen,
) -> None:
    """The figures and tables of Hensen, van de Molengraft, Steinbuch (2002), reproduced.

    Run every experiment of the paper on synthetic machines, in about two minutes: figures as PNG and SVG, and
    tables.json with every number beside its reference value.

    **Arguments:**

    - `out`: where the figures and tables.json go
    - `real`: a folder with MultisineTypeB.mat, a motor bench
    - `diagnose`: also diagnose the twins whose friction is not LuGre: minutes more
    - `quick`: fewer data and seeds: faster, with less accurate numbers
    - `seed`: seed of all noise
    - `as_json`: print tables.json as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax paper --out figures
    """
    from frictionjax.paper.experiments import explain, motor_bench, reproduce
    from frictionjax.paper.figures import paper_lines, tables, write_paper
    from frictionjax.report.save import check_writable

    check_writable(out)
    # First, so that a mistyped folder is reported before the long computation.
    bench = None if real is None else motor_bench(real)
    part = 0.35 if diagnose else 0.95
    found = reproduce(quick=quick, seed=seed, progress=terminal.part(0.0, part))
    explained = explain(seed=seed, progress=terminal.part(part, 0.95)) if diagnose else ()
    files = write_paper(found, out, explained=explained, bench=bench, progress=terminal.part(0.95, 1.0))
    terminal.close()
    if as_json:
        say_json(tables(found, explained, bench))
        return
    say(paper_lines(found, explained, bench))
    say(["", "Written:", *(f"  {file}" for file in files)])


def warm(
    *,
    effect: Effects = None,
    longest: Annotated[int, Parameter(metavar="SAMPLES")] = 16384,
    as_json: AsJson = False,
    terminal: Screen,
) -> None:
    """Compile what diagnoses need, so that later ones need not wait for it.

    Compile and keep the programs of the base model, alone and with each effect of the catalogue: minutes, once for each
    version and machine. What is there already is not made again.

    **Arguments:**

    - `effect`: only these effects (default: the whole catalogue)
    - `longest`: samples of the longest recording to come
    - `as_json`: print what was kept as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax warm
        frictionjax warm --effect gravity_pendulum ripple delay
    """
    from frictionjax.api import warm

    found = warm(effect, longest=longest, progress=terminal.part(0.0, 1.0))
    terminal.close()
    if as_json:
        say_json(
            {
                "structures": found.structures,
                "programs": found.programs,
                "megabytes": found.megabytes,
                "seconds": found.seconds,
                "folder": str(found.folder),
            }
        )
        return
    say(
        [
            f"{found.structures} models in {found.seconds:.0f} s: {found.programs} programs, "
            f"{found.megabytes:.3g} MB, in {found.folder}",
        ]
    )


def _say_result(diagnosis: "Diagnosis", saved: Path) -> None:
    """Print the summary of a diagnosis, and the files that were `saved`."""
    from frictionjax.report import summary_lines

    say(summary_lines(diagnosis))
    files = [saved / name for name in ("report.html", "verdict.json", "fit")]
    say(["", "Written:", *(f"  {file}" for file in files if file.exists())])


def _diagnosed(
    case: "Case",
    out: Path,
    terminal: Terminal,
    *,
    start: float,
    asked: _Asked = ((), ()),
    machines: int | None = None,
) -> tuple["Diagnosis", Path, "InputError | None"]:
    """The diagnosis, with its warnings printed; where it was saved, and why not in `out`. `asked` are effects that the
    user accepts and rejects, `machines` how many simulated ones it is checked on."""
    from frictionjax.report import check_writable

    check_writable(out, case)
    stop = 1.0 if machines is None else start + (1.0 - start) / (machines + 1)
    diagnosis = _earlier(case, out, asked, machines)
    if diagnosis is None:
        diagnosis, saved, lost = _saved(case, out, terminal.part(start, stop), asked)
    else:
        saved, lost = out, None
    if machines is not None and lost is None:
        diagnosis = _checked(case, diagnosis, out, terminal.part(stop, 1.0), asked, machines)
    terminal.close()
    for warning in diagnosis.warnings:
        terminal.warn(warning)
    return diagnosis, saved, lost


def _saved(
    case: "Case", out: Path, progress: "Progress", asked: _Asked
) -> tuple["Diagnosis", Path, "InputError | None"]:
    """The diagnosis; where it was saved, and why not in `out`."""
    from frictionjax.api import diagnose
    from frictionjax.core import InputError
    from frictionjax.report import rescue_diagnosis

    known, without = asked
    diagnosis = diagnose(case, known=known, without=without, progress=progress)
    progress("writing the report", 1.0)
    try:
        return diagnosis, diagnosis.save(out), None
    except InputError as error:
        try:
            saved = rescue_diagnosis(diagnosis)
        except InputError:
            raise error from None  # what was asked for comes first
        return diagnosis, saved, InputError(f"{error} The result was written into {saved} instead")


def _earlier(case: "Case", out: Path, asked: _Asked, machines: int | None) -> "Diagnosis | None":
    """The diagnosis in `out` whose check was stopped; None where there is none. Checks of other cases are removed."""
    from frictionjax.diagnosis.intake.as_asked import accepted
    from frictionjax.report import load_diagnosis
    from frictionjax.studies.check import asked_of
    from frictionjax.studies.machines_file import CHECK, forget_other_checks, is_asked

    if machines is None and not any(out.glob(CHECK.format("*", "json"))):
        return None
    known, without = asked
    digest = asked_of(accepted(case, known), without=without)
    forget_other_checks(out, digest)
    kept = machines is not None and is_asked(out / CHECK.format(machines, "json"), digest)
    if not kept or not (out / "verdict.json").exists():
        return None
    return load_diagnosis(out)


def _checked(
    case: "Case", diagnosis: "Diagnosis", out: Path, progress: "Progress", asked: _Asked, machines: int
) -> "Diagnosis":
    """The diagnosis with its check on simulated machines, saved in `out`."""
    import warnings

    from frictionjax.api import check_diagnosis
    from frictionjax.core import FrictionjaxWarning
    from frictionjax.studies.machines_file import CHECK

    if not diagnosis.was_diagnosed:
        warnings.warn(
            FrictionjaxWarning("Nothing was diagnosed, so there is no answer to check."), stacklevel=2
        )
        return diagnosis
    known, without = asked
    store = out / CHECK.format(machines, "zarr")
    checked = check_diagnosis(
        case, diagnosis, machines, known=known, without=without, store=store, progress=progress
    )
    progress("writing the report", 1.0)
    checked.save(out)
    return checked


def _require_stores() -> None:
    """Refuse a check where the libraries of its store are missing, before the work."""
    from frictionjax.core import InputError
    from frictionjax.core.frames import require_studies

    try:
        require_studies("--check")
    except ImportError as error:  # a sentence with what installs them
        raise InputError(str(error)) from error
