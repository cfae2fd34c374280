"""Numbers with units for sentences: SI prefixes, and as many digits as the reader needs."""

import math
from typing import NamedTuple

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
# Below this size a quantity in a sentence takes a prefix.
_PREFIXED = {"m": 0.01, "rad": 0.01, "s": 0.0999}
_BLURRED = 0.2  # of the distance to the next quantity: a larger rounding error calls for more digits
_READ_WELL = (1e-2, 1e4)  # numbers that need neither a prefix nor a power of ten


class DisplayUnit(NamedTuple):
    """The unit in which numbers are shown, where that is not the one in which they are computed.

    **Attributes:**

    - `name`: as text, "deg/s".
    - `factor`: what the numbers are multiplied by.
    - `computed`: the unit of the numbers themselves, as text, "rad/s".
    """

    name: str
    factor: float
    computed: str

    def suits(self, size: float) -> bool:
        """Whether numbers of this `size`, in the computed unit, are shown in it: a decimal multiple of that, such as
        mm, gives way to a prefix that reads better; no other unit does."""
        power = math.log10(self.factor)
        decimal = abs(power - round(power)) < 1e-9
        return not decimal or not size or _READ_WELL[0] <= size * self.factor < _READ_WELL[1]


def in_unit(unit: "str | DisplayUnit", *values: float) -> tuple[str, tuple[float, ...]]:
    """The name of the unit in which numbers are shown, and the `values` in it.

    **Arguments:**

    - `unit`: of the `values`.
    - `values`: finite or not.
    """
    if isinstance(unit, str):
        return unit, values
    return unit.name, tuple(value * unit.factor for value in values)


def power_of_thousand(size: float) -> int:
    """The exponent of ten, a multiple of three, that leaves the positive `size` between 1 and 1000."""
    return 3 * math.floor(math.log10(size) / 3.0 + 1e-9)


def prefixed(size: float, unit: str, largest: int = 0) -> tuple[float, str]:
    """The factor and the unit with an SI prefix in which numbers of the positive `size` read well.

    **Arguments:**

    - `size`: in `unit`.
    - `unit`: one that takes SI prefixes, as text.
    - `largest`: exponent of ten of the largest prefix, 0 or 3; the smallest is pico.
    """
    exponent = min(max(power_of_thousand(size), min(_PREFIXES)), largest)
    return 10.0**-exponent, _PREFIXES[exponent] + unit


def neat(value: float, unit: str | DisplayUnit, step: float = math.inf) -> str:
    """A quantity in words: `neat(2e-5, "m")` is "20 µm".

    **Arguments:**

    - `value`: in `unit`, or in the computed unit of a `DisplayUnit`.
    - `unit`: as text, of which small values of m, rad and s take a prefix; or one that is only shown.
    - `step`: distance to the next quantity in the text, in `unit`: the digits are enough to distinguish the two.
    """
    factor, label = _scaled(abs(value), unit)
    return f"{_digits(value * factor, step * factor)} {label}".strip()


def span(low: float, high: float, unit: str | DisplayUnit) -> str:
    """A range in words: `span(0.005, 0.02, "s")` is "5 to 20 ms".

    **Arguments:**

    - `low`, `high`: finite, in `unit`.
    - `unit`: as in `neat`.
    """
    # Between two decades the lower one's prefix would make the upper number long, and the other way round.
    size = math.sqrt(low * high) if low > 0.0 else max(abs(low), abs(high))
    factor, label = _scaled(size, unit)
    step = (high - low) * factor
    return f"{_digits(low * factor, step)} to {_digits(high * factor, step)} {label}".strip()


def one_two_five(value: float) -> float:
    """The number out of 1, 2, 5 times a power of ten that is nearest to the positive `value`, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    return min((step * power for step in (1.0, 2.0, 5.0, 10.0)), key=lambda near: abs(math.log(near / value)))


def times(factor: float) -> str:
    """A factor in words: "over 1000 times", "12 times", "3.4 times"."""
    if factor >= 1000.0:
        return "over 1000 times"
    return f"{factor:.0f} times" if factor >= 9.95 else f"{factor:.1f} times"


def remarked(text: str, remark: str) -> str:
    """A `text` with a `remark` in brackets; where the text ends with brackets of its own, in these: "presliding (20 to
    80 %; 38 % of the excess)"."""
    return f"{text[:-1]}; {remark})" if text.endswith(")") else f"{text} ({remark})"


def _scaled(size: float, unit: str | DisplayUnit) -> tuple[float, str]:
    if not isinstance(unit, str):
        if unit.suits(size):
            return unit.factor, unit.name
        unit = unit.computed
    if not 0.0 < size < _PREFIXED.get(unit, 0.0):
        return 1.0, unit
    return prefixed(size, unit)


def _digits(value: float, step: float = math.inf) -> str:
    value = 0.0 if abs(value) < 1e-9 else value  # what rounding left of zero
    text = f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"
    if step > 0.0 and abs(float(text) - value) > _BLURRED * step:
        return f"{value:.{max(1 - math.floor(math.log10(step)), 0)}f}"
    return text
