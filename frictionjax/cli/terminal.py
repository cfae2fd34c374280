"""What is printed where: progress, warnings and errors on stderr, results on stdout."""

import json
import shutil
import sys
import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frictionjax.core import Progress


_SECOND = 1.0
COUNT = " · "
"""As in `core.progress`, which is not loaded before the first sign of life: a stage has one line, not one a task."""


class Terminal:
    """What is printed on stderr: a progress bar on a terminal, else one line a stage; each warning once."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._stage = ""
        self._warned: set[str] = set()
        self._closed = threading.Event()
        self._moving: threading.Thread | None = None

    def starting(self) -> None:
        """A sign of life on a terminal, before JAX is loaded."""
        if sys.stderr.isatty():
            self.progress("loading", 0.0)

    def progress(self, stage: str, fraction: float) -> None:
        """A `frictionjax.core.Progress`: shows the stage and how much of the whole is done."""
        if sys.stderr.isatty():
            if self._bar is None:
                from tqdm import tqdm

                form = "{percentage:3.0f} % |{bar:24}| {elapsed}  {desc}"
                # On a terminal that does not say its size, as in many containers, tqdm alone would draw nothing.
                size = shutil.get_terminal_size()
                shown = {"file": sys.stderr, "ncols": size.columns, "nrows": size.lines}
                self._bar = tqdm(total=1.0, bar_format=form, leave=False, **shown)
                self._moving = threading.Thread(target=self._keep_moving, args=(self._bar,), daemon=True)
                self._moving.start()
            self._bar.n = max(self._bar.n, min(fraction, 1.0))
            self._bar.set_description_str(stage)
            return
        stage = stage.partition(COUNT)[0]
        if stage != self._stage:
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
        if self._bar is not None and self._moving is not None:
            self._closed.set()
            self._moving.join()
            self._bar.close()
            self._bar = None

    def _keep_moving(self, bar: Any) -> None:
        """Show the seconds that pass while a stage takes long."""
        while not self._closed.wait(_SECOND):
            bar.refresh()


def say(lines: Iterable[str]) -> None:
    """Write `lines` to stdout."""
    for text in lines:
        _write(sys.stdout, text)


def say_json(content: Any) -> None:
    """Write `content`, of plain JSON types, to stdout."""
    _write(sys.stdout, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))


def _write(stream: Any, text: str) -> None:
    # A terminal without µ or σ must not bring down a result that took minutes.
    encoding = stream.encoding or "utf-8"
    stream.write(text.encode(encoding, errors="replace").decode(encoding) + "\n")
    stream.flush()
