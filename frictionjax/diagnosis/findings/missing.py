"""The missing effects that are reported: names, sizes, confidence, and what would distinguish them from others."""

from collections.abc import Sequence

from frictionjax.core import Estimate
from frictionjax.diagnosis.selection.candidate_table import effect_p_values
from frictionjax.diagnosis.selection.confidence import Evidence
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.verdict import MissingEffect, NextExperiment
from frictionjax.physics.effects import AbstractEffect


def missing_effects(
    steps: list[Step],
    weights: Sequence[Evidence],
    extended: dict[str, Estimate],
    where: str,
    experiments: dict[str, NextExperiment],
) -> tuple[MissingEffect, ...]:
    """What is reported of each effect that the `steps` accepted.

    **Arguments:**

    - `steps`: the rounds of the selection.
    - `weights`: the evidence for each accepted effect.
    - `extended`: parameters of the extended model.
    - `where`: where the base model's mismatch is, in words.
    - `experiments`: effect -> the experiment that distinguishes it from the closest of its class.
    """
    missing = []
    accepted = [step for step in steps if step.accepted is not None]
    for step, evidence in zip(accepted, weights, strict=True):
        found = step.accepted
        if found is None:
            continue
        posterior = found.model.posterior
        effect, prefix = posterior.drive.effects[-1], f"effects.{len(posterior.drive.effects) - 1}."
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
                where=where,
                split_by=_split_by(effect, members, experiments.get(found.effect)),
                next_experiment=experiments.get(found.effect),
                sentence=effect.about.sentence,
                evidence=tuple(float(number) for number in evidence),
            )
        )
    return tuple(missing)


def _split_by(effect: AbstractEffect, members: tuple[str, ...], designed: NextExperiment | None) -> str:
    if len(members) == 1:
        return ""
    return designed.sentence if designed is not None else effect.about.split_by
