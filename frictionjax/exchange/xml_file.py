"""XML that others wrote, read by the standard library: no document type, and so no entity, is accepted."""

from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.recordings.words import require_file, shown

_CURE = "Write out what it stands for"


def read_xml(xml: str | Path) -> tuple[Element, str, Path | None]:
    """The root element, the text, and the file that it came from.

    **Arguments:**

    - `xml`: the text, which begins with `<`, or the path of a file.

    **Raises:** `InputError` for a file that is missing or no XML, and for one that declares a document type.
    """
    if isinstance(xml, str) and xml.lstrip().startswith("<"):
        path, data = None, xml.strip().encode("utf-8")
    else:
        path = require_file(Path(xml))
        data = path.read_bytes()
    builder, parser = TreeBuilder(), expat.ParserCreate()

    def refuse(*_: object) -> NoReturn:
        raise InputError(
            "declares a document type, whose entities are not read",
            file=path,
            place=f"line {parser.CurrentLineNumber}",
            cure=_CURE,
        )

    def begin(name: str, attributes: dict[str, str]) -> None:
        builder.start(name, attributes)

    def end(name: str) -> None:
        builder.end(name)

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(
            f"is not XML ({expat.ErrorString(error.code)})",
            file=path,
            place=f"line {error.lineno}, column {error.offset + 1}",
            cure="Give the text or the path of a MuJoCo or URDF model",
        ) from error
    return builder.close(), data.decode("utf-8", "replace"), path


def numbers(text: str | None, default: str, where: str) -> Float[np.ndarray, " n"]:
    """The numbers of an attribute, shape `(n,)`.

    **Arguments:**

    - `text`: the attribute; None where it is not there, and the `default` holds.
    - `where`: the element and the attribute, for the message.

    **Raises:** `InputError` for what is not a finite number.
    """
    words = (default if text is None else text).split()
    try:
        found = np.array([float(word) for word in words])
    except ValueError:
        found = np.array([np.nan])
    if not np.isfinite(found).all():
        raise InputError(f'"{shown(text)}" is not made of numbers', place=where, cure="Correct it")
    return found


def one(text: str | None, default: float, where: str) -> float:
    """The first number of an attribute, as `numbers` reads it."""
    found = numbers(text, repr(default), where)
    return float(found[0]) if found.size else default
