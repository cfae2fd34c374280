"""Review: several effects are named only if each is needed beside the others."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp

from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import energy_explained, explained, judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import Answer
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.selection.decide import (
    FAR_FROM_NOISE,
    Step,
    acceptable,
    clear,
    dropping,
    effect_p_values,
    settled,
    weigh,
)
from frictionjax.estimation.descent.robust import Fitted, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import extend

ENOUGH_SHARE = 0.8
"""Share of the misfit, on fit and on held-out recordings, after which what is left is more likely the form of what was
found than another effect: another one is then named only if it explains as much of the rest. Two effects neither of
which may be named alone must reach it, too."""
# Of the sum of the explained shares: what leads by less is not worth a second effect beside it.
_PROMISING = 0.2


def with_some(base: Model, full: Model, places: Sequence[int], scales: dict[str, float]) -> Model:
    """The `base` model with some of the effects of `full`, converged with everything free.

    **Arguments:**

    - `base`: the model without effects.
    - `full`: the same with several.
    - `places`: which of them stay.
    - `scales`: the plant's own sizes by name.

    It begins once with the other parameters of `full` and once with those of `base`, and the better end is returned.
    """
    effects = full.joint.drive_of(full.fitted.vector).effects
    count, deflections = len(base.joint.layout), full.fitted.vector[len(full.joint.layout) :]
    # The same weights as in `full`: recordings may have been eased since, and what is chaotic left out.
    own = full.joint
    empty = eqx.tree_at(lambda j: (j.evidence, j.weights), base.joint, (own.evidence, own.weights))
    ends: list[tuple[Posterior, Fitted]] = []
    for vector in (jnp.concatenate([full.fitted.vector[:count], deflections]), base.fitted.vector):
        joint = empty
        for place in places:
            joint, vector = extend(joint, vector, effects[place], scales)
        ends.append((joint, descend(joint, vector, graduate=False)))
    joint, fitted = min(ends, key=lambda end: end[1].misfit)
    return Model(joint, fitted, judge(joint, fitted))


def superfluous(steps: list[Step], scales: dict[str, float]) -> tuple[int, Model] | None:
    """Which of the effects accepted in the `steps` is not needed beside the others, and the model without it; None
    where all are. The one accepted last was tested beside the others when it came."""
    last = steps[-1]
    assert last.accepted is not None
    full = last.accepted.model
    for place in range(len(steps) - 1):
        others = [number for number in range(len(steps)) if number != place]
        rest = with_some(steps[0].before, full, others, scales)
        compared = compare(rest.judgement, full.judgement, last.floor)
        # Each of them was found significant when it came.
        if not acceptable(compared, rest.judgement, last.floor, 0.0)[0]:
            return place, rest
    return None


def reviewed(steps: list[Step], scales: dict[str, float], answer: Answer) -> list[Step]:
    """The same `steps`, or, where an effect is not needed beside the others, steps without it: the first of those that
    stay is weighed again among the candidates of the first round."""
    found = superfluous(steps, scales)
    if found is None:
        return steps
    place, rest = found
    model, chain = steps[0].before, []
    kept = [step for number, step in enumerate(steps) if number != place]
    for number, own in enumerate(kept):
        assert own.accepted is not None
        last = number == len(kept) - 1
        again = Refitted(
            own.accepted.trial,
            rest if last else with_some(steps[0].before, rest, range(number + 1), scales),
        )
        if number == 0:
            # Its period may have shown only beside the effect that goes: with its own trials then, too.
            trials = steps[0].trials + [
                t for t in own.trials if t.effect == again.effect and own is not steps[0]
            ]
            beside = [r for r in steps[0].refits if r.form != again.form]
        else:
            trials, beside = own.trials, []  # the others were refitted beside the one that goes
        step = settled(weigh(model, trials, [again, *beside], answer, chain[-1] if chain else None))
        chain.append(step)
        if step.accepted is None or step.accepted.form != again.form:
            break
        model = step.accepted.model
    return chain


def tentative(step: Step) -> Step | None:
    """The first round with its best candidate that is clear taken for accepted although it explains too little alone:
    of two effects of one size neither may explain half. None where no candidate is clear, or promises anything."""
    if step.accepted is not None:
        return None
    p_values = effect_p_values(step.trials)
    for refit, compared in zip(step.refits, step.compared, strict=True):
        gains = min(compared.share_fit, compared.share_holdout) > 0.0 and compared.worth > _PROMISING
        if gains and clear(compared, step.before.judgement, step.floor, p_values[refit.effect]):
            return settled(dataclasses.replace(step, accepted=refit))
    return None


def only_what_ends_it(step: Step) -> Step:
    """The same round, with nothing accepted unless it explains nearly all of what was left, on fit and on held-out
    recordings."""
    if step.accepted is None:
        return step
    compared = step.compared[step.refits.index(step.accepted)]
    if min(compared.share_fit, compared.share_holdout) > ENOUGH_SHARE:
        return step
    return dropping(step, "what was named before explains nearly all; this explains too little of the rest")


def nearly_all(steps: list[Step]) -> bool:
    """Whether what was accepted in the `steps` explains nearly all: of the misfit or, far from the noise, of the power,
    on fit and on held-out recordings."""
    last = steps[-1]
    assert last.accepted is not None
    ends = steps[0].before.judgement, last.accepted.model.judgement, last.floor
    far = min(ends[0].misfits(last.floor)) > FAR_FROM_NOISE
    return min(explained(*ends)) > ENOUGH_SHARE or (far and min(energy_explained(*ends)) > ENOUGH_SHARE)
