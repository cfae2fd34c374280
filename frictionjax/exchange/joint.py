"""A drive as numbers for another program's joint: checked, with standard errors, and what does not fit in there."""

import math
from collections.abc import Collection
from xml.sax.saxutils import quoteattr

import equinox as eqx
import numpy as np

from frictionjax.core import InputError, Parameter
from frictionjax.estimation import FitResult
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect


class JointModel(eqx.Module):
    """A drive as the joint or the actuator of another program.

    **Attributes:**

    - `text`: what that program reads.
    - `values`: the numbers in it by their names there.
    - `lost`: sentences on what the drive has and that program's model cannot represent.
    - `stderr`: of a fit, name -> standard error of those `values` that stem from it; `inf` where the data do not
        determine it, 0 for what was not free in the fit. Empty for a drive.
    """

    text: str = eqx.field(static=True)
    values: dict[str, float] = eqx.field(static=True)
    lost: tuple[str, ...] = eqx.field(static=True)
    stderr: dict[str, float] = eqx.field(static=True)


def parts_of(drive: Drive | FitResult) -> tuple[FitResult | None, Drive]:
    """The result of a fit, if that is what `drive` is, and the drive itself."""
    return (drive, drive.drive) if isinstance(drive, FitResult) else (None, drive)


def numbers_of(drive: Drive, positive: Collection[str], target: str) -> dict[str, float]:
    """The base parameters of `drive` by name, checked: those in `positive` must be, for the program `target`.

    **Raises:** `ValueError` for arrays in place of numbers; `InputError` for a number that `target` cannot take.
    """
    numbers = {"J": drive.J, "motor_constant": drive.motor_constant}
    numbers |= {p.name: getattr(drive.friction, p.name) for p in drive.friction.parameters}
    arrays = [key for key, value in numbers.items() if np.ndim(value)]
    arrays += [e.name for e in drive.effects for p in _parameters(e) if np.ndim(getattr(e, p.name))]
    if arrays:
        raise ValueError(
            f"`drive` has arrays as parameters ({', '.join(arrays)}); {target} takes one drive at a time."
        )
    values = {key: float(value) for key, value in numbers.items()}
    for key, value in values.items():
        free = key == "motor_constant"
        if not math.isfinite(value) or (not free and value < 0.0) or (key in positive and value == 0.0):
            must = "be finite" if free else "be positive" if key in positive else "not be negative"
            raise InputError(
                f"`drive` has {key} = {value:g}; for {target} it must {must}", cure="Fit it again"
            )
    return values


def stderr_of_sum(result: FitResult, factors: dict[str, float]) -> float:
    """Standard error of the sum of parameters by label, each times its factor; what was not free is known."""
    found = result.stderr
    if any(math.isinf(found.get(label, 0.0)) for label in factors):
        return math.inf
    free = [label for label in factors if label in result.names]
    places = [result.names.index(label) for label in free]
    by = np.array([factors[label] for label in free])
    variance = float(by @ result.covariance[np.ix_(places, places)] @ by) if free else 0.0
    # The correlation of a tied parameter with the others is not in a file: this is the bound over all correlations.
    tied = sum(
        abs(factors[label]) * found[label] for label in factors if label in found and label not in free
    )
    return math.sqrt(max(variance, 0.0)) + tied


def lost_effects(drive: Drive, kept: tuple[type[AbstractEffect], ...] = ()) -> tuple[str, ...]:
    """Sentences on the effects of `drive` that act and are not of the `kept` kinds."""
    return tuple(_lost(effect) for effect in drive.effects if not isinstance(effect, kept) and _acts(effect))


def lost_presliding(values: dict[str, float], why: str) -> str:
    """The sentence on the bristle with these `values`, and `why` the program has none."""
    return f"Presliding is lost: the bristle (sigma0 = {values['sigma0']:.6g}, sigma1 = {values['sigma1']:.6g}) {why}"


def lost_stribeck(values: dict[str, float], level: str) -> str:
    """The sentence on the Stribeck effect with these `values`, where friction has one `level` at every speed."""
    return (
        f"The Stribeck effect is lost: friction is {level} = {values[level]:.6g} at every speed, without the rise to "
        f"Fs = {values['Fs']:.6g} below vs = {values['vs']:.6g}; stick-slip will not show."
    )


def lost_motor(values: dict[str, float]) -> tuple[str, ...]:
    """The sentence on the motor constant in `values`, where the program's input is a force; none where it is 1."""
    constant = values["motor_constant"]
    said = f"The motor is lost: the input there is a force, so multiply that of the drive by {constant:.6g}."
    return () if constant == 1.0 else (said,)


def element(tag: str, attributes: dict[str, str]) -> str:
    """The XML element called `tag` with these `attributes`."""
    return f"<{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>"


def exact(value: float) -> str:
    """The `value` as text that reads back to the last bit."""
    return repr(float(value))


def _parameters(effect: AbstractEffect) -> tuple[Parameter, ...]:
    return effect.strengths + effect.nuisances


def _acts(effect: AbstractEffect) -> bool:
    return any(float(getattr(effect, parameter.name)) != 0.0 for parameter in effect.strengths)


def _lost(effect: AbstractEffect) -> str:
    numbers = ", ".join(f"{p.name} = {float(getattr(effect, p.name)):.6g}" for p in _parameters(effect))
    return f"The effect {effect.name} is lost: {effect.about.sentence}, {effect.about.equation} ({numbers})."
