"""A plan of experiments, checked: its inputs, its numbers, and its free parameters."""

from collections import defaultdict
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Real

from frictionjax.core import InputError, Parameter
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import Free, base_layout, effect_layout, part_of
from frictionjax.estimation.scales import friction_scales
from frictionjax.physics import Drive

Numbers = Real[ArrayLike, "..."] | Sequence[Real[ArrayLike, ""]]
"""One number for all experiments, or one for each."""

Signal = Real[Array | np.ndarray, "..."]
"""One input, checked to have the shape `(n,)`."""

Inputs = Signal | Sequence[Signal]
"""One planned input of shape `(n,)`, or several, each of its own length."""

Start = tuple[Float[Array, ""], ...]
"""Where a run starts: x0, v0 and, if known, z0."""

MOTOR = Parameter("motor_constant", "{force}/{input}", "motor constant", "log")


def scale_of(layout: tuple[Free, ...], drive: Drive, stroke: float, dt: float) -> Float[np.ndarray, " p"]:
    """Typical size of each coordinate of `layout`, shape `(p,)`: 1 for a logarithm; that of a strength on `drive`, over
    the largest `stroke` (position units) and the shortest `dt` (s) of the plan."""
    sizes = friction_scales(drive, stroke, dt)
    sizes["Fc/stroke"] = sizes["Fc"] / stroke if stroke > 0.0 else 1.0
    found = []
    for one in layout:
        scale = 1.0 if one.parameter.transform == "log" else one.parameter.scale
        found.append(sizes.get(scale, 1.0) if isinstance(scale, str) else scale)
    return np.asarray(found)


def layout_of(drive: Drive, free: Sequence[str] | None) -> tuple[Free, ...]:
    """The parameters of `drive` named by `free` (None: J, friction, strengths), without numbers of the
    case, which would be compiled in."""
    known = _all_of(drive)
    if free is None:
        own = {f"effects.{i}.{p.name}" for i, effect in enumerate(drive.effects) for p in effect.strengths}
        own |= {"J", *(f"friction.{p.name}" for p in drive.friction.parameters)}
        return tuple(one for one in known.values() if one.path in own)
    free = (free,) if isinstance(free, str) else tuple(free)
    wrong = [name for name in free if name not in known]
    if wrong or not free or len(set(free)) < len(free):
        problem = f"no parameter is called {', '.join(wrong)}" if wrong else "it names none, or one twice"
        raise InputError(problem, place="`free`", cure=f"Name some of {', '.join(known)}, each once.")
    return tuple(known[name] for name in free)


def _all_of(drive: Drive) -> dict[str, Free]:
    known = (
        *base_layout(drive, 1.0),
        *effect_layout(drive, defaultdict(float)),
        Free("motor_constant", MOTOR, MOTOR.name),
    )
    return {one.label: Free(one.path, one.parameter, one.label) for one in known}


def names_of(drive: Drive) -> tuple[str, ...]:
    """Names of all parameters of `drive` that may be free."""
    return tuple(_all_of(drive))


def values_of(layout: tuple[Free, ...], drive: Drive) -> Float[np.ndarray, " p"]:
    """Values in `drive` of the parameters of `layout`, each in its unit, shape `(p,)`."""
    arrays = [np.asarray(part_of(drive, one.path)) for one in layout]
    for one, value in zip(layout, arrays, strict=True):
        positive = one.parameter.transform == "log"
        if value.ndim or not np.isfinite(value) or (positive and not value > 0.0):
            raise InputError(
                f"{one.label} = {value} is not a {'positive ' if positive else ''}finite number",
                place="`drive`",
                cure="Correct it, or leave it out of `free`; loop over drives with array parameters.",
            )
    return np.asarray(arrays, dtype=float)


class Plan(eqx.Module):
    """Planned records, checked; lists have one entry for each.

    **Attributes:** `labels` (their names in errors), `inputs` (shape `(n,)`, input units), `rates` (samples per
    second), `noises` (position units), `starts` (x0, v0 and, if known, z0, as arrays), `substeps` (steps per sample).
    """

    labels: list[str]
    inputs: list[Float[np.ndarray, " _"]]
    rates: list[float]
    noises: list[float]
    starts: list[Start]
    substeps: int

    def of(self, places: Sequence[int]) -> "Plan":
        """The records at these indices, `places`, only."""
        return Plan(
            labels=[self.labels[i] for i in places],
            inputs=[self.inputs[i] for i in places],
            rates=[self.rates[i] for i in places],
            noises=[self.noises[i] for i in places],
            starts=[self.starts[i] for i in places],
            substeps=self.substeps,
        )


def plan_of(
    inputs: Inputs,
    sample_rate: Numbers,
    noise: Numbers,
    *,
    x0: Numbers,
    v0: Numbers,
    z0: Numbers | None,
    substeps: int,
    labels: Sequence[str] | None = None,
) -> Plan:
    """The `Plan` of one or several `inputs`, called `labels`; the other arguments are those of `fisher_information`."""
    plans = inputs_of(inputs, labels)
    count = len(plans)
    rates = for_each("sample_rate", sample_rate, count, positive=True)
    noises = for_each("noise", noise, count, positive=True)
    if isinstance(substeps, str) or substeps != int(substeps) or substeps < 1:
        raise InputError(f"it is {substeps}", place="`substeps`", cure="Give a whole number, 2 or more.")
    given = {"x0": x0, "v0": v0} | ({} if z0 is None else {"z0": z0})
    starts = [for_each(name, value, count) for name, value in given.items()]
    return Plan(
        labels=[f"experiment {index}" for index in range(count)] if labels is None else list(labels),
        inputs=plans,
        rates=rates,
        noises=noises,
        starts=[tuple(real(number) for number in one) for one in zip(*starts, strict=True)],
        substeps=int(substeps),
    )


def inputs_of(inputs: Inputs, labels: Sequence[str] | None = None) -> list[Float[np.ndarray, " _"]]:
    """One or several `inputs`, called `labels` in errors, as a list of finite arrays of shape `(n,)`, input units."""
    single = getattr(inputs, "ndim", 0) == 1
    plans = [np.asarray(u, dtype=float) for u in ([inputs] if single else inputs)]
    if not plans:
        raise InputError("no experiment is planned", place="`inputs`", cure="Give at least one input.")
    for index, u in enumerate(plans):
        if u.ndim != 1 or u.size < 2 or not np.all(np.isfinite(u)):
            which = f"experiment {index}" if labels is None else labels[index]
            raise InputError(
                f"{which} has shape {u.shape}, or numbers that are not finite",
                place="`inputs`",
                cure="Give each experiment one finite array of shape (n,), n at least 2.",
            )
    return plans


def for_each(name: str, value: Numbers, count: int, *, positive: bool = False) -> list[float]:
    """The argument `name`: from its `value` one number for each of `count` experiments, `positive` if asked."""
    numbers = np.asarray(value, dtype=float)
    if numbers.ndim > 1 or (numbers.ndim == 1 and numbers.size != count):
        raise InputError(
            f"shape {numbers.shape} for {count} experiments",
            place=f"`{name}`",
            cure="Give one number, or one for each experiment.",
        )
    if not np.all(np.isfinite(numbers)) or (positive and not np.all(numbers > 0.0)):
        raise InputError(
            f"it is {value}", place=f"`{name}`", cure=f"Give {'positive' if positive else 'finite'} numbers."
        )
    return np.broadcast_to(numbers, (count,)).tolist()
