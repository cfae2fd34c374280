"""Units of columns: what is written in a header, its factor to SI, and what it may measure.

A table of ours rather than a library: the units of a motion recording are few, and a library of units takes longer to
load than all readers.
"""

import math
import re

import equinox as eqx

_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3}
_BASES: dict[str, tuple[float, dict[str, int]]] = {
    "m": (1.0, {"m": 1}),
    "s": (1.0, {"s": 1}),
    "rad": (1.0, {"rad": 1}),
    "A": (1.0, {"A": 1}),
    "V": (1.0, {"V": 1}),
    "N": (1.0, {"N": 1}),
}
"""Symbols that take a prefix."""
_WORDS: dict[str, tuple[float, dict[str, int]]] = {
    "sec": (1.0, {"s": 1}),
    "second": (1.0, {"s": 1}),
    "seconds": (1.0, {"s": 1}),
    "msec": (1e-3, {"s": 1}),
    "usec": (1e-6, {"s": 1}),
    "nsec": (1e-9, {"s": 1}),
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "deg": (math.pi / 180, {"rad": 1}),
    "degree": (math.pi / 180, {"rad": 1}),
    "degrees": (math.pi / 180, {"rad": 1}),
    "°": (math.pi / 180, {"rad": 1}),
    "arcmin": (math.pi / 10800, {"rad": 1}),
    "arcsec": (math.pi / 648000, {"rad": 1}),
    "rev": (2 * math.pi, {"rad": 1}),
    "revolution": (2 * math.pi, {"rad": 1}),
    "revolutions": (2 * math.pi, {"rad": 1}),
    "turn": (2 * math.pi, {"rad": 1}),
    "turns": (2 * math.pi, {"rad": 1}),
    "rpm": (2 * math.pi / 60, {"rad": 1, "s": -1}),
    "rps": (2 * math.pi, {"rad": 1, "s": -1}),
    "in": (0.0254, {"m": 1}),
    "inch": (0.0254, {"m": 1}),
    "lbf": (4.4482216152605, {"N": 1}),
    "radian": (1.0, {"rad": 1}),
    "radians": (1.0, {"rad": 1}),
    "amps": (1.0, {"A": 1}),
    "volts": (1.0, {"V": 1}),
}
"""Symbols and words that take none, in lower case."""
_NO_UNIT_OF_OURS = (
    "counts",
    "count",
    "cts",
    "inc",
    "ticks",
    "pulses",
    "lsb",
    "raw",
    "%",
    "-",
    "1",
    "degc",
    "°c",
    "k",
)
"""What may stand for a unit in a header, and is not converted."""
_AFTER_UNDERSCORE = (
    *(
        "ms",
        "us",
        "ns",
        "deg",
        "rad",
        "mrad",
        "mm",
        "um",
        "nm",
        "rpm",
        "mA",
        "A",
        "mV",
        "V",
        "N",
        "Nm",
        "mNm",
    ),
)
"""Units that may follow a name after an underscore; `x_m`, `x_in` and `x_min` are more likely no units."""


class Unit(eqx.Module):
    """A unit.

    **Attributes:**

    - `factor`: to SI: one of it is so many of `si`.
    - `powers`: the base units and their powers, sorted by name; `(("rad", 1), ("s", -1))`.
    """

    factor: float = eqx.field(static=True)
    powers: tuple[tuple[str, int], ...] = eqx.field(static=True)

    @property
    def si(self) -> str:
        """The SI unit of the same quantity, as text: "rad/s", "N*m"."""
        above = [_power(name, power) for name, power in self._ordered() if power > 0]
        below = [_power(name, -power) for name, power in self._ordered() if power < 0]
        return "/".join(["*".join(above) or "1", *below])

    @property
    def measures(self) -> str:
        """The quantity that is measured in it, in words; the unit where it has no word."""
        return _QUANTITIES.get(self.powers, f"a quantity in {self.si}")

    def _ordered(self) -> list[tuple[str, int]]:
        order = ("N", "m", "rad", "V", "A", "s")
        return sorted(self.powers, key=lambda item: order.index(item[0]))


_TIME, _ANGLE, _LENGTH = (("s", 1),), (("rad", 1),), (("m", 1),)
_FORCE, _TORQUE = (("N", 1),), (("N", 1), ("m", 1))
_SPEEDS = ((("m", 1), ("s", -1)), (("rad", 1), ("s", -1)))
_QUANTITIES: dict[tuple[tuple[str, int], ...], str] = {
    _TIME: "a time",
    _ANGLE: "an angle",
    _LENGTH: "a length",
    _FORCE: "a force",
    _TORQUE: "a torque",
    _SPEEDS[0]: "a speed",
    _SPEEDS[1]: "an angular speed",
    (("A", 1),): "a current",
    (("V", 1),): "a voltage",
}
MEASURED_IN: dict[str, tuple[tuple[tuple[str, int], ...], ...]] = {
    "t": (_TIME,),
    "x": (_ANGLE, _LENGTH),
    "v": _SPEEDS,
    "force": (_FORCE, _TORQUE),
    "normal_force": (_FORCE, _TORQUE),
    "simulated": (_ANGLE, _LENGTH, _FORCE, _TORQUE),
}
"""Role -> the powers that its unit may have; a role that is not in it may have any."""


def parse_unit(text: str) -> Unit | None:
    """The unit that a text stands for; None when it is none of ours.

    Products and quotients of symbols with the usual prefixes, and of numbers: `"mm/s"`, `"N*m"`, `"Nmm"`,
    `"turn/4096"`.

    **Arguments:**

    - `text`: a unit as a header has it, without brackets.

    **Returns:** the `Unit`, or None.
    """
    text = text.strip().replace("µ", "u").replace("μ", "u")
    text = re.sub(r"\s*[*·⋅×]\s*|(?<=\w)[ .](?=[A-Za-z])", "*", text)
    factor, powers = 1.0, dict[str, int]()
    sign = 1
    for part in re.split(r"\s*([*/])\s*", text):
        if part in ("*", "/"):
            sign = -1 if part == "/" else sign
            continue
        found = _symbol(part)
        if found is None:
            return None
        factor *= found[0] ** sign
        for name, power in found[1].items():
            powers[name] = powers.get(name, 0) + sign * power
    if not any(powers.values()):
        return None
    return Unit(factor, tuple(sorted((name, power) for name, power in powers.items() if power)))


def _symbol(text: str) -> tuple[float, dict[str, int]] | None:
    """Factor and powers of one symbol, or of a number."""
    if re.fullmatch(r"\d+(?:\.\d+)?", text, re.ASCII):
        return (float(text), {}) if float(text) > 0 else None
    if text in _BASES:
        return _BASES[text]
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if text[:1] in _PREFIXES and text[1:] in _BASES:
        size, powers = _BASES[text[1:]]
        return _PREFIXES[text[0]] * size, powers
    # A torque is often written without a sign between its units.
    torque = re.fullmatch(r"([a-zA-Z]*N)-?([a-z]*m)", text)
    if torque and all(part != text for part in torque.groups()):
        force, arm = _symbol(torque[1]), _symbol(torque[2])
        if force and arm and arm[1] == {"m": 1}:
            return force[0] * arm[0], {"N": 1, "m": 1}
    return None


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def split_unit(header: str) -> tuple[str, str]:
    """The name and the unit in a column's header.

    **Arguments:**

    - `header`: such as `"x [deg]"`, `"Position (mm)"`, `"t/ms"`, `"speed in rpm"`, `"time_ms"`.

    **Returns:** name and unit, as text; the unit is empty, and the name the whole header, where none is found.
    """
    header = header.strip()
    for pattern in (
        r"(.+?)\s*\[([^\[\]]*)\]",
        r"(.+?)\s*\(([^()]*)\)",
        r"(.+?)\s+in\s+(\S+)",
        r"(.+?)\s*/\s*(\S+)",
    ):
        found = re.fullmatch(pattern, header)
        if found and (parse_unit(found[2]) or found[2].strip().lower() in _NO_UNIT_OF_OURS):
            return found[1], found[2].strip()
    name, _, unit = header.rpartition("_")
    return (name, unit) if name and unit in _AFTER_UNDERSCORE else (header, "")


def is_unit(text: str) -> bool:
    """Whether a cell below a header may be the unit of its column.

    **Arguments:**

    - `text`: the cell.

    **Returns:** True for units, in brackets or not, and for what stands where there is no unit.
    """
    text = text.strip().strip("[]()")
    return bool(parse_unit(text)) or text.lower() in _NO_UNIT_OF_OURS


def turn_of(unit: str) -> float | None:
    """A full turn in the position `unit`, as text, `"deg"` or `"turn/4096"`; None where it is no angle."""
    found = parse_unit(unit)
    return 2.0 * math.pi / found.factor if found is not None and found.powers == _ANGLE else None
