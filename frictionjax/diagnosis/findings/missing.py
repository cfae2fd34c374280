"""The missing effects that are reported: names, sizes, confidence, and what would distinguish them from others."""

from collections.abc import Sequence

from frictionjax.core import Estimate
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.views import View, view
from frictionjax.diagnosis.mismatch_map.locate import MismatchGrid
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.candidate_table import effect_p_values
from frictionjax.diagnosis.selection.confidence import Evidence
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.verdict import MissingEffect, NextExperiment
from frictionjax.physics.effects import AbstractEffect


def missing_effects(
    steps: list[Step],
    weights: Sequence[Evidence],
    extended: dict[str, Estimate],
    where: Sequence[str],
    experiments: dict[str, NextExperiment],
) -> tuple[MissingEffect, ...]:
    """What is reported of each effect that the `steps` accepted.

    **Arguments:**

    - `steps`: the rounds of the selection.
    - `weights`: the evidence for each accepted effect.
    - `extended`: parameters of the extended model.
    - `where`: where each of them acts, in words.
    - `experiments`: effect -> the experiment that distinguishes it from the closest of its class.
    """
    missing = []
    accepted = [step for step in steps if step.accepted is not None]
    for step, evidence, place in zip(accepted, weights, where, strict=True):
        found = step.accepted
        if found is None:
            continue
        posterior = found.model.posterior
        # Not always the last one: where it kept its place beside what came later, the order is that of both.
        names = [effect.name for effect in posterior.drive.effects]
        place_in_drive = names.index(found.effect)
        effect, prefix = posterior.drive.effects[place_in_drive], f"effects.{place_in_drive}."
        parameters = {
            p.parameter.name: extended[p.label] for p in posterior.layout if p.path.startswith(prefix)
        }
        members = (found.effect, *step.rivals)
        missing.append(
            MissingEffect(
                effect=found.effect,
                effect_class=members,
                confidence=round(evidence.confidence, 3),
                p_value=effect_p_values(step.trials)[found.effect],
                parameters=parameters,
                where=place,
                split_by=_split_by(effect, members, experiments.get(found.effect)),
                next_experiment=experiments.get(found.effect),
                sentence=effect.about.sentence,
                evidence=tuple(float(number) for number in evidence),
            )
        )
    return tuple(missing)


def where_each_acts(
    steps: Sequence[Step], grid: MismatchGrid, known: Sequence[tuple[Model, View]], *, rule: Rule = Rule()
) -> list[str]:
    """In words, where the errors fell when each of the effects that the `steps` accepted was added to the model.

    **Arguments:**

    - `steps`: the rounds of the selection.
    - `grid`: the bins of the map.
    - `known`: models whose predictions are there already.
    - `rule`: which places are reported.
    """
    views = list(known)

    def view_of(model: Model) -> View:
        for other, found in views:
            if other is model:
                return found
        views.append((model, view(model.judgement, grid.scene)))
        return views[-1][1]

    return [
        grid.explained(view_of(step.before), view_of(step.accepted.model), rule=rule)
        for step in steps
        if step.accepted is not None
    ]


def _split_by(effect: AbstractEffect, members: tuple[str, ...], designed: NextExperiment | None) -> str:
    if len(members) == 1:
        return ""
    return designed.sentence if designed is not None else effect.about.split_by
