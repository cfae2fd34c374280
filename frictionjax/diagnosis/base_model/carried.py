"""A machine whose motor force is carried by a force that the base model lacks: gravity, a spring.

The base model is then no model of the machine. Its fit rests wherever the missing force left it, and neither the pace
of the observers nor a test of effects beside it says anything. The textbook force balance says which force it is, and a
fit that starts from it says the rest.
"""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

import equinox as eqx

from frictionjax.core import Progress
from frictionjax.diagnosis.base_model.credibility import credibility
from frictionjax.diagnosis.base_model.fit_base import fit_base
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.intake.starting_point import StartingPoint
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.start.force_balance import Balanced
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractForceEffect


class Carried(eqx.Module):
    """What carries the motor force.

    **Attributes:** `base`, the base model, observed as the model with the force asks for; `forces`, those that the
    force balance asks for, the one that carries most first and with the drive that was fitted to it.
    """

    base: Model
    forces: tuple[Balanced, ...]


def carried(
    starting: StartingPoint,
    forces: tuple[Balanced, ...],
    executor: Executor,
    progress: Progress,
    *,
    rule: Rule = Rule(),
) -> Carried | None:
    """The base model of a machine that no base model predicts, as far as one of the `forces` makes it credible.

    **Arguments:**

    - `starting`: the recordings, and starting values.
    - `forces`: those that the force balance asks for, the one that leaves least first.
    - `executor`: runs fits side by side.
    - `progress`: called as it goes.
    - `rule`: when a fit is credible.

    **Returns:** None where no model with the first of the `forces` is credible either.
    """
    if not forces:
        return None
    first = forces[0]
    progress(f"fit with {first.effect.name}, as the force balance asks", 0.0)
    drives = [drive.with_effects(first.effect) for drive in first.drives]

    def fit(starts: Sequence[Drive], like: Model | None = None) -> Model:
        return fit_base(
            starts,
            starting.batch,
            starting.held_out,
            executor,
            progress,
            fixed=starting.own.fixed,
            like=like,
            rule=rule,
        )

    with_force = fit(drives)
    if not credibility(with_force, rule=rule).is_credible(rule=rule):
        return None
    drive = with_force.judgement.drive
    plain = dataclasses.replace(drive, effects=())
    base = fit([plain, *starting.start.drives], like=with_force)
    force = drive.effects[-1]
    assert isinstance(force, AbstractForceEffect)  # the first of the `forces`, at its fitted strengths
    fitted = dataclasses.replace(first, effect=force, drives=(plain,))
    return Carried(base, (fitted, *forces[1:]))
