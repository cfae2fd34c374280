"""Which parameters are free, fixed or tied, within which bounds, and their priors."""

import math
from collections.abc import Mapping, Sequence
from typing import NoReturn

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError, Parameter
from frictionjax.core.arrays import Numbers
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import Free, base_layout, effect_layout, part_of
from frictionjax.physics import Drive

MOTOR = Parameter("motor_constant", "{force}/{input}", "force per input unit", "log")


class Tie(eqx.Module):
    """A parameter that follows another: `label` = `factor` times `source`.

    **Attributes:** `path`, `source_path` (places in the `Drive`), `label`, `source`, `unit` of the label, `factor`.
    """

    path: str = eqx.field(static=True)
    source_path: str = eqx.field(static=True)
    label: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    factor: Float[Numbers, ""] = eqx.field(converter=real)


class Belief(eqx.Module):
    """A Gaussian prior of one parameter: `mean` and standard deviation `std`, in its unit.

    **Attributes:** `label`, `path` (place in the `Drive`), `mean`, `std`.
    """

    label: str = eqx.field(static=True)
    path: str = eqx.field(static=True)
    mean: Float[Numbers, ""] = eqx.field(converter=real)
    std: Float[Numbers, ""] = eqx.field(converter=real)

    def value(self, drive: Drive) -> Float[Numbers, ""]:
        """The parameter in `drive`."""
        return part_of(drive, self.path)


class Held(eqx.Module):
    """A narrow prior that holds one of several parameters at `mean` within `std`, in its unit. Which one is an array:
    choosing another compiles nothing anew.

    **Attributes:** `paths` (places in the `Drive`), `chosen` (1 for the one, 0 for the others, shape `(p,)`), `mean`,
    `std`.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    chosen: Float[Numbers, " p"]
    mean: Float[Numbers, ""] = eqx.field(converter=real)
    std: Float[Numbers, ""] = eqx.field(converter=real)

    def value(self, drive: Drive) -> Float[Numbers, ""]:
        """The parameter in `drive`."""
        return jnp.sum(self.chosen * jnp.stack([part_of(drive, path) for path in self.paths]))


class Constraints(eqx.Module):
    """The free parameters, ties and priors of a fit, checked against each other.

    **Attributes:** `layout` (free parameters), `ties`, `beliefs`.
    """

    layout: tuple[Free, ...]
    ties: tuple[Tie, ...]
    beliefs: tuple[Belief | Held, ...]

    def tied(self, drive: Drive) -> Drive:
        """`drive` with its tied parameters set from those that they follow."""
        for tie in self.ties:
            value = tie.factor * part_of(drive, tie.source_path)
            drive = eqx.tree_at(lambda d, path=tie.path: part_of(d, path), drive, value)
        return drive


_CHOOSE_ONE = "Take it out of one of the two."


def _fail(argument: str, problem: str, cure: str) -> NoReturn:
    raise InputError(problem, place=f"`{argument}`", cure=cure)


def resolve(
    drive: Drive,
    dt: float,
    scales: Mapping[str, float],
    *,
    free: Sequence[str] | None,
    fixed: Sequence[str],
    ties: Mapping[str, tuple[str, float]],
    bounds: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
    imposed: bool = False,
) -> Constraints:
    """The constraints of a fit of `drive` to samples of `dt` s, checked against each other; `imposed` as in
    `parameters.Free`, other arguments as in `fit`.

    **Raises:**

    `InputError` for a name that is not a parameter, one that is asked to be two things at once, ties that lead in a
    circle or against physics, bounds that are empty or that the start is outside of, and a prior without width.
    """
    layout = (*base_layout(drive, dt, imposed=imposed), Free("motor_constant", MOTOR, "motor_constant"))
    layout += effect_layout(drive, dict(scales))
    known = {one.label: one for one in layout}
    asked = {"free": free or (), "fixed": fixed, "ties": ties, "bounds": bounds, "priors": priors}
    for argument, names in asked.items():
        for name in names:
            if name not in known:
                _fail(
                    argument, f"`{name}` is not a parameter of this drive", f"Choose from {', '.join(known)}."
                )
    all_free = free is None
    if free is None:
        # Without a known motor constant every force is relative to it: it is free only when asked for by name.
        free = [name for name in known if name != "motor_constant"]
    chosen = [name for name in known if name in free and name not in fixed and name not in ties]
    asked_free = set() if all_free else set(free)
    for first, second, names in (
        ("fixed", "tied", set(fixed) & set(ties)),
        ("free", "fixed", asked_free & set(fixed)),
        ("free", "tied", asked_free & set(ties)),
        ("bounded", "fixed or tied", set(bounds) & ({*fixed, *ties})),
    ):
        if names:
            which = ", ".join(sorted(names))
            _fail(
                "ties" if second == "tied" else "fixed",
                f"{which} would be both {first} and {second}",
                _CHOOSE_ONE,
            )
    if not chosen:
        _fail("free", "nothing is left to be found: every parameter is fixed or tied", "Free at least one.")
    if "motor_constant" in chosen and "J" in chosen and not {"J", "motor_constant"} & set(priors):
        _fail(
            "free",
            "J and motor_constant can be identified only as a ratio: a common factor of all forces changes nothing",
            "Fix one of them, or give one of them a prior.",
        )
    bounds = dict(bounds)
    if "Fc" in chosen and "Fs" not in (*chosen, *ties):
        # Coulomb friction stays below a static friction that is fixed.
        low, high = bounds.get("Fc", (0.0, math.inf))
        bounds["Fc"] = (low, min(high, float(drive.friction.Fs)))
    resolved = tuple(_with_bounds(known[name], bounds.get(name), drive) for name in chosen)
    return Constraints(resolved, _ties(ties, known), _beliefs(priors, known))


def _with_bounds(one: Free, bounds: tuple[float, float] | None, drive: Drive) -> Free:
    if bounds is None:
        return one
    least, most = (float(end) for end in bounds)
    if not least < most:
        _fail(
            "bounds", f"{one.label} would lie between {least:g} and {most:g}", "Give the lower bound first."
        )
    value = float(np.asarray(part_of(drive, one.path)))
    if not least <= value <= most:
        cure = f"Start it inside, or widen the bounds of {one.label}."
        _fail("bounds", f"{one.label} starts at {value:g}, outside of {least:g} ... {most:g}", cure)
    return eqx.tree_at(lambda f: (f.least, f.most), one, (real(least), real(most)))


def _ties(ties: Mapping[str, tuple[str, float]], known: Mapping[str, Free]) -> tuple[Tie, ...]:
    found = []
    for name, (source, factor) in ties.items():
        if source not in known:
            _fail("ties", f"`{source}` is not a parameter of this drive", f"Choose from {', '.join(known)}.")
        if source == name or source in ties:
            _fail(
                "ties",
                f"{name} follows {source}, which is itself tied",
                "Tie both to one parameter that is free or fixed.",
            )
        positive = known[name].parameter.transform == "log"
        if not np.isfinite(factor) or (positive and not factor > 0.0):
            _fail("ties", f"{name} would be {factor:g} times {source}", "Give a positive, finite factor.")
        if ((name, source) == ("Fs", "Fc") and factor <= 1.0) or (
            (name, source) == ("Fc", "Fs") and factor >= 1.0
        ):
            cure = f"Fs must exceed Fc: use a factor {'above' if name == 'Fs' else 'below'} 1."
            _fail("ties", f"{name} = {factor:g} {source} contradicts Fs > Fc", cure)
        unit = known[name].parameter.unit
        found.append(Tie(known[name].path, known[source].path, name, source, unit, factor))
    return tuple(found)


def _beliefs(priors: Mapping[str, tuple[float, float]], known: Mapping[str, Free]) -> tuple[Belief, ...]:
    found = []
    for name, (mean, std) in priors.items():
        if not (np.isfinite(mean) and 0.0 < std < np.inf):
            _fail(
                "priors",
                f"{name} has mean {mean:g} and standard deviation {std:g}",
                "Give both, std positive.",
            )
        found.append(Belief(name, known[name].path, mean, std))
    return tuple(found)


def belief_residuals(beliefs: tuple[Belief | Held, ...], drive: Drive) -> Float[Numbers, " k"]:
    """Residuals of the priors `beliefs` at `drive`, (value - mean) / std each, shape `(k,)`."""
    if not beliefs:
        return jnp.zeros(0)
    return jnp.stack([(one.value(drive) - one.mean) / one.std for one in beliefs])
