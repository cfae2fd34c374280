"""The user's own model as the base model: effects that are known to act, and parameters, fixed or as a start.

The recordings are then searched for what that model leaves out, not for what a plain LuGre drive does.
"""

import dataclasses
from typing import Any, NoReturn

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from frictionjax.core import InputError, Parameter
from frictionjax.estimation.parameters import INERTIA
from frictionjax.estimation.start.driven import StartingValues, starting_values
from frictionjax.estimation.start.force_balance import force_balance, force_of
from frictionjax.physics import Drive, LuGre, VelocityOffset
from frictionjax.physics.effects import AbstractEffect, AbstractForceEffect, AbstractStateEffect, catalogue
from frictionjax.recordings import Case, Given, GivenEffect, GivenModel, Recording
from frictionjax.recordings.words import listed, nearest, shown


class OwnModel(eqx.Module):
    """What the user knows of the base model.

    **Attributes:** `effects` (at their given values; strengths that are not given are zero), `open` (places of the
    effects of which no strength is given), `values` (of inertia and friction, by name), `fixed` (paths in the `Drive`
    of what a fit leaves as it is).
    """

    effects: tuple[AbstractEffect, ...] = ()
    open: frozenset[int] = eqx.field(static=True, default=frozenset())
    values: dict[str, float] = eqx.field(static=True, default_factory=dict)
    fixed: frozenset[str] = eqx.field(static=True, default=frozenset())

    @property
    def complete(self) -> bool:
        """Whether every parameter has a value, so that the model can be simulated as it is."""
        return not self.open and set(self.values) == {p.name for p in _parameters()}

    def applied(self, drive: Drive) -> Drive:
        """The `drive` with the given values and effects. Static friction that is not given keeps its ratio to Coulomb
        friction."""
        own, friction = dict(self.values), drive.friction
        J = own.pop("J", drive.J)
        if "Fc" in own and "Fs" not in own:
            own["Fs"] = own["Fc"] * float(friction.Fs / friction.Fc)
        elif "Fs" in own and "Fc" not in own:
            own["Fc"] = own["Fs"] * float(friction.Fc / friction.Fs)
        names = [parameter.name for parameter in friction.parameters]
        values: dict[str, Any] = {name: own.get(name, getattr(friction, name)) for name in names}
        return Drive(J, LuGre(**values), drive.motor_constant, self.effects, drive.hold)


def own_model(case: Case) -> OwnModel:
    """What the `case` says of its base model; known inertia is fixed. Where the position is an integrated velocity, the
    offset of that sensor is one of the effects.

    **Raises:** `InputError` for a name that is not in the catalogue, for a value out of its range, and for a case with
    positions and velocities alone.
    """
    inertia = case.plant.inertia
    known = {} if inertia is None else {"J": inertia}
    model = case.model or GivenModel()
    parameters = {parameter.name: parameter for parameter in _parameters()}
    for name, given in model.parameters.items():
        if name not in parameters:
            near = nearest(name, tuple(parameters))
            hint = f"Did you mean {near}? " if near else ""
            _fail(
                case,
                f"`{shown(name)}` is no parameter of the base model",
                f"{hint}Known: {listed(parameters)}",
            )
        _in_range(case, parameters[name], given)
    values = {name: given.value for name, given in model.parameters.items()}
    if inertia is not None and values.get("J", inertia) != inertia:
        _fail(
            case,
            f"J is {values['J']:g} in the model, and the plant has the inertia {inertia:g}",
            "Leave one of them out",
        )
    if "Fs" in values and "Fc" in values and not values["Fs"] > values["Fc"]:
        _fail(
            case,
            f"static friction Fs = {values['Fs']:g} is not above Coulomb friction Fc = {values['Fc']:g}",
            "Leave Fs out where it is unknown",
        )
    paths = {name: "J" if name == "J" else f"friction.{name}" for name in parameters}
    fixed = {paths[name] for name, given in model.parameters.items() if given.fixed}
    effects, still_open = [], set()
    for place, one in enumerate(model.effects):
        effect = _effect(case, one)
        effects.append(effect)
        fixed |= {f"effects.{place}.{name}" for name, given in one.values.items() if given.fixed}
        if not any(parameter.name in one.values for parameter in effect.strengths):
            still_open.add(place)
    if _is_integrated(case):
        effects.append(VelocityOffset())
    return OwnModel(
        tuple(effects), frozenset(still_open), values | known, frozenset(fixed | (known.keys() & {"J"}))
    )


def _is_integrated(case: Case) -> bool:
    """Whether the positions of the `case` are integrated velocities.

    **Raises:** `InputError` where only some of them are: one sensor has an offset, the other has none.
    """
    found = [one.name for one in case.recordings if one.integrated]
    if found and len(found) < len(case.recordings):
        raise InputError(
            f"{listed(found)} gives a velocity alone, and other recordings have a position",
            file=case.name,
            cure="Diagnose the two kinds apart, or give the position of all of them",
        )
    return bool(found)


def starting_values_beside(own: OwnModel, case: Case) -> tuple[StartingValues, OwnModel]:
    """Starting values of the fitted recordings of a force-driven `case` beside the effects of its `own` model, whose
    force is taken off the motor force; and that model, with strengths that were not given as a force balance says."""
    constant = case.plant.motor_constant or 1.0
    inertia = own.values["J"] if "J" in own.fixed else None
    recordings = case.fit_recordings
    start = starting_values(recordings, motor_constant=constant, inertia=inertia)
    if not own.effects:
        return dataclasses.replace(start, drives=tuple(own.applied(drive) for drive in start.drives)), own
    known = {type(own.effects[place]) for place in own.open}
    balanced = force_balance(recordings, start.drives, inertia=inertia, turn=case.plant.turn)
    found: dict[type[AbstractEffect], AbstractEffect] = {type(one.effect): one.effect for one in balanced}
    effects = tuple(
        found.get(type(effect), effect) if type(effect) in known else effect for effect in own.effects
    )
    own = dataclasses.replace(own, effects=effects)
    friction = start.drives[0].friction
    without = tuple(_without_force(one, effects, friction, constant) for one in recordings)
    start = starting_values(without, motor_constant=constant, inertia=inertia)
    return dataclasses.replace(start, drives=tuple(own.applied(drive) for drive in start.drives)), own


def _without_force(
    recording: Recording, effects: tuple[AbstractEffect, ...], friction: LuGre, motor_constant: float
) -> Recording:
    """The `recording` with the force of the `effects`, as far as it follows from the present motion, taken off."""
    u = np.array(recording.u)
    for effect in effects:
        if isinstance(effect, AbstractForceEffect) and not isinstance(effect, AbstractStateEffect):
            u -= force_of(effect, friction, recording, motor_constant) / motor_constant
    return dataclasses.replace(recording, u=u)


def _parameters() -> tuple[Parameter, ...]:
    return (INERTIA, *LuGre(1.0, 1.0, 1.0, 1.0, 1.5, 1.0).parameters)


def _effect(case: Case, given: GivenEffect) -> AbstractEffect:
    """The effect of the catalogue that the case speaks of."""
    known = catalogue()
    if given.name not in known:
        near = nearest(given.name, tuple(known))
        hint = f"Did you mean {near}? " if near else ""
        _fail(
            case,
            f'"{shown(given.name)}" is no effect of the catalogue',
            f"{hint}`frictionjax.catalogue()` lists them",
        )
    forms = {form.__name__: form for form in known[given.name]}
    name = given.form or next(iter(forms))
    if name not in forms:
        _fail(case, f'"{shown(name)}" is no form of {given.name}', f"Its forms: {listed(forms)}")
    form = forms[name]
    parameters = {parameter.name: parameter for parameter in (*form.strengths, *form.nuisances)}
    for key, value in given.values.items():
        if key not in parameters:
            _fail(case, f"`{shown(key)}` is no parameter of {given.name}", f"It has: {listed(parameters)}")
        _in_range(case, parameters[key], value)
    # A period is searched in the recordings for effects under test; one that is known to act has a known one.
    needed = [one.name for one in form.nuisances if one.grid == "period" and one.name not in given.values]
    if needed:
        _fail(
            case,
            f"{given.name} needs a value of {listed(needed)}",
            f'Write effects = [{{name = "{given.name}", {needed[0]} = ...}}]',
        )
    values: dict[str, Any] = {key: jnp.asarray(value.value) for key, value in given.values.items()}
    return form(**values).in_turns_of(case.plant.turn)


def _in_range(case: Case, parameter: Parameter, given: Given) -> None:
    low, high = parameter.lower, parameter.upper
    if parameter.transform == "log":
        # A logarithm has no zero.
        low, inside = max(low, 0.0), max(low, 0.0) < given.value < high
    else:
        inside = low <= given.value <= high
    if not inside:
        _fail(
            case,
            f"{parameter.name} = {given.value:g} is out of its range ({low:g} to {high:g})",
            "Check its unit and sign",
        )


def _fail(case: Case, problem: str, cure: str) -> NoReturn:
    model = case.model or GivenModel()
    raise InputError(problem, file=model.source or case.name, place="[model]", cure=cure)
