"""Exchange: what was named first is weighed once more, beside what was named after it, against what is taken for it."""

import dataclasses
from collections.abc import Callable

from frictionjax.diagnosis.evidence.judgement import explained
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import Answer
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.selection.decide import Step, settled, weigh
from frictionjax.diagnosis.selection.moves import ENOUGH_SHARE, reviewed, tentative, with_some
from frictionjax.physics.effects import catalogue

Again = Callable[[Model, frozenset[str]], tuple[list[Trial], list[Refitted]]]
"""Tests, and refits of the best of each form, of the named effects beside those of a model."""


def taken_for(effect: str) -> frozenset[str]:
    """Names of the effects that the catalogue says are taken for the `effect`, or it for them; itself included."""
    says = {
        name: {n for form in forms for n in form.about.confused_with} for name, forms in catalogue().items()
    }
    return frozenset({effect} | says[effect] | {name for name, others in says.items() if effect in others})


def exchanged(steps: list[Step], scales: dict[str, float], answer: Answer, again: Again) -> list[Step]:
    """The same `steps`, or steps in which an earlier effect made way for one that is easily taken for it.

    While it was alone it had to stand in for what was named later, so that a wrong one may have won. What comes in is
    told last, and so is what cannot be told from another beside the others.

    **Arguments:**

    - `steps`: with an accepted effect each.
    - `scales`: the plant's own sizes by name.
    - `answer`: of the base model to a force.
    - `again`: tests and refits.
    """
    base, last = steps[0].before, steps[-1].accepted
    assert last is not None
    for place, own in enumerate(steps[:-1]):
        assert own.accepted is not None
        others = [number for number in range(len(steps)) if number != place]
        rest = with_some(base, last.model, others, scales)
        inside = {type(effect).name for effect in rest.joint.drive.effects}
        trials, refits = again(rest, taken_for(own.accepted.effect) - inside)
        incumbent = Refitted(own.accepted.trial, last.model)
        # Their tests beside the others, and those that the incumbent has passed.
        passed = [trial for trial in own.trials if trial.effect == incumbent.effect]
        found = settled(weigh(rest, trials + passed, [incumbent, *refits], answer))
        if found.accepted is None:
            continue
        if found.accepted.effect != incumbent.effect or found.rivals:
            return [*_without(steps, place, rest, scales, answer, again), found]
        # Beside the others it can be told from all of them.
        steps = [*steps[:place], dataclasses.replace(own, rivals=()), *steps[place + 1 :]]
    return steps


def instead(
    steps: list[Step], refused: Step, scales: dict[str, float], answer: Answer, again: Again
) -> list[Step] | None:
    """Steps in which an effect took the place of one that is only easily taken for it, seen by what was `refused`.

    Beside a wrong name the second effect of two explains too little to be named, and nothing would weigh the first one
    again. So it is tried out: taken for accepted, exchanged, and kept where another name came in, all are needed, and
    together they explain nearly all of the misfit, on fit and on held-out recordings. None where that is not so.

    **Arguments:** as in `exchanged`; `refused`, the round after the `steps`, in which nothing was accepted.
    """
    begun = tentative(refused)
    if begun is None:
        return None
    changed = exchanged([*steps, begun], scales, answer, again)
    last = changed[-1].accepted
    if last is None or _names(changed) == _names([*steps, begun]):
        return None
    shares = explained(changed[0].before.judgement, last.model.judgement, changed[-1].floor)
    if min(shares) <= ENOUGH_SHARE or len(reviewed(changed, scales, answer)) < len(changed):
        return None
    return changed


def _names(steps: list[Step]) -> set[str]:
    return {step.accepted.effect for step in steps if step.accepted is not None}


def _without(
    steps: list[Step], place: int, rest: Model, scales: dict[str, float], answer: Answer, again: Again
) -> list[Step]:
    """The `steps` but the one at the `place`; the last of them leads to the model `rest`."""
    kept = [step for number, step in enumerate(steps) if number != place]
    model, chain = steps[0].before, []
    for number, own in enumerate(kept):
        assert own.accepted is not None
        ends = number == len(kept) - 1
        fewer = rest if ends else with_some(steps[0].before, rest, range(number + 1), scales)
        refitted = Refitted(own.accepted.trial, fewer)
        trials = steps[0].trials + [t for t in own.trials if t.effect == refitted.effect]
        beside = again(model, frozenset(own.rivals))[1] if own.rivals else []
        step = weigh(model, trials, [refitted, *beside], answer, chain[-1] if chain else None)
        # It was found beside the other and is needed there; alone it need not explain most.
        rivals = tuple(sorted({r.effect for r in beside}))
        chain.append(dataclasses.replace(step, accepted=refitted, rivals=rivals))
        model = fewer
    return chain
