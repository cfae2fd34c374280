"""What a parameter is: its name, unit, typical size and admissible range."""

from typing import Literal

import equinox as eqx


class Parameter(eqx.Module):
    """A scalar parameter of a model.

    **Attributes:**

    - `name`: the field of the Module with its value.
    - `unit`: its unit as text, in terms of `{force}`, `{position}`, `{input}` and `s`; `"1"` for a ratio.
    - `meaning`: a few words.
    - `transform`: what a fit varies: the logarithm of a positive parameter (`"log"`), the parameter (`"linear"`),
      or nothing (`"none"`).
    - `scale`: the typical size of a linear parameter (its unit step in a fit). It may depend on the plant:
      `"Fc"`, `"sigma0"`, `"zs"` (the break-away deflection Fs/sigma0), `"stroke"`, `"dt"` stand for these.
    - `lower`, `upper`: admissible range; a fit stays inside and reports when it stops at a bound.
    - `probes`: finite steps, in units of `scale`, at which a strength is tried before anything is refitted.
    - `other_start`: a second starting value of a refit, in units of `scale`, used when the first leads nowhere.
    - `grid`: values, in units of `scale`, at which a nuisance parameter (period, time constant, spread) is tried;
      `"period"` in place of numbers stands for the periods found in the data.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    meaning: str = eqx.field(static=True)
    transform: Literal["log", "linear", "none"] = eqx.field(static=True, default="linear")
    scale: float | str = eqx.field(static=True, default=1.0)
    lower: float = eqx.field(static=True, default=-float("inf"))
    upper: float = eqx.field(static=True, default=float("inf"))
    probes: tuple[float, ...] = eqx.field(static=True, default=(0.02,))
    other_start: float | None = eqx.field(static=True, default=None)
    grid: tuple[float, ...] | Literal["period"] = eqx.field(static=True, default=())
