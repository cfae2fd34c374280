"""The store of a study: the folder in which shards gather, the step that makes a Zarr store of them, and reading it.

A store `study.zarr` is there when the study is complete; until then its shards lie in `study.zarr.parts` beside it.
"""

import json
import os
import shutil
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.core.files import take_lock, to_disk, write_whole
from frictionjax.core.frames import read_zarr, require_studies, write_zarr
from frictionjax.studies.dataset import dataset_of
from frictionjax.studies.shards import Shard, cannot_write, finished_places, read_shards
from frictionjax.studies.study import FORMAT, Study, versions

_ABOUT, _LOCK, _FRESH = "study.json", "lock", "new.zarr"


class Store:
    """The right to write the results of a `study` to `target`: the only writer there, until its context ends."""

    def __init__(self, study: Study, target: Path) -> None:
        self.study = study
        self.target = target.absolute()
        self.parts = self.target.with_name(f"{self.target.name}.parts")
        self._about = study.described()

    @contextmanager
    def claimed(self) -> Iterator[None]:
        """Keep others from writing there, and check that what is there belongs to this study.

        **Raises:** `InputError` where another run is writing, or the results of another study are there; `ImportError`
            where xarray or zarr is missing.
        """
        require_studies("run_study")
        lock = self._lock()
        try:
            self._check()
            yield
        finally:
            os.close(lock)

    @property
    def is_complete(self) -> bool:
        """Whether the store is there."""
        return self.target.exists()

    def done(self) -> Bool[np.ndarray, " n"]:
        """Which cases are finished, in the order of the design, shape `(n,)`."""
        found = np.zeros(self.study.design.size, bool)
        for places in finished_places(self.parts):
            found[places] = True
        return found

    def complete(self) -> None:
        """Make the store of the shards, in one step.

        **Raises:** `InputError` where it cannot be written; the shards stay.
        """
        fresh = self.parts / _FRESH
        try:
            shutil.rmtree(fresh, ignore_errors=True)
            write_zarr(self.dataset(read_shards(self.parts)), fresh)
            fresh.rename(self.target)
            to_disk(self.target.parent)
        except OSError as error:
            raise cannot_write(self.parts, error) from error
        self.tidy()

    def dataset(self, shards: Iterable[Shard]) -> Any:
        """The data set of these `shards`."""
        return dataset_of(self.study, shards, self._about | {"versions": self._versions()})

    def tidy(self) -> None:
        """Remove the shards of a complete store."""
        shutil.rmtree(self.parts, ignore_errors=True)

    def load(self) -> Any:
        """The xarray `Dataset` in the store."""
        return load_study(self.target)

    def _lock(self) -> int:
        try:
            while True:
                self.parts.mkdir(parents=True, exist_ok=True)
                try:
                    return take_lock(self.parts / _LOCK)
                except FileNotFoundError:  # its last owner has just removed the folder
                    continue
        except BlockingIOError:
            raise InputError(
                "another run is writing into this store",
                file=self.target,
                cure="Wait until it has ended, or choose another store",
            ) from None
        except OSError as error:
            raise InputError(
                f"nothing can be written beside it ({error.strerror})",
                file=self.target,
                cure="Choose another store",
            ) from error

    def _check(self) -> None:
        if self.target.exists():
            known = _attributes(self.target)
            _same(known, self._about, self.target)
            return
        about = self.parts / _ABOUT
        if not about.exists():
            content = json.dumps(self._about | {"versions": versions()}).encode()
            try:
                write_whole(about, lambda stream: stream.write(content))
            except OSError as error:
                raise cannot_write(self.parts, error) from error
            return
        known = json.loads(about.read_text(encoding="utf-8"))
        _same(known, self._about, self.parts)
        if known["versions"] != versions():
            warnings.warn(
                f"{self.parts}: part of the study was computed with {_differences(known['versions'], versions())}; "
                "its last digits may differ from the rest.",
                FrictionjaxWarning,
                stacklevel=5,
            )

    def _versions(self) -> dict[str, str]:
        return json.loads((self.parts / _ABOUT).read_text(encoding="utf-8"))["versions"]


def load_study(store: str | Path) -> Any:
    """Open the results of a finished study.

    **Arguments:**

    - `store`: the folder that `run_study` wrote.

    **Returns:** an xarray `Dataset`, as `run_study` returns it; arrays are read when they are asked for.

    **Raises:** `InputError` where there is no such store, or it is not finished; `ImportError` where xarray or zarr is
        missing, with the command that installs them.
    """
    path = Path(store)
    if not path.exists():
        parts = path.with_name(f"{path.name}.parts")
        if parts.exists():
            raise InputError(
                "the study is not finished", file=path, cure="Run it again: it goes on where it stopped"
            )
        raise InputError("there is no such store", file=path, cure="Give the `store` of a study that was run")
    known = _attributes(path)
    if known["format"] > FORMAT:
        raise InputError(
            f"the store has the format {known['format']}, of a later version of frictionjax",
            file=path,
            cure="Install that version",
        )
    return read_zarr(path)


def _attributes(path: Path) -> dict[str, Any]:
    """What the store at `path` says of its study."""
    try:
        about = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"]["study"]
        return json.loads(about) if isinstance(about, str) else about
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            "exists and is not the store of a study", file=path, cure="Choose another store"
        ) from None


def _same(known: dict[str, Any], about: dict[str, Any], path: Path) -> None:
    """Raise `InputError` where what a store says of its study is not what is asked for."""
    found = _differences({n: v for n, v in known.items() if n != "versions"}, about)
    if found:
        raise InputError(
            f"the results there are of another study: {found}",
            file=path,
            cure="Choose another store, or remove this one",
        )


def _differences(known: Any, asked: Any) -> str:
    """Where two descriptions differ, the first few places."""
    found = list(_walk(known, asked, ""))
    digests = [one for one in found if "digest" in one]
    found = [one for one in found if one not in digests] or digests
    return "; ".join(found[:3])


def _walk(known: Any, asked: Any, place: str) -> Iterator[str]:
    if isinstance(known, dict) and isinstance(asked, dict):
        for name in dict.fromkeys([*known, *asked]):
            yield from _walk(known.get(name), asked.get(name), f"{place}.{name}" if place else str(name))
    elif isinstance(known, list) and isinstance(asked, list) and any(isinstance(one, dict) for one in known):
        for number in range(max(len(known), len(asked))):
            pair = [one[number] if number < len(one) else None for one in (known, asked)]
            name = next((one["name"] for one in pair if isinstance(one, dict) and "name" in one), number)
            yield from _walk(pair[0], pair[1], f"{place} {name}")
    elif known != asked:
        yield f"{place} is {_short(known)} there and {_short(asked)} here"


def _short(value: Any) -> str:
    text = "missing" if value is None else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
