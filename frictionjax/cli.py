"""The program: the public verbs on files, their progress on stderr, their verdict on stdout. No maths here."""

import argparse
import gc
import json
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from frictionjax import __version__

if TYPE_CHECKING:
    from frictionjax.core import Progress
    from frictionjax.diagnosis import Diagnosis
    from frictionjax.recordings import Case

# Imports of the package stand inside functions in this one file: JAX takes more than a second to load, and
# `--help`, `--version` and a mistyped option must answer at once.

_BARE_OPTIONS = ("motor_constant", "sample_rate", "position_unit", "force_unit", "input_unit")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program.

    **Arguments:**

    - `argv`: the arguments after the program's name; those of the process when absent.

    **Returns:**

    The exit status: 0 whatever the verdict, 2 for bad input (one line on stderr), 130 when interrupted, 143 when asked
    to end (SIGTERM). Errors in the options themselves end the process with status 2.
    """
    arguments = _parser().parse_args(argv)
    terminal = _Terminal()
    try:
        with _terminable():
            return _run(arguments, terminal)
    except KeyboardInterrupt as interrupt:
        terminal.close()
        asked = isinstance(interrupt, _AskedToEnd)
        terminal.line(f"frictionjax: {'asked to end' if asked else 'interrupted'}")
        return 143 if asked else 130


class _AskedToEnd(KeyboardInterrupt):
    """SIGTERM: what is being written is completed or removed, as after Ctrl-C."""


@contextmanager
def _terminable() -> Iterator[None]:
    """Raise `_AskedToEnd` on SIGTERM."""

    def end(number: int, frame: Any) -> NoReturn:
        raise _AskedToEnd

    before = signal.getsignal(signal.SIGTERM)
    if threading.current_thread() is not threading.main_thread() or before in (None, signal.SIG_IGN):
        yield  # such a handler could not be set again, or was set on purpose
        return
    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"frictionjax: error: {message}. See `{self.prog} --help`.\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="frictionjax",
        description="Friction identification: where a machine differs from its model, which physics is missing, "
        "and whether the answer is confirmed on held-out recordings.",
    )
    parser.add_argument("--version", action="version", version=f"frictionjax {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    diagnose = commands.add_parser(
        "diagnose",
        help="name what is missing in the model of a recorded machine",
        description="Diagnose one case: a case file, or recordings without one and the options below.",
    )
    diagnose.add_argument(
        "inputs", nargs="+", metavar="FILE", help="one case file (.toml), or the recordings to fit"
    )
    diagnose.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="where verdict.json, report.html and fit/ go"
    )
    diagnose.add_argument(
        "--allow-outside", action="store_true", help="let the case file name recordings outside of its folder"
    )
    diagnose.add_argument(
        "--limit", type=float, metavar="GB", help="the most that is read of one file, unpacked (default: 0.5)"
    )
    bare = diagnose.add_argument_group("for recordings without a case file (which sets these itself)")
    bare.add_argument(
        "--holdout",
        nargs="+",
        action="extend",
        default=[],
        metavar="RECORDING",
        help="held-out recordings, which judge the result (by default, the last third of a single recording)",
    )
    bare.add_argument(
        "--motor-constant", type=float, metavar="KM", help="force or torque per input unit, when known"
    )
    bare.add_argument("--sample-rate", type=float, metavar="HZ", help="needed when files have no time column")
    for quantity in ("position", "force", "input"):
        bare.add_argument(f"--{quantity}-unit", metavar="UNIT", help=f"unit of {quantity}, as text")

    demo = commands.add_parser(
        "demo",
        help="diagnose a simulated machine, then compare with the truth",
        description="Write a case of a simulated machine, diagnose it, and print the true model beside the verdict.",
    )
    demo.add_argument(
        "--out",
        type=Path,
        default=Path("frictionjax-demo"),
        metavar="DIR",
        help="where the result and DIR/case go (default: %(default)s)",
    )
    demo.add_argument(
        "--seed", type=int, metavar="N", help="seed of the machine's parameters and of all noise"
    )

    paper = commands.add_parser(
        "paper",
        help="the figures and tables of Hensen, van de Molengraft, Steinbuch (2002), reproduced",
        description="Run every experiment of the paper on synthetic machines, in about two minutes: figures as PNG and "
        "SVG, and tables.json with every number beside its reference value.",
    )
    paper.add_argument(
        "--out",
        type=Path,
        default=Path("frictionjax-paper"),
        metavar="DIR",
        help="where the figures and tables.json go (default: %(default)s)",
    )
    paper.add_argument(
        "--real", type=Path, metavar="DIR", help="a folder with MultisineTypeB.mat, a motor bench"
    )
    paper.add_argument(
        "--diagnose",
        action="store_true",
        help="also diagnose the twins whose friction is not LuGre: minutes more",
    )
    paper.add_argument(
        "--quick", action="store_true", help="fewer data and seeds: faster, with less accurate numbers"
    )
    paper.add_argument(
        "--seed", type=int, default=0, metavar="N", help="seed of all noise (default: %(default)s)"
    )
    return parser


def _run(arguments: argparse.Namespace, terminal: "_Terminal") -> int:
    # These are the program's choices to make, and they must be made before JAX computes anything.
    from frictionjax.core import configure_jax, keep_compiled, keep_memory

    keep_memory()
    configure_jax()
    keep_compiled()
    # Tracing makes objects by the million, and most of them stay: the search for cycles among them would take a tenth
    # of the time of a diagnosis.
    gc.set_threshold(100_000, 50, 100)

    from frictionjax.core import FrictionjaxWarning, InputError

    command = {"demo": _demo, "paper": _paper}.get(arguments.command, _diagnose)
    with warnings.catch_warnings():
        warnings.simplefilter("always", FrictionjaxWarning)
        warnings.showwarning = terminal.show(FrictionjaxWarning, warnings.showwarning)
        try:
            command(arguments, terminal)
        except InputError as error:
            terminal.line(f"frictionjax: error: {' '.join(str(error).split())}")
            return 2
        finally:
            terminal.close()
    # Without this, the search for cycles is run once more when the process ends.
    gc.freeze()
    return 0


def _diagnose(arguments: argparse.Namespace, terminal: "_Terminal") -> None:
    from frictionjax.report import reserved

    with reserved(arguments.out):
        _finish(_case(arguments), arguments.out, terminal, start=0.0)


def _case(arguments: argparse.Namespace) -> "Case":
    from frictionjax.core import InputError
    from frictionjax.recordings import case_from_files, load_case

    first, *others = arguments.inputs
    case_files = [name for name in arguments.inputs if Path(name).suffix.lower() == ".toml"]
    options = {name: getattr(arguments, name) for name in _BARE_OPTIONS}
    if not case_files:
        return case_from_files(arguments.inputs, arguments.holdout, limit=arguments.limit, **options)
    if others or arguments.holdout:
        problem = "a case file lists its own recordings, so it is the only argument"
        raise InputError(problem, file=case_files[0], cure="Give one case file, or recordings only")
    for name, value in options.items():
        if value is not None:
            problem = f"`--{name.replace('_', '-')}` is for recordings without a case file"
            cure = f"Write {name} into the case file"
            raise InputError(problem, file=first, cure=cure)
    return load_case(first, allow_outside=arguments.allow_outside, limit=arguments.limit)


def _demo(arguments: argparse.Namespace, terminal: "_Terminal") -> None:
    from frictionjax.demo import write_demo_case
    from frictionjax.recordings import load_case
    from frictionjax.report import reserved, truth_lines

    seed = {} if arguments.seed is None else {"seed": arguments.seed}
    part = 0.1  # writing the case takes about a tenth of the time
    with reserved(arguments.out):
        file = write_demo_case(arguments.out / "case", progress=terminal.part(0.0, part), **seed)
        diagnosis = _finish(load_case(file), arguments.out, terminal, start=part)
    truth = file.parent / "sealed" / "truth.json"
    _say(["", f"True model ({truth}), not used by the diagnosis:"])
    _say(truth_lines(json.loads(truth.read_text(encoding="utf-8")), diagnosis))


def _paper(arguments: argparse.Namespace, terminal: "_Terminal") -> None:
    from frictionjax.paper.experiments import explain, motor_bench, reproduce
    from frictionjax.paper.figures import paper_lines, write_paper
    from frictionjax.report.save import check_writable

    check_writable(arguments.out)
    # First, so that a mistyped folder is reported before the long computation.
    bench = None if arguments.real is None else motor_bench(arguments.real)
    part = 0.35 if arguments.diagnose else 0.95
    paper = reproduce(quick=arguments.quick, seed=arguments.seed, progress=terminal.part(0.0, part))
    explained = explain(seed=arguments.seed, progress=terminal.part(part, 0.95)) if arguments.diagnose else ()
    files = write_paper(
        paper, arguments.out, explained=explained, bench=bench, progress=terminal.part(0.95, 1.0)
    )
    terminal.close()
    _say(paper_lines(paper, explained, bench))
    _say(["", "Written:", *(f"  {file}" for file in files)])


def _finish(case: "Case", out: Path, terminal: "_Terminal", *, start: float) -> "Diagnosis":
    """Diagnose, save and print the summary: the last part of both commands."""
    from frictionjax.api import diagnose  # through api: there report.html is registered as a file to write
    from frictionjax.core import InputError
    from frictionjax.report import check_writable, rescue_diagnosis, summary_lines

    check_writable(out, case)
    diagnosis = diagnose(case, progress=terminal.part(start, 1.0))
    terminal.progress("writing the report", 1.0)
    lost: InputError | None = None
    try:
        saved = diagnosis.save(out)
    except InputError as error:
        saved = rescue_diagnosis(diagnosis)
        lost = InputError(f"{error} The result was written into {saved} instead")
    terminal.close()
    for warning in diagnosis.warnings:
        terminal.warn(warning)
    _say(summary_lines(diagnosis))
    files = [saved / name for name in ("report.html", "verdict.json", "fit")]
    _say(["", "Written:", *(f"  {file}" for file in files if file.exists())])
    if lost is not None:
        raise lost
    return diagnosis


class _Terminal:
    """What is printed on stderr: a progress bar on a terminal, else one line a stage; each warning once."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._stage = ""
        self._warned: set[str] = set()

    def progress(self, stage: str, fraction: float) -> None:
        """A `frictionjax.core.Progress`: shows the stage and how much of the whole is done."""
        if sys.stderr.isatty():
            if self._bar is None:
                from tqdm import tqdm

                form = "{percentage:3.0f} % |{bar:24}| {elapsed}  {desc}"
                self._bar = tqdm(total=1.0, bar_format=form, file=sys.stderr, leave=False)
            self._bar.n = max(self._bar.n, min(fraction, 1.0))
            self._bar.set_description_str(stage)
        elif stage != self._stage:
            self.line(f"{stage} ...")
        self._stage = stage

    def part(self, start: float, stop: float) -> "Progress":
        """The `Progress` of a step that takes the whole from `start` to `stop`."""
        return lambda stage, fraction: self.progress(stage, start + (stop - start) * fraction)

    def warn(self, text: str) -> None:
        """One line for each different warning."""
        text = " ".join(text.split())
        if text not in self._warned:
            self._warned.add(text)
            self.line(f"warning: {text}")

    def show(self, ours: type[Warning], otherwise: Callable[..., None]) -> Callable[..., None]:
        """A `warnings.showwarning` that prints the package's own warnings as single lines."""

        def showwarning(message: Warning | str, category: type[Warning], *place: Any) -> None:
            if issubclass(category, ours):
                self.warn(str(message))
            else:
                otherwise(message, category, *place)

        return showwarning

    def line(self, text: str) -> None:
        """A line on stderr; a bar makes room for it."""
        if self._bar is not None:
            self._bar.clear()
        _write(sys.stderr, text)
        if self._bar is not None:
            self._bar.refresh()

    def close(self) -> None:
        """The bar, if any, goes away."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def _say(lines: Iterable[str]) -> None:
    for text in lines:
        _write(sys.stdout, text)


def _write(stream: Any, text: str) -> None:
    # A terminal without µ or σ must not bring down a result that took minutes.
    encoding = stream.encoding or "utf-8"
    stream.write(text.encode(encoding, errors="replace").decode(encoding) + "\n")
    stream.flush()
