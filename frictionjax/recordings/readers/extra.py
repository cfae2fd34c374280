"""Libraries that read one format each: loaded when a file needs them, named where they are absent."""

import importlib
from pathlib import Path
from types import ModuleType

from frictionjax.core import InputError
from frictionjax.recordings.words import shown

_EXTRAS = {"asammdf": "mdf", "rosbags.highlevel": "ros", "rosbags.typesys": "ros"}
"""Library -> the extra that installs it, where that is not `files`."""


def library(name: str, path: Path) -> ModuleType:
    """The module `name`, which reads the format of a file.

    **Arguments:**

    - `name`: such as `"h5py"`.
    - `path`: the file, for the message.

    **Returns:** the module.

    **Raises:** `InputError` with the command that installs it, where it is absent.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"this format is read by the library {name.partition('.')[0]}, which is not installed ({shown(error)})",
            file=shown(path, 200),
            cure=f'Install it: python -m pip install "frictionjax[{_EXTRAS.get(name, "files")}]"',
        ) from None


def optional(name: str) -> ModuleType | None:
    """The module `name`, or None where it is absent: for what is only faster with it.

    **Arguments:**

    - `name`: such as `"polars"`.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        return None
