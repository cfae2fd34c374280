"""The command that runs a study: `study`."""

import json
import time
import tomllib
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from frictionjax.cli.docstrings import options
from frictionjax.cli.kinds import AsJson, Count, File, Screen
from frictionjax.cli.study_file import EXAMPLE, study_of
from frictionjax.cli.terminal import Terminal, say, say_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from frictionjax.studies import Study

CALIBRATE = Path("calibrate")
"""In the place of a design file: the study that calibrates `diagnose`."""
_EVERY = 30.0  # s between two lines of progress in a log


@options
@Parameter(name="*")
@dataclass(frozen=True)
class StudyRun:
    """Where a study goes on, and who computes it.

    - `resume`: go on where an earlier run was stopped
    - `workers`: processes on this machine (default: one)
    - `dask`: a Dask scheduler whose workers compute
    - `chunk`: cases that a worker is given at a time (default: as many as take five seconds)
    """

    resume: bool = False
    workers: Count | None = None
    dask: Annotated[str | None, Parameter(metavar="ADDRESS")] = None
    chunk: Count | None = None


def study(
    design: File | None = None,
    /,
    *,
    out: Annotated[Path | None, Parameter(metavar="STORE")] = None,
    draws: Count | None = None,
    example: bool = False,
    run: StudyRun = StudyRun(),
    as_json: AsJson = False,
    terminal: Screen,
) -> None:
    """Run a Monte Carlo study or a sweep of simulated machines.

    Compute every case of a design file, and write the results as a Zarr store. A run that was stopped goes on with
    --resume: nothing is computed twice.

    **Arguments:**

    - `design`: the design file, design.toml, or the word calibrate
    - `out`: the folder that becomes the store
    - `draws`: of study calibrate: machines that are drawn and diagnosed
    - `example`: print a design file with every key
    - `run`: where it goes on, and who computes it
    - `as_json`: print what the store holds as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax study --example > design.toml
        frictionjax study design.toml --out study.zarr --workers 2
        frictionjax study design.toml --out study.zarr --dask tcp://host:8786 --resume
        frictionjax study calibrate --draws 1000 --out calibration.zarr --workers 2
    """
    from frictionjax.core import InputError

    if example:
        terminal.close()
        if as_json:
            say_json(tomllib.loads(EXAMPLE))
        else:
            say(EXAMPLE.splitlines())
        return
    if design == CALIBRATE:
        _calibrate(draws, out, run, as_json, terminal)
        return
    if draws is not None:
        raise InputError("`--draws` is for `study calibrate`", cure="Write `cases` into the design file")
    if design is None or out is None:
        raise InputError(
            "a study needs a design file and `--out`",
            cure="`frictionjax study --example > design.toml` writes one",
        )
    found = _results(study_of(design), out, run, terminal)
    terminal.close()
    cases, failed = found["failed"].size, int(found["failed"].sum())
    sizes = {str(name): size for name, size in found["failed"].sizes.items()}
    results = sorted(map(str, found.data_vars))
    if as_json:
        content = {"cases": cases, "failed": failed, "sizes": sizes, "results": results}
        say_json(content | {"written": [str(out)]})
        return
    shape = ", ".join(f"{name} {size}" for name, size in sizes.items())
    say([f"{cases:,} cases ({shape}), {failed:,} of them failed.", f"Results: {', '.join(results)}."])
    say(["", f"Written: {out}"])


def _calibrate(draws: int | None, out: Path | None, run: StudyRun, as_json: bool, terminal: Terminal) -> None:
    """`frictionjax study calibrate`: the store, and beside it the summary as JSON and the figure as PNG."""
    from frictionjax.core import InputError
    from frictionjax.report import save_calibration
    from frictionjax.report.calibration_files import calibration_json
    from frictionjax.studies import calibration_of, calibration_study

    if draws is None or out is None:
        raise InputError(
            "a calibration needs `--draws` and `--out`",
            cure="`frictionjax study calibrate --draws 1000 --out calibration.zarr`, say",
        )
    found = calibration_of(_results(calibration_study(draws), out, run, terminal))
    files = save_calibration(found, out)
    terminal.close()
    if as_json:
        say_json(json.loads(calibration_json(found)))
        return
    say([*repr(found).splitlines(), "", f"Written: {', '.join(map(str, (out, *files)))}"])


def _results(asked: "Study", out: Path, run: StudyRun, terminal: Terminal) -> Any:
    """The results of the study that is `asked` for, in the store `out`."""
    from frictionjax.core import InputError
    from frictionjax.studies import run_study
    from frictionjax.studies.dispatch import WorkersLost

    parts = out.with_name(f"{out.name}.parts")
    if not run.resume and (out.exists() or parts.exists()):
        raise InputError(
            "there are results of an earlier run",
            file=out,
            cure="Go on with `--resume`, or choose another `--out`",
        )
    try:
        with ExitStack() as stack:
            executor = stack.enter_context(_executor(run))
            return run_study(asked, out, executor, chunk=run.chunk, progress=_progress(terminal))
    except (ImportError, WorkersLost) as error:  # sentences both
        raise InputError(str(error)) from error


@contextmanager
def _executor(run: StudyRun) -> "Iterator[Any]":
    """The workers that were asked for; None: this process."""
    from frictionjax.core import InputError

    if run.dask is not None:
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise InputError(
                f"`--dask` needs distributed, which cannot be loaded ({error})",
                cure="python -m pip install 'frictionjax[cluster]'",
            ) from error
        try:
            client = Client(run.dask, timeout=20)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no Dask scheduler answers at {run.dask} ({error})",
                place="`--dask`",
                cure="Start one by `dask scheduler`, or correct the address, such as tcp://host:8786",
            ) from error
        with client:
            yield client.get_executor()
    elif run.workers is not None and run.workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        pool = ProcessPoolExecutor(run.workers, mp_context=multiprocessing.get_context("spawn"))
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)
    else:
        yield None


def _progress(terminal: Terminal) -> Any:
    """On a terminal the bar; in a log a line now and then."""
    import sys

    said = [-_EVERY]

    def report(stage: str, fraction: float) -> None:
        now = time.monotonic()
        if sys.stderr.isatty() or fraction >= 1.0 or now - said[0] >= _EVERY:
            said[0] = now
            terminal.progress(stage, fraction)

    return report
