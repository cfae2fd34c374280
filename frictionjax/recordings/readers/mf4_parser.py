"""The program that parses MDF files in a process of its own (`apart.py`): `python -m` it, a request a line.

A request has the `path`, a `folder` for the arrays, and how many bytes they may have in all, `most`. The answer has the
`channels`: name, group, unit, and the files of samples and of times in the folder; or the `error`.
"""

import contextlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.recordings.readers.extra import library, optional

_LIBRARIES = 4e9  # bytes of addresses that the libraries take
_COPIES = 8  # of what is read, while it is read


def parsed(path: str, folder: Path, most: int) -> dict[str, Any]:
    """The answer for the file `path`: every channel but the clocks, its arrays written into the `folder`; an error
    where they have more than `most` bytes."""
    asammdf = library("asammdf", Path(path))
    channels, clocks, total = [], {}, 0
    # A stream of ours is closed whatever happens.
    with Path(path).open("rb") as stream, asammdf.MDF(stream) as file:
        for group, content in enumerate(file.groups):
            for index, channel in enumerate(content.channels):
                if file.masters_db.get(group) == index:
                    continue
                signal = file.get(group=group, index=index)
                samples = np.asarray(signal.samples)
                total += samples.nbytes + (0 if group in clocks else signal.timestamps.nbytes)
                if total > most:
                    return {"large": True}
                number = len(channels)
                if not samples.dtype.hasobject:
                    np.save(folder / f"{number}.npy", samples, allow_pickle=False)
                if group not in clocks:
                    clocks[group] = f"clock{group}.npy"
                    np.save(folder / clocks[group], np.asarray(signal.timestamps), allow_pickle=False)
                channels.append(
                    {
                        "name": channel.name,
                        "group": group,
                        "unit": str(file.get_channel_unit(group=group, index=index) or ""),
                        "samples": "" if samples.dtype.hasobject else f"{number}.npy",
                        "times": clocks[group],
                    }
                )
    return {"channels": channels}


def _limit_memory(most: int) -> None:
    resource = optional("resource")
    if resource is None:  # not on every system
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    with contextlib.suppress(ValueError, OSError):  # a lower limit stays
        resource.setrlimit(resource.RLIMIT_AS, (int(_LIBRARIES + _COPIES * most), hard))


def main() -> None:
    """Answer requests until the input ends."""
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        # What the libraries print goes where errors go.
        os.dup2(2, 1)
        for line in sys.stdin:
            request = json.loads(line)
            _limit_memory(request["most"])
            try:
                answer = parsed(request["path"], Path(request["folder"]), request["most"])
            except BaseException as error:  # a panic of a library is no `Exception`
                answer = {"error": f"{type(error).__name__}: {error}"}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
