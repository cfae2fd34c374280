"""How a long verb reports its progress, whoever listens: by default a bar where a person watches."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

from tqdm.std import tqdm

_FORM = "{percentage:3.0f} % |{bar:24}| {elapsed}  {desc}"


@runtime_checkable
class Progress(Protocol):
    """Called by the verbs as work goes on: `progress(stage, fraction)` with `fraction` of the whole in [0, 1]."""

    def __call__(self, stage: str, fraction: float) -> None: ...


def silent(stage: str, fraction: float) -> None:
    """The `Progress` that reports nothing: `stage` and `fraction` are ignored."""


@contextmanager
def reporting(progress: Progress | bool) -> Iterator[Progress]:
    """The `Progress` that a verb reports to, while it works.

    **Arguments:**

    - `progress`: a `Progress` of the caller's own; True: a bar on stderr if that is a terminal or a notebook, else
        nothing; False: nothing.

    **Returns:** a context that gives the `Progress` and removes the bar at its end, whatever happens in between.
    """
    if not isinstance(progress, bool):
        yield progress
    elif not (progress and is_watched()):
        yield silent
    else:
        # On a terminal that does not say its size, as in many containers, tqdm alone would draw nothing.
        size = shutil.get_terminal_size()
        shown = {"file": sys.stderr, "ncols": size.columns, "nrows": size.lines}
        bar = tqdm(total=1.0, bar_format=_FORM, leave=False, **shown)

        def show(stage: str, fraction: float) -> None:
            bar.n = max(bar.n, min(fraction, 1.0))
            bar.set_description_str(stage)

        try:
            yield show
        finally:
            bar.close()


def is_watched() -> bool:
    """Whether stderr is a terminal, or the output of a notebook."""
    return sys.stderr.isatty() or _in_notebook()


def _in_notebook() -> bool:
    ipython: Any = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None
