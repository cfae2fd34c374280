"""A number with its standard error and its unit."""

import math

import equinox as eqx


class Estimate(eqx.Module):
    """An estimated quantity.

    **Attributes:**

    - `value`: the estimate, in `unit`.
    - `stderr`: its standard error, in `unit`; `inf` when the data do not determine the quantity.
    - `unit`: the unit, as text (`"1"` for a ratio).
    - `identified`: False when the recordings do not determine the value (it then rests on the prior).
    """

    value: float = eqx.field(static=True)
    stderr: float = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    identified: bool = eqx.field(static=True, default=True)

    def __str__(self) -> str:
        known = f"± {self.stderr:.2g}" if math.isfinite(self.stderr) else "(not determined)"
        return " ".join(filter(None, (f"{self.value:.7g}", known, "" if self.unit == "1" else self.unit)))

    def __repr__(self) -> str:
        # To the last digit: this text may stand for the number, in the key of a compiled program.
        known = "" if self.identified else ", identified=False"
        return f"Estimate(value={self.value!r}, stderr={self.stderr!r}, unit={self.unit!r}{known})"
