"""What a parameter is: its name, unit, typical size and admissible range."""

from typing import Literal

import equinox as eqx


class Parameter(eqx.Module):
    """A scalar parameter of a model.

    **Attributes:**

    - `name`: the field of the Module that holds it.
    - `unit`: its unit as text, in terms of `{force}`, `{position}`, `{input}` and `s`; `"1"` for a ratio.
    - `meaning`: a few words.
    - `transform`: how a fit sees it: `"log"` (positive), `"linear"`, or `"none"` (not fitted).
    - `scale`: the typical size of a linear parameter (its unit step in a fit). It may depend on the plant:
      `"Fc"`, `"sigma0"`, `"zs"` (the break-away deflection Fs/sigma0), `"stroke"`, `"dt"` stand for these.
    - `lower`, `upper`: admissible range; a fit stays inside and says when it ends at an end.
    - `probes`: finite steps, in units of `scale`, at which a strength is tried before anything is refitted.
    - `other_start`: where a refit begins besides, in units of `scale`, when from its one-step estimate it gets nowhere.
    - `grid`: values, in units of `scale`, at which a nuisance parameter (period, time constant, spread) is tried;
      `"period"` in place of numbers asks for the periods found in the data.
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
