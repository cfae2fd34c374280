"""What parameters mean, and waves by amplitude and phase."""

import math
from collections.abc import Mapping

from frictionjax.core import Estimate, Parameter
from frictionjax.diagnosis.verdict import MissingEffect
from frictionjax.estimation.parameters import INERTIA
from frictionjax.physics import LuGre, VelocityOffset
from frictionjax.physics.effects import AbstractEffect, catalogue

_AMPLITUDE = "amplitude of the wave"
_PHASE = "phase of the wave: amplitude times the sine of (2π position/period + phase)"


def meaning_of(label: str) -> str:
    """What a parameter means, in words; empty for one that is not known.

    **Arguments:**

    - `label`: `"Fc"`, or `"ripple.period"` for that of an effect.
    """
    effect, _, name = label.rpartition(".")
    if not effect:
        own = (INERTIA, *LuGre.parameters, *VelocityOffset.strengths)
        known = {one.name: one.meaning for one in own}
        return known.get(name, "")
    effect = effect.split(".")[-1].rstrip("0123456789_")
    for form in catalogue().get(effect, ()):
        for parameter in _of(form):
            if parameter.name == name:
                return parameter.meaning
    if name.startswith("amplitude"):
        return _AMPLITUDE
    return _PHASE if name.startswith("phase") else ""


def form_of(found: MissingEffect) -> type[AbstractEffect] | None:
    """The form of a named effect that has the parameters found; None for one that is not in the catalogue."""
    forms = catalogue().get(found.effect, ())
    return next((form for form in forms if found.parameters.keys() <= {one.name for one in _of(form)}), None)


def with_amplitudes(parameters: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The `parameters` by name, with amplitude and phase in the place of the sine and cosine part of each wave.

    The standard errors are those of parts that are estimated independently of each other.
    """
    found: dict[str, Estimate] = {}
    for label, estimate in parameters.items():
        head, dot, name = label.rpartition(".")
        number = name.removeprefix("sine") if name.startswith("sine") else None
        if number is not None and f"{head}{dot}cosine{number}" in parameters:
            amplitude, phase = _polar(estimate, parameters[f"{head}{dot}cosine{number}"])
            found[f"{head}{dot}amplitude{number}"] = amplitude
            found[f"{head}{dot}phase{number}"] = phase
        elif not (name.startswith("cosine") and f"{head}{dot}{name.removeprefix('co')}" in parameters):
            found[label] = estimate
    return found


def _polar(sine: Estimate, cosine: Estimate) -> tuple[Estimate, Estimate]:
    size = math.hypot(sine.value, cosine.value)
    identified = sine.identified and cosine.identified and size > 0.0
    along = math.hypot(sine.value * sine.stderr, cosine.value * cosine.stderr) / size if size else math.inf
    across = math.hypot(cosine.value * sine.stderr, sine.value * cosine.stderr) / size if size else math.inf
    angle = math.degrees(math.atan2(cosine.value, sine.value))
    turn = math.degrees(across / size) if size else math.inf
    return Estimate(size, along, sine.unit, identified), Estimate(angle, turn, "deg", identified)


def _of(form: type[AbstractEffect]) -> tuple[Parameter, ...]:
    return (*form.strengths, *form.nuisances)
