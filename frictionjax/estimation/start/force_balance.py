"""The force balance: which force of the catalogue, beside inertia and friction, carries the motor force.

A textbook regression of the motor force on the smoothed motion. It names nothing: where the base model has come to rest
in a wrong minimum, because gravity or a spring is most of the force, it says where a refit may start.
"""

import dataclasses
from typing import cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.start.driven import CLEARER
from frictionjax.estimation.start.sliding import (
    WINDOWS,
    SlidingFit,
    SlidingMotion,
    fit_sliding,
    smooth_motion,
)
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects import (
    AbstractEffect,
    AbstractForceEffect,
    AbstractStateEffect,
    Now,
    catalogue,
)
from frictionjax.recordings import Recording

_BREAK_AWAY = 1.2  # static over Coulomb friction, where a refit starts
_LEAST_FRICTION = 0.02  # of the root mean square motor force


class Balanced(eqx.Module):
    """A force that the balance asks for.

    **Attributes:** the `effect`, with its strengths; `drives`, with the friction and inertia of the same balance, where
    a fit may start; `unexplained`: part of the motor force that is left.
    """

    effect: AbstractForceEffect
    drives: tuple[Drive, ...]
    unexplained: float = eqx.field(static=True)


def force_balance(
    recordings: tuple[Recording, ...],
    starts: tuple[Drive, ...],
    *,
    inertia: float | None = None,
    without: frozenset[str] = frozenset(),
    turn: float = 2.0 * np.pi,
) -> tuple[Balanced, ...]:
    """The forces of the catalogue, linear in their strengths, that lower the unexplained part of the motor force much
    (`CLEARER`), beside a constant force or alone, the one that leaves least first.

    **Arguments:**

    - `recordings`: force-driven, those to fit.
    - `starts`: starting values of the base fit, which vary what the balance does not show: bristle stiffness and
        damping.
    - `inertia`: known inertia, or None.
    - `without`: names of effects, or of forms, to leave out.
    - `turn`: a full turn, position units, where the position is an angle.
    """
    friction, constant = starts[0].friction, float(starts[0].motor_constant)
    trials = [tuple(smooth_motion(r, constant, seconds) for r in recordings) for seconds in WINDOWS]
    plain = [fit_sliding(motions, inertia=inertia) for motions in trials]
    best = min(range(len(trials)), key=lambda number: (not plain[number].credible, plain[number].unexplained))
    # Without a force of the catalogue: of each smoothing, without and with a constant force.
    before = {
        number: (fit_sliding(trials[number], inertia=inertia, offset=False), plain[number])
        for number in (best, 0)
    }
    found = []
    for form in linear_forces(without, turn):
        for number, fits in before.items():
            motions = trials[number]
            balance = _balance(form, friction, motions, inertia, *fits)
            if balance is None:
                continue
            sizes, after = balance
            strengths = {p.name: size for p, size in zip(form.strengths, sizes, strict=True)}
            effect = dataclasses.replace(form, **strengths)
            drives = tuple(_with_friction(start, after, motions) for start in starts)
            found.append(Balanced(effect, drives, after.unexplained))
            break
    return tuple(sorted(found, key=lambda one: one.unexplained))


def _balance(
    form: AbstractForceEffect,
    friction: LuGre,
    motions: tuple[SlidingMotion, ...],
    inertia: float | None,
    none: SlidingFit,
    constant: SlidingFit,
) -> tuple[tuple[float, ...], SlidingFit] | None:
    """Strengths of the `form` along the `motions`, and the fit with it, where it explains much more than the same fit
    without it: with `none`, or with a `constant` force; else None. `friction` gives scales, `inertia` as in
    `force_balance`.

    A constant force is compared with none. Any other force is it beside one, and, where that says little, alone if it
    explains more than a constant one: a pendulum that swings a little has a torque that is nearly constant.
    """
    columns = [_forces(form, friction, motion) for motion in motions]
    if np.all(np.ptp(np.concatenate(columns), axis=0) == 0.0):
        return ((constant.offset,), constant) if _much_clearer(constant, none) else None
    beside = fit_sliding(motions, inertia=inertia, beside=columns)
    if _much_clearer(beside, constant):
        return beside.beside, beside
    alone = fit_sliding(motions, inertia=inertia, beside=columns, offset=False)
    if _much_clearer(alone, none) and alone.unexplained < constant.unexplained:
        return alone.beside, alone
    return None


def _much_clearer(fit: SlidingFit, other: SlidingFit) -> bool:
    return fit.explains and fit.unexplained < CLEARER * other.unexplained


def linear_forces(
    without: frozenset[str] = frozenset(), turn: float = 2.0 * np.pi
) -> list[AbstractForceEffect]:
    """The forms in the catalogue that are forces of the present motion, linear in their strengths and without other
    parameters; at zero strength. `without`: names of effects, or of forms, to leave out; `turn` as in
    `force_balance`."""
    return [
        cast(AbstractForceEffect, form().in_turns_of(turn))  # type: ignore[call-arg]
        for name, forms in catalogue().items()
        for form in forms
        if name not in without
        and form.__name__ not in without
        and issubclass(form, AbstractForceEffect)
        and not issubclass(form, AbstractStateEffect)
        and not form.nuisances
        and _is_linear(form())  # type: ignore[call-arg]
    ]


def _is_linear(effect: AbstractEffect) -> bool:
    """Whether twice the strength is twice the force, at one place in the middle of everything."""
    friction = LuGre(100.0, 1.0, 0.1, 1.0, 1.5, 0.01)
    now = Now(jnp.asarray(0.3), jnp.asarray(0.2), jnp.asarray(0.7), jnp.asarray(0.4), jnp.zeros(0))
    force = [
        float(dataclasses.replace(effect, **dict.fromkeys(_names(effect), size)).force(friction, now))  # type: ignore[attr-defined]
        for size in (0.1, 0.2)
    ]
    return bool(np.isclose(force[1], 2.0 * force[0], rtol=1e-9, atol=0.0))


def _names(effect: AbstractEffect) -> list[str]:
    return [parameter.name for parameter in effect.strengths]


def force_of(
    effect: AbstractForceEffect, friction: LuGre, recording: Recording, motor_constant: float
) -> Float[np.ndarray, " n"]:
    """Force of an `effect` of the present motion along the smoothed `recording`, force units, shape `(n,)`; `friction`
    gives scales, `motor_constant` times u is the motor force."""
    return _along(effect, friction, smooth_motion(recording, motor_constant))


def _forces(form: AbstractForceEffect, friction: LuGre, motion: SlidingMotion) -> Float[np.ndarray, "n k"]:
    """The force of each strength alone, at one, along the `motion`."""

    alone = [dataclasses.replace(form, **{name: 1.0}) for name in _names(form)]
    return np.stack([_along(one, friction, motion) for one in alone], axis=1)


def _along(effect: AbstractForceEffect, friction: LuGre, motion: SlidingMotion) -> Float[np.ndarray, " n"]:
    """The force of an `effect` along the `motion`."""

    def at(x: Float[Numbers, ""], v: Float[Numbers, ""], push: Float[Numbers, ""]) -> Float[Numbers, ""]:
        return effect.force(friction, Now(x, v, push, jnp.zeros(()), jnp.zeros(0)))

    found = jax.vmap(at)(jnp.asarray(motion.x), jnp.asarray(motion.v), jnp.asarray(motion.force))
    return np.asarray(found)


def _with_friction(start: Drive, fit: SlidingFit, motions: tuple[SlidingMotion, ...]) -> Drive:
    """The `start` with inertia and friction of the balance; its bristles break away at the same deflection."""
    effort = max(float(np.sqrt(np.mean(m.force**2))) for m in motions)
    Fc = max(fit.Fc, _LEAST_FRICTION * effort)
    Fs, old = _BREAK_AWAY * Fc, start.friction
    stiffness = float(old.sigma0) * Fs / float(old.Fs)
    J = fit.J if fit.J > 0.0 else float(start.J)
    sigma2 = max(fit.sigma2, 0.01 * Fc / fit.top_speed)
    friction = LuGre(stiffness, np.sqrt(stiffness * J), sigma2, Fc, Fs, old.vs)
    return dataclasses.replace(start, J=J, friction=friction, effects=())
