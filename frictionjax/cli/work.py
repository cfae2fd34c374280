"""The commands that diagnose: `diagnose`, `demo`, `paper`; and `warm`, which compiles for them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from frictionjax.cli.cases import case_of
from frictionjax.cli.terminal import Terminal, say, say_json

_Asked = tuple[Sequence[str], Sequence[str]]
"""Effects that the user accepts, and those that are rejected."""

if TYPE_CHECKING:
    import argparse

    from frictionjax.core import InputError
    from frictionjax.diagnosis import Diagnosis
    from frictionjax.recordings import Case


def diagnose(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax diagnose`."""
    from frictionjax.report import reserved
    from frictionjax.report.save import verdict_json

    with reserved(arguments.out):
        case, asked = case_of(arguments), (arguments.known, arguments.without)
        if arguments.json:
            diagnosis, _, lost = _diagnosed(case, arguments.out, terminal, start=0.0, asked=asked)
            say_json(verdict_json(diagnosis))
            if lost is not None:
                raise lost
        else:
            _finish(case, arguments.out, terminal, start=0.0, asked=asked)


def demo(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax demo`."""
    from frictionjax.demo import write_demo_case
    from frictionjax.recordings import load_case
    from frictionjax.report import reserved, truth_lines

    seed = {} if arguments.seed is None else {"seed": arguments.seed}
    part = 0.1  # writing the case takes about a tenth of the time
    with reserved(arguments.out):
        file = write_demo_case(arguments.out / "case", progress=terminal.part(0.0, part), **seed)
        diagnosis = _finish(load_case(file), arguments.out, terminal, start=part)
    truth = file.parent / "sealed" / "truth.json"
    say(["", f"True model ({truth}), not used by the diagnosis:"])
    say(truth_lines(json.loads(truth.read_text(encoding="utf-8")), diagnosis))


def paper(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax paper`."""
    from frictionjax.paper.experiments import explain, motor_bench, reproduce
    from frictionjax.paper.figures import paper_lines, write_paper
    from frictionjax.report.save import check_writable

    check_writable(arguments.out)
    # First, so that a mistyped folder is reported before the long computation.
    bench = None if arguments.real is None else motor_bench(arguments.real)
    part = 0.35 if arguments.diagnose else 0.95
    found = reproduce(quick=arguments.quick, seed=arguments.seed, progress=terminal.part(0.0, part))
    explained = explain(seed=arguments.seed, progress=terminal.part(part, 0.95)) if arguments.diagnose else ()
    files = write_paper(
        found, arguments.out, explained=explained, bench=bench, progress=terminal.part(0.95, 1.0)
    )
    terminal.close()
    say(paper_lines(found, explained, bench))
    say(["", "Written:", *(f"  {file}" for file in files)])


def warm(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax warm`."""
    from frictionjax.api import warm

    found = warm(arguments.effect, longest=arguments.longest, progress=terminal.part(0.0, 1.0))
    terminal.close()
    if arguments.json:
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


def _finish(
    case: "Case", out: Path, terminal: Terminal, *, start: float, asked: _Asked = ((), ())
) -> "Diagnosis":
    """Diagnose, save and print the summary: the last part of both commands."""
    from frictionjax.report import summary_lines

    diagnosis, saved, lost = _diagnosed(case, out, terminal, start=start, asked=asked)
    say(summary_lines(diagnosis))
    files = [saved / name for name in ("report.html", "verdict.json", "fit")]
    say(["", "Written:", *(f"  {file}" for file in files if file.exists())])
    if lost is not None:
        raise lost
    return diagnosis


def _diagnosed(
    case: "Case", out: Path, terminal: Terminal, *, start: float, asked: _Asked = ((), ())
) -> tuple["Diagnosis", Path, "InputError | None"]:
    """The diagnosis, with its warnings printed; where it was saved, and why not in `out`. `asked` are effects that the
    user accepts and rejects."""
    from frictionjax.api import diagnose
    from frictionjax.core import InputError
    from frictionjax.report import check_writable, rescue_diagnosis

    check_writable(out, case)
    known, without = asked
    diagnosis = diagnose(case, known=known, without=without, progress=terminal.part(start, 1.0))
    terminal.progress("writing the report", 1.0)
    lost: InputError | None = None
    try:
        saved = diagnosis.save(out)
    except InputError as error:
        try:
            saved = rescue_diagnosis(diagnosis)
        except InputError:
            raise error from None  # what was asked for comes first
        lost = InputError(f"{error} The result was written into {saved} instead")
    terminal.close()
    for warning in diagnosis.warnings:
        terminal.warn(warning)
    return diagnosis, saved, lost
