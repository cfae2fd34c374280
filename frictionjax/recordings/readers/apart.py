"""Parsers in C that a damaged file may crash, or keep busy for ever, work in a process of their own.

One process serves all files of a format: its library loads once. It gets a request a line and answers with a line,
both JSON; arrays go through files. What ends it ends no other work: the file is refused, and the next one gets a new
process.
"""

import atexit
import contextlib
import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

_LOCK = threading.Lock()
_WORKERS: dict[tuple[str, int], subprocess.Popen] = {}


class ParserEnded(Exception):
    """The process ended before it answered; the text says how, as a clause."""


def ask(module: str, request: dict[str, Any], seconds: float) -> dict[str, Any]:
    """The answer of the program `module` to a `request`.

    **Arguments:**

    - `module`: run as `python -m module`; it reads requests from its input until that ends.
    - `request`: for JSON.
    - `seconds`: after which the process is killed.

    **Raises:** `ParserEnded`.
    """
    # Of another process, after a fork, the pipes would be shared.
    key = (module, os.getpid())
    with _LOCK:
        worker = _WORKERS.get(key) or _started(module)
        _WORKERS[key] = worker
        assert worker.stdin is not None and worker.stdout is not None
        late = threading.Event()

        def stop() -> None:
            late.set()
            worker.kill()

        timer = threading.Timer(seconds, stop)
        timer.start()
        try:
            worker.stdin.write(json.dumps(request) + "\n")
            worker.stdin.flush()
            line = worker.stdout.readline()
        except BrokenPipeError:
            line = ""
        except BaseException:
            # Its answer would be taken for that to the next request.
            _end(_WORKERS.pop(key))
            raise
        finally:
            timer.cancel()
        whole = line.endswith("\n")
        if late.is_set() or not whole:
            _end(_WORKERS.pop(key))
        if whole:
            return json.loads(line)
    if late.is_set():
        raise ParserEnded(f"its parser had not ended after {seconds:.0f} s")
    raise ParserEnded(f"its parser crashed, exit status {worker.returncode}")


def _started(module: str) -> subprocess.Popen:
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    return subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": paths},
        encoding="utf-8",
    )


def _end(worker: subprocess.Popen) -> None:
    worker.kill()
    for stream in (worker.stdin, worker.stdout):
        if stream is not None:
            with contextlib.suppress(BrokenPipeError):
                stream.close()
    worker.wait()


@atexit.register
def _end_all() -> None:
    for key in list(_WORKERS):
        if key[1] == os.getpid():
            _end(_WORKERS.pop(key))
