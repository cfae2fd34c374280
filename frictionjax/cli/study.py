"""The command that runs a study: `study`."""

import json
import time
import tomllib
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frictionjax.cli.study_file import EXAMPLE, study_of
from frictionjax.cli.terminal import Terminal, say, say_json

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from frictionjax.studies import Study

CALIBRATE = "calibrate"
"""In the place of a design file: the study that calibrates `diagnose`."""
_EVERY = 30.0  # s between two lines of progress in a log


def study(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax study`."""
    from frictionjax.core import InputError

    if arguments.example:
        terminal.close()
        if arguments.json:
            say_json(tomllib.loads(EXAMPLE))
        else:
            say(EXAMPLE.splitlines())
        return
    if arguments.design == CALIBRATE:
        _calibrate(arguments, terminal)
        return
    if arguments.draws is not None:
        raise InputError("`--draws` is for `study calibrate`", cure="Write `cases` into the design file")
    if arguments.design is None or arguments.out is None:
        raise InputError(
            "a study needs a design file and `--out`",
            cure="`frictionjax study --example > design.toml` writes one",
        )
    found = _results(study_of(Path(arguments.design)), arguments, terminal)
    terminal.close()
    cases, failed = found["failed"].size, int(found["failed"].sum())
    sizes = {str(name): size for name, size in found["failed"].sizes.items()}
    results = sorted(map(str, found.data_vars))
    if arguments.json:
        content = {"cases": cases, "failed": failed, "sizes": sizes, "results": results}
        say_json(content | {"written": [str(arguments.out)]})
        return
    shape = ", ".join(f"{name} {size}" for name, size in sizes.items())
    say([f"{cases:,} cases ({shape}), {failed:,} of them failed.", f"Results: {', '.join(results)}."])
    say(["", f"Written: {arguments.out}"])


def _calibrate(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax study calibrate`: the store, and beside it the summary as JSON and the figure as PNG."""
    from frictionjax.core import InputError
    from frictionjax.report import save_calibration
    from frictionjax.report.calibration_files import calibration_json
    from frictionjax.studies import calibration_of, calibration_study

    if arguments.draws is None or arguments.out is None:
        raise InputError(
            "a calibration needs `--draws` and `--out`",
            cure="`frictionjax study calibrate --draws 1000 --out calibration.zarr`, say",
        )
    found = calibration_of(_results(calibration_study(arguments.draws), arguments, terminal))
    files = save_calibration(found, arguments.out)
    terminal.close()
    if arguments.json:
        say_json(json.loads(calibration_json(found)))
        return
    say([*repr(found).splitlines(), "", f"Written: {', '.join(map(str, (arguments.out, *files)))}"])


def _results(asked: "Study", arguments: "argparse.Namespace", terminal: Terminal) -> Any:
    """The results of the study that is `asked` for, computed where and as the `arguments` say."""
    from frictionjax.core import InputError
    from frictionjax.studies import run_study
    from frictionjax.studies.dispatch import WorkersLost

    parts = arguments.out.with_name(f"{arguments.out.name}.parts")
    if not arguments.resume and (arguments.out.exists() or parts.exists()):
        raise InputError(
            "there are results of an earlier run",
            file=arguments.out,
            cure="Go on with `--resume`, or choose another `--out`",
        )
    try:
        with ExitStack() as stack:
            executor = stack.enter_context(_executor(arguments))
            return run_study(
                asked, arguments.out, executor, chunk=arguments.chunk, progress=_progress(terminal)
            )
    except (ImportError, WorkersLost) as error:  # sentences both
        raise InputError(str(error)) from error


@contextmanager
def _executor(arguments: "argparse.Namespace") -> "Iterator[Any]":
    """The workers that were asked for; None: this process."""
    from frictionjax.core import InputError

    if arguments.dask is not None:
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise InputError(
                f"`--dask` needs distributed, which cannot be loaded ({error})",
                cure="python -m pip install 'frictionjax[cluster]'",
            ) from error
        try:
            client = Client(arguments.dask, timeout=20)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no Dask scheduler answers at {arguments.dask} ({error})",
                place="`--dask`",
                cure="Start one by `dask scheduler`, or correct the address, such as tcp://host:8786",
            ) from error
        with client:
            yield client.get_executor()
    elif arguments.workers is not None and arguments.workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        pool = ProcessPoolExecutor(arguments.workers, mp_context=multiprocessing.get_context("spawn"))
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
