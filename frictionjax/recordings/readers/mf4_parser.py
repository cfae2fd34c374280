"""The program that parses MDF files in a process of its own (`apart.py`): `python -m` it, a request a line.

A request has the `path`. It is answered with the `channels` but for the clocks: name, group, index and unit. With
`group`, `index` and the file `values`, the samples of that channel are written there, or with `clock` their times, and
the answer is empty. Where neither can be done, the answer has the `error`.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.recordings.readers.extra import library


def answered(request: dict[str, Any]) -> dict[str, Any]:
    """The answer to a `request`."""
    path = Path(request["path"])
    asammdf = library("asammdf", path)
    # A stream of ours is closed whatever happens.
    with path.open("rb") as stream, asammdf.MDF(stream) as file:
        if "values" in request:
            signal = file.get(group=request["group"], index=request["index"])
            values = signal.timestamps if request["clock"] else signal.samples
            np.save(request["values"], np.asarray(values), allow_pickle=False)
            return {}
        channels = [
            {
                "name": channel.name,
                "group": group,
                "index": index,
                "unit": str(file.get_channel_unit(group=group, index=index) or ""),
            }
            for group, content in enumerate(file.groups)
            for index, channel in enumerate(content.channels)
            if file.masters_db.get(group) != index
        ]
        return {"channels": channels}


def main() -> None:
    """Answer requests until the input ends."""
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        # What the libraries print goes where errors go.
        os.dup2(2, 1)
        for line in sys.stdin:
            try:
                answer = answered(json.loads(line))
            except BaseException as error:  # a panic of a library is no `Exception`
                answer = {"error": f"{type(error).__name__}: {error}"}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
