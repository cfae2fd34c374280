"""Numbers and units for the report: few digits, engineering prefixes, digits that match the standard error."""

import math
from collections.abc import Mapping, Sequence

from frictionjax.core import Estimate
from frictionjax.core.quantities import DisplayUnit, in_unit, power_of_thousand, prefixed
from frictionjax.recordings import Plant
from frictionjax.recordings.words import shown

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TAKES_PREFIX = {"m", "rad", "N", "Nm", "N*m", "N m", "V", "A"}
_LONGEST_UNIT = 40  # characters
DASH = "–"


def unit_text(unit: str) -> str:
    """A unit for the eye: `"kg*m^2"` becomes "kg·m²"; a ratio (`"1"`) becomes empty; one too long for a label is cut.

    **Arguments:**

    - `unit`: as it stands in a case file or an `Estimate`.
    """
    if unit == "1":
        return ""
    text = shown(unit, _LONGEST_UNIT).replace("*", "·")
    while "^" in text:
        head, _, tail = text.partition("^")
        digits = next(
            (k for k, c in enumerate(tail) if not (c.isdigit() or (c == "-" and k == 0))), len(tail)
        )
        text = head + tail[:digits].translate(_SUPERSCRIPTS) + tail[digits:]
    return text


def power_of_ten(exponent: int) -> str:
    """`-7` becomes "10⁻⁷"."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def number(value: float, digits: int = 3) -> str:
    """A number to `digits` significant digits; a dash when it is not finite.

    **Arguments:**

    - `value`: any float.
    - `digits`: significant digits.
    """
    if not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)
    if -4 <= power < max(digits, 4):
        return _minus(f"{value:.{max(digits - 1 - power, 0)}f}")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return _minus(power_of_ten(power) if mantissa == "1" else f"{mantissa}×{power_of_ten(power)}")


def percent(share: float) -> str:
    """A share as "83 %"; a dash when it is not finite."""
    if not math.isfinite(share):
        return DASH
    return _minus(f"{100 * share:.0f} %" if abs(share) >= 0.0095 or share == 0 else f"{100 * share:.1f} %")


def p_value(p: float) -> str:
    """A p-value: two digits, never a bare zero."""
    if not math.isfinite(p):
        return DASH
    return f"< {power_of_ten(-300)}" if p < 1e-300 else number(p, 2)


def p_equals(p: float) -> str:
    """A p-value inside a sentence: "p = 0.30", "p < 10⁻³⁰⁰"; "p –" when it is not finite."""
    shown = p_value(p)
    return f"p = {shown}" if shown[0].isdigit() else f"p {shown}"


def engineering(unit: str | DisplayUnit, magnitude: float) -> tuple[float, str]:
    """The factor and the unit in which numbers of a given size read well.

    **Arguments:**

    - `unit`: the unit of the numbers, as text, or the one in which they are shown.
    - `magnitude`: their size, in `unit`.

    **Returns:**

    `(factor, label)`: multiply by `factor` and write `label`, e.g. `(1e6, "µm")`. Units that take no SI prefix
    get a power of ten instead.
    """
    if not isinstance(unit, str):
        if not unit.suits(abs(magnitude)):
            return engineering(unit.computed, magnitude)
        factor, label = engineering(unit.name, magnitude * unit.factor)
        return factor * unit.factor, label
    size = abs(magnitude)
    if not math.isfinite(size) or size == 0 or unit == "1":
        return 1.0, unit_text(unit)
    if unit in _TAKES_PREFIX:
        return prefixed(size, unit_text(unit), 0 if unit in ("m", "rad") else 3)
    if 1e-2 <= size < 1e4:
        return 1.0, unit_text(unit)
    exponent = power_of_thousand(size)
    return 10.0**-exponent, f"{power_of_ten(exponent)} {unit_text(unit)}".strip()


def quantity(value: float, unit: str | DisplayUnit, digits: int = 3) -> str:
    """A number with its unit, e.g. `quantity(1.5e-7, "rad")` is "150 nrad"; a dash when it is not finite."""
    return quantities([value], unit, digits)[0]


def quantities(values: Sequence[float], unit: str | DisplayUnit, digits: int = 3) -> list[str]:
    """Numbers that will be compared: all in the prefix that suits the largest, e.g. "1.22 µrad", "0.120 µrad".

    **Arguments:**

    - `values`: in `unit`.
    - `unit`: as in `engineering`.
    - `digits`: significant digits.
    """
    factor, label = engineering(
        unit, max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    )
    times = "×" if label.startswith("10") else " "
    return [
        f"{number(v * factor, digits)}{times}{label}".strip() if math.isfinite(v) else DASH for v in values
    ]


def shown_estimates(estimates: Mapping[str, Estimate], plant: Plant) -> dict[str, Estimate]:
    """The `estimates` in the units in which the `plant` shows positions, forces and inputs."""
    found = {}
    for name, one in estimates.items():
        unit, (value, stderr) = in_unit(plant.displayed(one.unit), one.value, one.stderr)
        found[name] = Estimate(value, stderr, unit, one.identified)
    return found


def estimate_text(estimate: Estimate) -> str:
    """Value and standard error with as many digits as the error allows, e.g. "1814.0 ± 1.9".

    **Arguments:**

    - `estimate`: the number; its unit is left to the caller.
    """
    value, stderr = estimate.value, estimate.stderr
    if not (math.isfinite(value) and math.isfinite(stderr)) or stderr <= 0:
        return number(value)
    size = max(abs(value), stderr)
    power = math.floor(math.log10(size))
    decimals = 1 - math.floor(math.log10(stderr))
    if -4 <= power < 6:
        decimals = max(decimals, 0)
        return _minus(f"{value:.{decimals}f} ± {stderr:.{decimals}f}")
    decimals = max(decimals + power, 0)
    scaled = f"({value / 10.0**power:.{decimals}f} ± {stderr / 10.0**power:.{decimals}f})"
    return _minus(f"{scaled}×{power_of_ten(power)}")


def words(name: str) -> str:
    """A name as words: `"maxwell_slip.share"` becomes "maxwell slip share"."""
    return name.replace("_", " ").replace(".", " ")


def _minus(text: str) -> str:
    return text.replace("-", "−")
