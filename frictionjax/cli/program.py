"""The entry of the program: options, settings of JAX, errors as one line and an exit status."""

import gc
import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

from frictionjax.cli.options import parser
from frictionjax.cli.terminal import Terminal

if TYPE_CHECKING:
    import argparse


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program.

    **Arguments:**

    - `argv`: the arguments after the program's name; those of the process when absent.

    **Returns:**

    The exit status: 0 whatever the verdict, 2 for bad input (one line on stderr), 130 when interrupted, 143 when asked
    to end (SIGTERM). Errors in the options themselves end the process with status 2.
    """
    arguments = parser().parse_args(argv)
    terminal = Terminal()
    try:
        with _terminable():
            return _run(arguments, terminal)
    except KeyboardInterrupt as interrupt:
        terminal.close()
        causes = (interrupt, interrupt.__cause__)  # of a study, which says what is finished
        asked = any(isinstance(cause, _AskedToEnd) for cause in causes)
        more = f": {interrupt}" if str(interrupt) else ""
        terminal.line(f"frictionjax: {'asked to end' if asked else 'interrupted'}{more}")
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


def _run(arguments: "argparse.Namespace", terminal: Terminal) -> int:
    terminal.starting()
    # These are the program's choices to make, and they must be made before JAX computes anything.
    from frictionjax.core import configure_jax, keep_compiled, keep_memory

    keep_memory()
    configure_jax()
    keep_compiled()
    # Tracing makes objects by the million, and most of them stay: the search for cycles among them would take a tenth
    # of the time of a diagnosis.
    gc.set_threshold(100_000, 50, 100)

    from frictionjax.cli import arm, completion, compute, look, study, work
    from frictionjax.core import FrictionjaxWarning, InputError

    commands = {
        "diagnose": work.diagnose,
        "arm": arm.arm,
        "demo": work.demo,
        "paper": work.paper,
        "check": look.check,
        "case": look.new_case,
        "effects": look.effects,
        "explain": look.explain,
        "fit": compute.fit,
        "frf": compute.frf,
        "simulate": compute.simulate,
        "study": study.study,
        "warm": work.warm,
        "completion": completion.completion,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("always", FrictionjaxWarning)
        warnings.showwarning = terminal.show(FrictionjaxWarning, warnings.showwarning)
        try:
            commands[arguments.command](arguments, terminal)
        except InputError as error:
            terminal.line(f"frictionjax: error: {' '.join(str(error).split())}")
            return 2
        finally:
            terminal.close()
    # Without this, the search for cycles is run once more when the process ends.
    gc.freeze()
    return 0
