"""The entry of the program: options, settings of JAX, errors as one line and an exit status."""

import gc
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

from cyclopts import CycloptsError, UnusedCliTokensError

from frictionjax.cli.commands import program
from frictionjax.cli.terminal import Terminal


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program.

    **Arguments:**

    - `argv`: the arguments after the program's name; those of the process when absent.

    **Returns:**

    The exit status: 0 whatever the verdict, 2 for bad input (one line on stderr), 130 when interrupted, 143 when asked
    to end (SIGTERM). Errors in the options themselves end the process with status 2.
    """
    terminal = Terminal()
    command = _asked(list(sys.argv[1:] if argv is None else argv), terminal)
    if command is None:
        return 0
    try:
        with _terminable():
            return _run(command, terminal)
    except KeyboardInterrupt as interrupt:
        terminal.close()
        causes = (interrupt, interrupt.__cause__)  # of a study, which says what is finished
        asked = any(isinstance(cause, _AskedToEnd) for cause in causes)
        more = f": {interrupt}" if str(interrupt) else ""
        terminal.line(f"frictionjax: {'asked to end' if asked else 'interrupted'}{more}")
        return 143 if asked else 130


def _asked(words: list[str], terminal: Terminal) -> Callable[[], None] | None:
    """The command that the `words` ask for; None where they ask for help or the version, which is printed."""
    whole = program()
    try:
        command, bound, handed = whole.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        chain, error.command_chain = error.command_chain or (), None
        _refuse(terminal, _problem(error), chain)
    if handed:
        bound.arguments |= dict.fromkeys(handed, terminal)
        return partial(command, *bound.args, **bound.kwargs)
    if not {*whole.help_flags, *whole.version_flags} & set(words):
        names = [name for name in whole.parse_commands(words)[1][-1] if not name.startswith("-")]
        _refuse(terminal, f"a command is needed, one of: {', '.join(names)}.", words)
    from rich.console import Console

    # Without a terminal there are no colours, whatever the environment says: the text may be searched, or kept.
    bound.arguments["console"] = Console(force_terminal=sys.stdout.isatty())
    command(*bound.args, **bound.kwargs)
    return None


def _problem(error: CycloptsError) -> str:
    if isinstance(error, UnusedCliTokensError):
        unused = " ".join(error.unused_tokens or ())
        return f"nothing is expected where {unused!r} stands; files stand before the options."
    text = " ".join(str(error).split())
    return text if text.endswith(("?", ".")) else f"{text}."


def _refuse(terminal: Terminal, problem: str, words: Sequence[str]) -> NoReturn:
    """End the process with one line: the `problem` with the `words` of a command, and where its options stand."""
    terminal.line(f"frictionjax: error: {problem} See `{' '.join(('frictionjax', *words))} --help`.")
    raise SystemExit(2)


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


def _run(command: Callable[[], None], terminal: Terminal) -> int:
    terminal.starting()
    # These are the program's choices to make, and they must be made before JAX computes anything.
    from frictionjax.core import configure_jax, keep_compiled, keep_memory

    keep_memory()
    configure_jax()
    keep_compiled()
    # Tracing makes objects by the million, and most of them stay: the search for cycles among them would take a tenth
    # of the time of a diagnosis.
    gc.set_threshold(100_000, 50, 100)

    from frictionjax.core import FrictionjaxWarning, InputError

    with warnings.catch_warnings():
        warnings.simplefilter("always", FrictionjaxWarning)
        warnings.showwarning = terminal.show(FrictionjaxWarning, warnings.showwarning)
        try:
            command()
        except InputError as error:
            terminal.line(f"frictionjax: error: {' '.join(str(error).split())}")
            return 2
        finally:
            terminal.close()
    # Without this, the search for cycles is run once more when the process ends.
    gc.freeze()
    return 0
