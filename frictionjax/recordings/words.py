"""Text for messages: user text on one line, the nearest valid name, the path that was not found."""

import difflib
import itertools
from collections.abc import Iterable
from pathlib import Path

from frictionjax.core import InputError

_MOST_BITS = 1000  # beyond, Python refuses to write a whole number, or takes long
_MOST_NAMES = 2000  # that are compared with a wrong one
_LONGEST_NAME = 100  # characters of a name that is compared: the time grows with their square


def shown(text: object, limit: int = 60) -> str:
    """User text as it may stand in a one-line message: control characters escaped, cut to `limit` characters."""
    if isinstance(text, int) and text.bit_length() > _MOST_BITS:
        return f"a whole number of {text.bit_length()} bits"
    start = str(text)[: limit + 1]
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in start)
    return line if len(line) <= limit else line[: limit - 3] + "..."


def listed(names: Iterable[str], limit: int = 12) -> str:
    """Names as `a, b, c`; beyond `limit` names the rest is counted."""
    names = list(names)
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(shown(name, 40) for name in names[:limit]) + more


def nearest(name: str, names: Iterable[str]) -> str | None:
    """The member of `names` most like `name`, whatever its letter case, or None when none is like it."""
    if len(name) > _LONGEST_NAME:
        return None
    short = (other for other in names if len(other) <= _LONGEST_NAME)
    folded = {other.casefold(): other for other in itertools.islice(short, _MOST_NAMES)}
    found = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return folded[found[0]] if found else None


def require_file(path: Path, *, said_in: object = None, place: str = "") -> Path:
    """The same path, when it is a readable file.

    **Arguments:**

    - `path`: the file to be read.
    - `said_in`, `place`: the case file, and the place in it, that names `path`.

    **Returns:** `path`.

    **Raises:** `InputError` with the nearest existing name of that folder.
    """
    try:
        if path.is_file():
            return path
        folder_exists, is_folder = path.parent.is_dir(), path.is_dir()
        names = [p.name for p in path.parent.iterdir() if p.is_file()] if folder_exists else []
    except (OSError, ValueError):  # a name no file system accepts: too long, or with a null character
        folder_exists, is_folder, names = True, False, []
    file, what = (said_in, f'the file "{shown(path, 120)}"') if said_in else (shown(path, 120), "the file")
    if is_folder:
        inside = "case.toml" if not said_in and (path / "case.toml").is_file() else "a file"
        raise InputError(f"{what} is a folder", file=file, place=place, cure=f"Name {inside} inside it")
    if not folder_exists:
        cure = f'There is no folder "{shown(path.parent, 120)}": correct the path'
    elif near := nearest(path.name, names):
        cure = f'Did you mean "{shown(near)}"?'
    else:
        cure = (
            "Correct the name (paths count from the folder of the case file)"
            if said_in
            else "Correct the name"
        )
    raise InputError(f"{what} does not exist", file=file, place=place, cure=cure)
