"""A number with its standard error and its unit."""

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
