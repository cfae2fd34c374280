"""The content of a file, unpacked: gzip, and zip of one file."""

import io
import zipfile
from pathlib import Path

from frictionjax.core import InputError
from frictionjax.recordings.limits import bounded, content
from frictionjax.recordings.words import listed, shown


def contents(path: Path) -> bytes:
    """The content of a file; what is packed is recognised by its first bytes, not by the suffix.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its bytes, unpacked.

    **Raises:** `InputError` for a file that cannot be opened, a damaged packed one, a zip file of several files, and
    more than the limit.
    """
    file = shown(path, 200)
    try:
        data = content(path)
    except OSError as error:
        raise InputError(
            f"cannot be opened ({shown(error.strerror)})", file=file, cure="Check its rights"
        ) from None
    return _unzipped(data, file) if data[:4] == b"PK\x03\x04" else data


def _unzipped(data: bytes, file: str) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [entry.filename for entry in archive.infolist() if not entry.is_dir()]
            # What macOS adds is no recording.
            names = [name for name in names if not name.startswith("__MACOSX/")]
            if len(names) != 1:
                raise InputError(
                    f"the zip file holds {len(names)} files: {listed(names) or 'none'}",
                    file=file,
                    cure="Unpack it and give the files themselves, or pack one file only",
                )
            with archive.open(names[0]) as stream:
                return bounded(stream.read, file)
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file makes of zipfile
        raise InputError(
            f"the zip file is damaged, or packed in a way that is not read ({shown(error)})",
            file=file,
            cure="Pack it again, or unpack it",
        ) from None
