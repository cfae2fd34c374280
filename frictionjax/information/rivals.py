"""Two models to discriminate between: the effect each adds to a drive, their names, and the parameters of a refit."""

from collections.abc import Sequence

import jax
import numpy as np

from frictionjax.core import InputError
from frictionjax.estimation.parameters import Free
from frictionjax.information.planned import layout_of, names_of
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect

BASE = "base model"


def base_and(drive: Drive, effect: AbstractEffect | None) -> Drive:
    """`drive` with the `effect`, if there is one."""
    return drive if effect is None else drive.with_effects(effect)


def named_pair(first: AbstractEffect | None, second: AbstractEffect | None) -> tuple[str, str]:
    """Names of the models with the effects `first` and `second`; an error when no experiment can distinguish them."""
    for place, effect in (("`first`", first), ("`second`", second)):
        if effect is None:
            continue
        if not isinstance(effect, AbstractEffect):
            raise InputError(
                f"it is {effect!r}", place=place, cure="Give an effect of the `catalogue`, or None."
            )
        if not all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(effect)):
            raise InputError(
                f"{effect.name} has a value that is not finite", place=place, cure="Give finite values."
            )
        if all(float(getattr(effect, one.name)) == 0.0 for one in effect.strengths):
            strengths = ", ".join(one.name for one in effect.strengths)
            raise InputError(
                f"{effect.name} with no strength is the base model",
                place=place,
                cure=f"Give {strengths} a typical size, or None for the base model.",
            )
    if len({(type(effect), _fixed(effect)) for effect in (first, second)}) == 1:
        raise InputError(
            f"both are {BASE if first is None else first.name}, and a refit compensates for a different strength",
            place="`first`, `second`",
            cure="Give two effects, or two forms of one.",
        )
    same_name = first is not None and second is not None and first.name == second.name
    names = [
        BASE if e is None else f"{e.name} ({type(e).__name__})" if same_name else e.name
        for e in (first, second)
    ]
    if names[0] == names[1] and first is not None and second is not None:
        names = [f"{first.name} ({_fixed(e)})" for e in (first, second)]
    return names[0], names[1]


def _fixed(effect: AbstractEffect | None) -> str:
    """The nuisances of an effect, which a refit of its strengths leaves as they are, in words."""
    nuisances = () if effect is None else effect.nuisances
    return ", ".join(f"{one.name} {float(getattr(effect, one.name)):g}" for one in nuisances)


def free_of(
    drive: Drive, first: AbstractEffect | None, second: AbstractEffect | None, free: Sequence[str] | None
) -> list[tuple[Free, ...]]:
    """The free parameters of the models of `drive` with `first` and with `second`: those of `free` (None: the default)
    that each has, and its strengths."""
    models = [base_and(drive, first), base_and(drive, second)]
    if free is None:
        return [layout_of(model, None) for model in models]
    free = (free,) if isinstance(free, str) else tuple(free)
    known = [names_of(model) for model in models]
    wrong = [name for name in free if not any(name in names for names in known)]
    if wrong or len(set(free)) < len(free):
        problem = f"neither model has {', '.join(wrong)}" if wrong else "it names one twice"
        every = ", ".join(dict.fromkeys([*known[0], *known[1]]))
        raise InputError(problem, place="`free`", cure=f"Name some of {every}, each once.")
    layouts = []
    for model, effect, names in zip(models, (first, second), known, strict=True):
        own = [] if effect is None else _strengths(model, len(drive.effects))
        some = [name for name in free if name in names]
        layouts.append(layout_of(model, list(dict.fromkeys([*some, *own]))))
    return layouts


def _strengths(model: Drive, place: int) -> list[str]:
    """Labels of the strengths of effect number `place` of `model`."""
    return [one.label for one in layout_of(model, None) if one.path.startswith(f"effects.{place}.")]
