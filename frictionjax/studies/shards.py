"""Shards: files of finished cases, each of which is there as a whole or not at all."""

import hashlib
import json
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Int

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.core.files import PART, write_whole
from frictionjax.studies.task import Outcome, joined

_SUFFIX = ".npz"
_RESULT, _TEXT = "result:", "text:"


class Shard(NamedTuple):
    """Finished cases.

    **Attributes:**

    - `places`: where they stand in the design, shape `(n,)`.
    - `outcome`: their results, and why cases failed.
    """

    places: Int[np.ndarray, " n"]
    outcome: Outcome

    @property
    def failed(self) -> int:
        """How many of them failed."""
        return sum(reason != "" for reason in self.outcome.reasons)


def shard_of(places: list[Int[np.ndarray, " _"]], outcomes: list[Outcome]) -> Shard:
    """The shard of several blocks: the `places` and the `outcomes` of each."""
    values = joined([one.values for one in outcomes], [len(own) for own in places])
    return Shard(np.concatenate(places), Outcome(values, [r for one in outcomes for r in one.reasons]))


def write_shard(folder: Path, shard: Shard) -> Path:
    """Write a `shard` into a new file in `folder`, and return it.

    **Raises:** `InputError` where it cannot be written: the finished ones stay.
    """
    arrays: dict[str, Any] = {"places": shard.places, "reasons": _bytes(shard.outcome.reasons)}
    for name, values in shard.outcome.values.items():
        if values.dtype == object:
            arrays[_TEXT + name] = _bytes(values.tolist())
        else:
            arrays[_RESULT + name] = values
    path = shard_file(folder, shard.places)

    def write(stream: BinaryIO) -> None:
        np.savez(stream, **arrays)

    try:
        write_whole(path, write)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return path


def shard_file(folder: Path, places: Int[np.ndarray, " n"]) -> Path:
    """The file in `folder` of the cases at `places`, shape `(n,)`: where it is there, they are finished."""
    content = hashlib.sha256(np.asarray(places, np.int64).tobytes()).hexdigest()[:16]
    return folder / f"{int(places[0]):010d}-{content}{_SUFFIX}"


def cannot_write(folder: Path, error: OSError) -> InputError:
    """What to raise where the results of a study cannot be written into `folder`, for the `error` of the system."""
    return InputError(
        f"results cannot be written ({error.strerror or error}); those that are finished stay",
        file=folder,
        cure="Make room there, or allow writing, and run the study again: it goes on from there",
    )


def read_shard(path: Path) -> Shard:
    """The shard in the file `path`."""
    with np.load(path, allow_pickle=False) as file:
        values = {}
        for name in file.files:
            if name.startswith(_RESULT):
                values[name.removeprefix(_RESULT)] = file[name]
            elif name.startswith(_TEXT):
                values[name.removeprefix(_TEXT)] = np.asarray(_texts(file[name]), dtype=object)
        return Shard(file["places"], Outcome(values, _texts(file["reasons"])))


def shard_files(folder: Path) -> list[Path]:
    """The files of the shards in `folder`, in the order of their first cases."""
    return sorted(folder.glob(f"[0-9]*{_SUFFIX}"))


def read_shards(folder: Path) -> Iterator[Shard]:
    """Every shard in `folder`, one at a time."""
    return (read_shard(path) for path in shard_files(folder))


def finished_places(folder: Path) -> Iterable[Int[np.ndarray, " _"]]:
    """The places of the finished cases in `folder`, shard by shard; what a killed process left is removed, and so is a
    damaged file, with a `FrictionjaxWarning`."""
    for path in folder.glob(f".*{PART}"):
        path.unlink(missing_ok=True)
    for path in shard_files(folder):
        try:
            with np.load(path, allow_pickle=False) as file:
                places = file["places"]
                if file.zip is not None and file.zip.testzip() is not None:
                    raise zipfile.BadZipFile("a member is damaged")
        except (zipfile.BadZipFile, ValueError, KeyError, EOFError) as error:
            warnings.warn(
                f"{path} is damaged ({error}) and was removed; its cases are computed again.",
                FrictionjaxWarning,
                stacklevel=3,
            )
            path.unlink()
            continue
        yield places


def _bytes(content: Any) -> Any:
    return np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)


def _texts(content: Any) -> list[Any]:
    return json.loads(content.tobytes().decode())
