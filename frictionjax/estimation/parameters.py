"""Free parameters of a drive as one scaled vector, in which a step of 1 is a large but sensible step.

Positive parameters are logarithms, Fs as log(Fs/Fc - 1), sigma0 as log(sigma0/J), sigma1 as the logarithm of
the damping ratio sigma1 / (2 sqrt(sigma0 J)), strengths of effects in units of their scale.
"""

import functools
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree, Shaped

from frictionjax.core import Parameter
from frictionjax.core.arrays import Numbers, numpy_or_jax
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.core.safe import real
from frictionjax.physics import Drive

# Fs is between these parts above Fc: at Fs = Fc its logarithm, and the sensitivity to vs, would vanish for good;
# far above, Fs and vs together make a narrow peak that fits single samples.
_LEAST_EXCESS, _MOST_EXCESS = 1e-3, 2.0
# Damping ratio sigma1 / (2 sqrt(sigma0 J)) of the bristle: far above critical, sigma1 dz/dt becomes an impulse at every
# velocity reversal that no integration step of the length of a sample can follow.
_LEAST_RATIO, _MOST_RATIO = 1e-3, 1.5
# Natural frequency of the bristle, rad per integration step: the scheme does not follow faster ones.
_FASTEST = 0.6
# How far (factor) a positive parameter may go from its start. The starting values of inertia and Coulomb friction are
# reliable; those of stiffness and damping may be guesses. A period is searched beforehand; a wave much longer than the
# stroke would be a spring.
_REACH = {"J": 3.0, "Fc": 4.0, "sigma2": 100.0, "vs": 30.0, "period": 1.5}
_WIDEST = 1e4
# Standard deviations of the weak prior: of a logarithm, of a strength in its unit, of a starting deflection.
_PRIOR_LOG, _PRIOR_STRENGTH, _PRIOR_DEFLECTION = np.array([3.0, 1e3, 0.5]) / np.sqrt(2.0)
_ALIKE = 1e-9  # part of a value: one that is no further from a bound is at it
INSIDE = 1e-3  # how far from an end of its range a logarithm starts: on it there would be no slope


def _number(value: Float[Numbers, ""] | float) -> Float[Numbers, ""]:
    """As `core.safe.real`; the same numbers come up in every layout, and JAX takes 90 us to make an array of one."""
    return _array_of(value, jax.dtypes.canonicalize_dtype(float)) if type(value) is float else real(value)


@functools.lru_cache(maxsize=1024)
def _array_of(value: float, dtype: np.dtype) -> Array:
    with jax.ensure_compile_time_eval():
        return jax.device_put(np.asarray(value, dtype))  # `jnp.asarray` compiles a program of its own


class Free(PlainMethods, eqx.Module):
    """One free parameter: where it sits (`path` in the `Drive`), what it is (`parameter`), its `label` (the parameter's
    own name, with that of its effect before it where another parameter has the same), its `scale`, the `upper` bound
    of its value, and `least` and `most`, the user's own bounds. The last four are numbers of the case, and arrays: a
    new case compiles nothing anew. `imposed`: all motion is imposed; the inertia, which then acts on nothing, bounds
    nothing."""

    path: str = eqx.field(static=True)
    parameter: Parameter = eqx.field(static=True)
    label: str = eqx.field(static=True)
    scale: Float[Numbers, ""] = eqx.field(converter=_number, default=1.0)
    upper: Float[Numbers, ""] = eqx.field(converter=_number, default=jnp.inf)
    least: Float[Numbers, ""] = eqx.field(converter=_number, default=-jnp.inf)
    most: Float[Numbers, ""] = eqx.field(converter=_number, default=jnp.inf)
    imposed: bool = eqx.field(static=True, default=False)

    def range(
        self, start: Float[Numbers, ""] | float
    ) -> tuple[Float[Numbers, ""] | float, Float[Numbers, ""] | float]:
        """Admissible range of the coordinate of a parameter that starts at `start` (same coordinate)."""
        lower, upper = self.parameter.lower, self.upper
        xp = numpy_or_jax(start, upper)
        none = xp.zeros_like(start)
        if self.path == "friction.Fs":
            return math.log(_LEAST_EXCESS) + none, math.log(_MOST_EXCESS) + none
        if self.path == "friction.sigma1" and not self.imposed:
            return math.log(_LEAST_RATIO) + none, math.log(_MOST_RATIO) + none
        if self.parameter.transform == "log":
            reach = math.log(_REACH.get(self.parameter.name, _WIDEST))
            low = xp.maximum(start - reach, math.log(lower) if lower > 0.0 else -jnp.inf)
            return low, xp.minimum(start + reach, xp.log(upper))
        return lower / self.scale + none, upper / self.scale + none


INERTIA = Parameter("J", "{force}*s^2/{position}", "inertia", "log")


def base_layout(
    drive: Drive, dt: float, *, known_inertia: bool = False, imposed: bool = False
) -> tuple[Free, ...]:
    """The free parameters of the base model: J (unless known) and the six of LuGre, where no integration step is longer
    than `dt` s; `imposed` as in `Free`."""
    inertia = () if known_inertia else (Free("J", INERTIA, "J"),)
    friction = []
    for parameter in drive.friction.parameters:
        bounded = parameter.name == "sigma0" and not imposed
        upper = (_FASTEST / dt) ** 2 if bounded else parameter.upper
        path = f"friction.{parameter.name}"
        friction.append(Free(path, parameter, parameter.name, upper=upper, imposed=imposed))
    return inertia + tuple(friction)


def effect_layout(drive: Drive, scales: dict[str, float], *, first: int = 0) -> tuple[Free, ...]:
    """The free parameters of the effects of `drive`, from effect number `first` on; `scales` gives the plant's own
    sizes by name."""
    layout, labels = [], effect_labels(drive)
    for index, effect in enumerate(drive.effects):
        for parameter in effect.strengths + effect.nuisances:
            if index < first or parameter.transform == "none":
                continue
            scale = 1.0
            if parameter.transform == "linear":
                scale = (
                    parameter.scale if isinstance(parameter.scale, float) else scales[str(parameter.scale)]
                )
            path = f"effects.{index}.{parameter.name}"
            layout.append(Free(path, parameter, labels[path], scale, parameter.upper))
    return tuple(layout)


def effect_labels(drive: Drive) -> dict[str, str]:
    """Path -> label of every parameter of the effects of `drive`: its own name, with that of its effect before it where
    another parameter has the same."""
    labels, taken = {}, {"J", *(parameter.name for parameter in drive.friction.parameters)}
    for index, effect in enumerate(drive.effects):
        for parameter in effect.strengths + effect.nuisances:
            label = f"{effect.name}.{parameter.name}" if parameter.name in taken else parameter.name
            taken.add(label)
            labels[f"effects.{index}.{parameter.name}"] = label
    return labels


def part_of(tree: PyTree, path: str) -> PyTree:
    """The part of the Module `tree` at the dotted `path`, such as `effects.0.load`."""
    for part in path.split("."):
        tree = tree[int(part)] if part.isdigit() else getattr(tree, part)
    return tree


def pack(layout: tuple[Free, ...], drive: Drive) -> Float[Numbers, " p"]:
    """The vector of `drive`'s free parameters, shape `(p,)`."""
    xp = numpy_or_jax(layout, drive)
    if xp is np:
        layout, drive = jax.device_get((layout, drive))
    values = []
    # What is zero has no logarithm; it starts at the end of its range.
    with np.errstate(divide="ignore", invalid="ignore"):
        for free in layout:
            value = part_of(drive, free.path)
            if free.path == "friction.Fs":
                coordinate = xp.log(xp.maximum(value / drive.friction.Fc - 1.0, _LEAST_EXCESS))
            elif free.path == "friction.sigma0":
                coordinate = xp.log(value / drive.J)
            elif free.path == "friction.sigma1":
                coordinate = xp.log(value / (2.0 * xp.sqrt(drive.friction.sigma0 * drive.J)))
            elif free.parameter.transform == "log":
                coordinate = xp.log(value)
            else:
                coordinate = value / free.scale
            if free.parameter.transform == "log":
                # A start on or beyond an end of its range would have no slope.
                low, high = free.range(coordinate)
                coordinate = xp.clip(coordinate, low + INSIDE, high - INSIDE)
            values.append(coordinate)
    return xp.stack(values) if values else xp.zeros(0)


def unpack(
    layout: tuple[Free, ...], drive: Drive, vector: Float[Numbers, " p"], start: Float[Numbers, " p"]
) -> Drive:
    """`drive` with its free parameters set from `vector`; each stays inside its range."""
    xp = numpy_or_jax(layout, drive, vector, start)
    if xp is np:
        layout, known_drive, vector, start = jax.device_get((layout, drive, vector, start))
    else:
        known_drive = drive
    values = []
    # Fs is relative to Fc, sigma0 to J, sigma1 to both; these come before them in every layout (or are known).
    friction = known_drive.friction
    known = {"J": known_drive.J, "friction.sigma0": friction.sigma0, "friction.Fc": friction.Fc}
    for index, free in enumerate(layout):
        coordinate = xp.clip(vector[index], *free.range(start[index]))
        if free.parameter.transform == "log":
            value = xp.exp(coordinate)
            if free.path == "friction.Fs":
                value = known["friction.Fc"] * (1.0 + value)
            elif free.path == "friction.sigma0":
                value = known["J"] * value
            elif free.path == "friction.sigma1":
                value = value * 2.0 * xp.sqrt(known["friction.sigma0"] * known["J"])
        else:
            value = coordinate * free.scale
        value = xp.clip(value, free.least, free.most)
        if free.path == "friction.Fs":
            # Whatever the user's bound, static friction stays above Coulomb friction.
            value = xp.maximum(value, known["friction.Fc"] * (1.0 + _LEAST_EXCESS))
        known[free.path] = value
        values.append(value)
    values = jax.device_put(values) if xp is np else values
    return eqx.tree_at(lambda d: [part_of(d, free.path) for free in layout], drive, values)


def changed(
    vector: Float[Numbers, " q"],
    where: int | np.integer | slice | Sequence | Shaped[np.ndarray, "..."],
    values: float | Sequence | Float[Numbers, "..."],
) -> Float[Numbers, " q"]:
    """A copy of `vector` with these `values` at `where`; by NumPy, for which no shape is compiled."""
    new = np.array(vector)
    new[where] = values
    return new


def touching(
    layout: tuple[Free, ...],
    vector: Float[Numbers, " p"],
    start: Float[Numbers, " p"],
    *,
    margin: float = 0.0,
) -> Bool[Numbers, " p"]:
    """Which free parameters are at an end of their admissible range, or have their logarithm within `margin` of it;
    other arguments as in `unpack`. Works inside transformations."""
    xp = numpy_or_jax(layout, vector, start)
    if xp is np:
        layout, vector, start = jax.device_get((layout, vector, start))
    found = []
    for index, free in enumerate(layout):
        low, high = free.range(start[index])
        near = margin if free.parameter.transform == "log" else 0.0
        found.append((low + near < vector[index]) & (vector[index] < high - near))
    return ~xp.stack(found) if found else xp.zeros(0, dtype=bool)


def at_a_bound(
    layout: tuple[Free, ...],
    vector: Float[Numbers, " p"],
    start: Float[Numbers, " p"],
    *,
    margin: float = 0.0,
) -> tuple[str, ...]:
    """Labels of the free parameters that are `touching` an end of their admissible range; arguments as there."""
    ends = touching(layout, vector, start, margin=margin)
    return tuple(free.label for free, end in zip(layout, ends, strict=True) if end)


def at_an_end(
    layout: tuple[Free, ...],
    vector: Float[Numbers, " p"],
    start: Float[Numbers, " p"],
    values: Float[Numbers, " p"],
) -> Bool[Numbers, " p"]:
    """Which free parameters the end of their range holds, so that the data do not: those where a descent is stopped
    before the end of the admissible range, and those whose physical `values` are at a bound of the user's; other
    arguments as in `unpack`. Works inside transformations."""
    xp = numpy_or_jax(layout, vector, start, values)
    found = touching(layout, vector, start, margin=2.0 * INSIDE)
    if not layout:
        return found
    least, most = (xp.stack([getattr(free, end) for free in layout]) for end in ("least", "most"))
    near = _ALIKE * xp.abs(values)
    return found | (values - least <= near) | (most - values <= near)


def weak_prior(layout: tuple[Free, ...], recordings: int) -> Float[Numbers, " q"]:
    """Inverse standard deviations of the weak prior for the parameters of `layout` and the starting deflections of
    so many `recordings`, shape `(q,)`."""
    deviation = [_PRIOR_LOG if free.parameter.transform == "log" else _PRIOR_STRENGTH for free in layout]
    return 1.0 / np.asarray(deviation + [_PRIOR_DEFLECTION] * recordings)
