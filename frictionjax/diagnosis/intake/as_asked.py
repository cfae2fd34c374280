"""What the user accepts and rejects: effects that are known to act, and effects that do not."""

import dataclasses
import difflib
from collections.abc import Sequence

from frictionjax.core import InputError
from frictionjax.estimation.data.moving_mass import case_without_moving_mass
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Case, GivenEffect, GivenModel, Plant
from frictionjax.recordings.given import CaseData, case_of


def case_to_diagnose(data: CaseData, plant: Plant | None, known: Sequence[str]) -> Case:
    """The case that `data` stands for, as `case_of` has it with the `plant`; with friction alone in what is measured
    under imposed motions, and with the effects `known` to act in the base model, see `accepted`."""
    return accepted(case_without_moving_mass(case_of(data, plant=plant)), known)


def accepted(case: Case, known: Sequence[str]) -> Case:
    """The `case` whose base model contains the effects of these names beside those of the user's own model.

    **Raises:** `InputError` for a name that is not in the catalogue.
    """
    if not known:
        return case
    check_effects(known)
    model = case.model or GivenModel()
    there = {effect.name for effect in model.effects}
    more = tuple(GivenEffect(name) for name in dict.fromkeys(known) if name not in there)
    return dataclasses.replace(case, model=dataclasses.replace(model, effects=(*model.effects, *more)))


def left_out_as_asked(without: Sequence[str]) -> dict[str, str]:
    """Effect -> why it is not named, of the effects that the user rejects.

    **Raises:** `InputError` for a name that is not in the catalogue.
    """
    check_effects(without)
    return dict.fromkeys(without, "it is left out, as asked")


def check_effects(names: Sequence[str]) -> None:
    """Raise `InputError` for one of the `names` that is not in the catalogue, with the nearest that is."""
    for name in names:
        if name not in catalogue():
            near = difflib.get_close_matches(name, catalogue(), n=1)
            cure = f'Did you mean "{near[0]}"?' if near else "`frictionjax effects` lists those that are"
            raise InputError(f'"{name}" is no effect of the catalogue', cure=cure)
