"""`Axis`: one quantity that a study varies, with its unit and its values or its range."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Shaped
from scipy import special

from frictionjax.core import InputError

Scale = Literal["linear", "log", "normal"]
"""How a range is covered: evenly, evenly in its logarithm, or by a normal distribution about its middle."""

_NORMAL_95 = 1.959963984540054


@dataclasses.dataclass(frozen=True)
class Axis:
    """One quantity that a study varies: a list of `values`, or the range from `low` to `high`.

    **Attributes:**

    - `name`: what the task calls it: a parameter of the machine, a property of the experiment, or an argument of the
        user's own function.
    - `values`: numbers, booleans or texts, one kind throughout; empty for a range.
    - `low`, `high`: the ends of a range, in `unit`.
    - `scale`: `"linear"`, `"log"` (evenly in the logarithm), or `"normal"`, for random and Sobol designs, with 95 % of
        the cases from `low` to `high`.
    - `count`: how many values of a range a factorial design takes, both ends included.
    - `unit`: as text; "1" for a number without one.
    """

    name: str
    values: Sequence[Any] | np.ndarray = ()
    low: float | None = None
    high: float | None = None
    scale: Scale = "linear"
    count: int | None = None
    unit: str = "1"

    def __post_init__(self) -> None:
        given = () if self.values is None else self.values
        values = tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)
        object.__setattr__(self, "values", tuple(_plain(value) for value in values))
        problem, cure = self._problem()
        if problem:
            raise InputError(problem, place=f"axis `{self.name}`", cure=cure)

    def _problem(self) -> tuple[str, str]:
        """What is wrong with it, and what corrects it; nothing where all is well."""
        if not _is_name(self.name) or self.name in RESERVED:
            used = f" and none of {', '.join(RESERVED)}" if self.name in RESERVED else ""
            return "it cannot be used as a name", f"Use letters, digits and underscores{used}"
        if self.values:
            if self.low is not None or self.high is not None:
                return "it has values and a range", "Give `values`, or `low` and `high`"
            if len({_kind(value) for value in self.values}) > 1 or _kind(self.values[0]) is None:
                return "its values are of several kinds", "Give numbers, or booleans, or texts"
            if len(set(self.values)) < len(self.values):
                return "a value occurs twice", "Repeat cases by `repeats` of the design"
            return "", ""
        if self.low is None or self.high is None:
            return "it has no values", "Give `values`, or `low` and `high`"
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            return f"its range is from {self.low} to {self.high}", "Give a finite `low` below a finite `high`"
        if self.scale not in ("linear", "log", "normal"):
            return f"`scale` is {self.scale!r}", 'Choose "linear", "log" or "normal"'
        if self.scale == "log" and self.low <= 0.0:
            return f"its logarithmic range begins at {self.low}", "Give a positive `low`"
        if self.count is not None and self.count < 2:
            return f"`count` is {self.count}", "Take two values or more"
        return "", ""

    def levels(self) -> Shaped[np.ndarray, " k"]:
        """The values that a factorial design takes, shape `(k,)`.

        **Raises:** `InputError` for a range without `count`, or with a normal distribution.
        """
        if self.values:
            return _array(self.values)
        if self.count is None or self.scale == "normal":
            raise InputError(
                "a factorial design needs to know its values",
                place=f"axis `{self.name}`",
                cure='Give `values`, or a `count` and the scale "linear" or "log"',
            )
        return self.at(np.linspace(0.0, 1.0, self.count))

    def at(self, part: Float[np.ndarray, " n"]) -> Shaped[np.ndarray, " n"]:
        """The values at `part` of the way through the axis, in [0, 1), shape `(n,)`: by its distribution function."""
        if self.values:
            place = np.minimum((part * len(self.values)).astype(int), len(self.values) - 1)
            return _array(self.values)[place]
        assert self.low is not None and self.high is not None
        if self.scale == "log":
            # The ends are exact, whatever the logarithms round to.
            inside = np.exp((1.0 - part) * math.log(self.low) + part * math.log(self.high))
            return np.where(part == 0.0, self.low, np.where(part == 1.0, self.high, inside))
        if self.scale == "normal":
            middle, half = (self.low + self.high) / 2.0, (self.high - self.low) / 2.0
            return middle + half / _NORMAL_95 * special.ndtri(np.clip(part, 1e-12, 1.0 - 1e-12))
        return (1.0 - part) * self.low + part * self.high

    def described(self) -> dict[str, Any]:
        """Its fields that are given, in the types of JSON."""
        fields = dataclasses.asdict(self)
        own = (
            {"values": list(self.values)}
            if self.values
            else {n: fields[n] for n in ("low", "high", "scale", "count")}
        )
        return {"name": self.name, **{n: v for n, v in own.items() if v is not None}, "unit": self.unit}


RESERVED = ("key", "rng", "case", "repeat", "failed", "reason")
"""Names that a study gives itself."""


def _is_name(name: Any) -> bool:
    """Whether it is an identifier, or several with dots between them, as a parameter of an effect may have."""
    return isinstance(name, str) and all(part.isidentifier() for part in name.split("."))


def _plain(value: Any) -> Any:
    return (
        value.item()
        if isinstance(value, np.generic) or (hasattr(value, "ndim") and value.ndim == 0)
        else value
    )


def _kind(value: Any) -> type | None:
    for kind in (bool, str):
        if isinstance(value, kind):
            return kind
    return float if isinstance(value, int | float) and math.isfinite(value) else None


def _array(values: Sequence[Any] | np.ndarray) -> Shaped[np.ndarray, " k"]:
    """Whole numbers stay whole; texts become objects, which no array cuts short."""
    return np.array(values, dtype=object) if isinstance(values[0], str) else np.array(values)
