"""Select: forward selection of effects, each accepted only if fit and held-out recordings agree."""

from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from frictionjax.core import Progress
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import ADEQUATE_MISFIT, explained, judge
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.refitting.refit import refit_all
from frictionjax.diagnosis.refitting.refitted import Refitted, ease, polish
from frictionjax.diagnosis.refitting.shortlist import behind_gaps, hidden_in_the_base, one_of_each, short_list
from frictionjax.diagnosis.screening.resonance import resonance_pair
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.screening.try_catalogue import try_catalogue
from frictionjax.diagnosis.selection.decide import FAR_FROM_NOISE, Step, dropping, settled, weigh
from frictionjax.diagnosis.selection.moves import (
    ENOUGH_SHARE,
    nearly_all,
    only_what_ends_it,
    reviewed,
    tentative,
)
from frictionjax.diagnosis.selection.swap import exchanged, instead
from frictionjax.diagnosis.selection.verdict_rule import most_left
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import catalogue

LEAST_GAIN = 0.0005
"""Drop of the misfit, per sample, below which a candidate is not worth a refit."""

_ROUNDS = 3

_CLOSE = 0.3  # the same: nearer than this the last steps of two refits may decide between them

_WORTHLESS = 0.2  # the same: no last steps make a name of less


def _worth_refitting(
    model: Model, tried: list[list[Trial]], barred: frozenset[str], most: int
) -> list[Trial]:
    """The short lists of the trials, `most` forms in each. Under an imposed motion, far from the noise, every form: the
    base model has come to rest in a corner, and no step from there says what would gain after many."""
    misfits = model.judgement.misfits(np.ones((1, 1)))
    far = max(misfits) > 2.0 * ADEQUATE_MISFIT
    cornered = model.joint.batch.imposed and min(misfits) > FAR_FROM_NOISE
    chosen = []
    for some in tried:
        open_to = [trial for trial in some if trial.effect not in barred]
        if cornered:
            chosen += [trial for trial in one_of_each(open_to) if np.isfinite(trial.gain)]
        else:
            chosen += short_list(open_to, most=most, least_gain=LEAST_GAIN, far=far)
    return chosen


def select(
    model: Model,
    executor: Executor,
    progress: Progress,
    *,
    without: frozenset[str] = frozenset(),
    barred: frozenset[str] = frozenset(),
    stick_inertia: float | None = None,
) -> list[Step]:
    """Add effects to the fitted base model while fit and held-out recordings agree on them.

    **Arguments:**

    - `model`: the fitted base model.
    - `executor`: runs tests and refits side by side.
    - `progress`: told as it goes.
    - `without`: names of effects, or of forms, to leave out of the catalogue.
    - `barred`: names of effects that are tested, for their smallest detectable size, but not refitted.
    - `stick_inertia`: the inertia that noise in stick shows, where a recording has some.
    """
    model = ease(model)
    scales = plant_scales(model.judgement.drive, model.joint.batch)
    answering = executor.submit(answer_to_force, model.joint, model.fitted.vector)
    joint = model.joint
    pair = None
    if not joint.batch.imposed:
        pair = resonance_pair(joint.batch, np.flatnonzero(np.asarray(joint.fitted[0]) > 0))

    def one_round(model: Model, number: int, before: Step | None = None) -> Step:
        start, span = number / _ROUNDS, 1.0 / _ROUNDS
        progress(f"testing every effect, round {number + 1}", start)
        tried = try_catalogue(model, scales, executor, without, pair)
        trials = [trial for some in tried for trial in some]
        chosen = _worth_refitting(model, tried, barred, 5 if number == 0 else 3)
        progress(f"refitting {len(chosen)} candidates, round {number + 1}", start + 0.4 * span)
        open_to = [trial for trial in tried[0] if trial.effect not in barred]
        masked, hanging = hidden_in_the_base(open_to), behind_gaps(open_to)
        refits = refit_all(chosen, model, scales, executor, pair, masked, hanging, stick_inertia)
        model = _better_base(model, refits)
        least = model.joint.batch.eased[:, None]
        worth = {id(r): compare(model.judgement, r.model.judgement, least).worth for r in refits}
        refits.sort(key=lambda r: -worth[id(r)])
        close = [r for r in refits[:2] if worth[id(r)] > max(_WORTHLESS, worth[id(refits[0])] - _CLOSE)]
        refits[: len(close)] = executor.map(polish, close)
        return settled(weigh(model, trials, refits, answering.result(), before))

    def again(model: Model, names: frozenset[str]) -> tuple[list[Trial], list[Refitted]]:
        tried = try_catalogue(model, scales, executor, without | (frozenset(catalogue()) - names), pair)
        trials = [trial for some in tried for trial in some]
        chosen = _worth_refitting(model, tried, barred, 3)
        return trials, refit_all(chosen, model, scales, executor, pair)

    first = one_round(model, 0)
    answer = answering.result()
    own = first.before.judgement.within(first.floor, ADEQUATE_MISFIT)
    if own == (True, False) and together(first.before, first.floor):
        why = "the base model with the parameters of all recordings together is at the noise without it"
        return [dropping(first, why, together=True)]
    steps = [first]
    if first.accepted is None:
        begun = None if _at_the_noise(first.before, first) else tentative(first)
        if begun is None or begun.accepted is None:
            return steps
        second = one_round(begun.accepted.model, 1, begun)
        if second.accepted is None:
            return steps
        # Two that need each other; or the second was what is missing all along.
        both = reviewed([begun, second], scales, answer)
        if both[-1].accepted is None or (len(both) > 1 and not nearly_all(both)):
            return steps
        steps = exchanged(both, scales, answer, again)
    for number in range(len(steps), _ROUNDS):
        last = steps[-1].accepted
        assert last is not None
        whole = explained(steps[0].before.judgement, last.model.judgement, steps[-1].floor)
        if _at_the_noise(last.model, steps[-1]) or _leaves_chaos(last.model, whole):
            break
        found = one_round(last.model, number, steps[-1])
        if min(whole) > ENOUGH_SHARE:
            found = only_what_ends_it(found)
        if found.accepted is None:
            changed = None if min(whole) > ENOUGH_SHARE else instead(steps, found, scales, answer, again)
            if changed is None:
                return [*steps, found]
            steps = changed
            continue
        steps.append(found)
        fewer = reviewed(steps, scales, answer)
        if len(fewer) < len(steps):
            return fewer
        steps = exchanged(steps, scales, answer, again)
    return steps


def _leaves_chaos(model: Model, whole: tuple[float, float]) -> bool:
    """Whether contacts are what is missing in the `model`'s machine, having explained these shares of the `whole`: what
    they leave is chaos, and no effect beside them explains most of that."""
    return is_chaotic(model) and 1.0 - min(whole) < most_left(model.judgement.drive.effects)


def together(model: Model, floor: np.ndarray) -> bool:
    """Whether the `model` is at the noise everywhere once it is fitted to all recordings, those kept aside included.

    Fitted recordings that leave a parameter open make a true model predict others badly.
    """
    joint = eqx.tree_at(lambda j: j.fitted, model.joint, (jnp.ones_like(model.joint.fitted[0]),))
    fitted = descend(joint, model.fitted.vector, graduate=False)
    judgement = eqx.tree_at(lambda j: j.held_out, judge(joint, fitted), model.judgement.held_out)
    return all(judgement.within(floor, ADEQUATE_MISFIT))


def _at_the_noise(model: Model, step: Step) -> bool:
    return all(model.judgement.within(step.floor, ADEQUATE_MISFIT))


def _better_base(model: Model, refits: list[Refitted]) -> Model:
    """A better solution of the model without the candidates, found from their solutions; the same when there is none.

    A model with something missing has several minima; a refit that left a bad one must not get the credit for it.
    """
    slow = model.joint.at_bandwidth(SLOW_BANDWIDTH)
    count, own = len(slow.layout), model.fitted.misfit
    candidates = [
        jnp.asarray(np.delete(np.asarray(r.model.fitted.vector), slice(count, len(r.model.joint.layout))))
        for r in refits
    ]
    if not candidates:
        return model
    values = slow.misfits(candidates)
    index = int(np.argmin(values))
    if not values[index] < own - max(1e-3, 0.02 * own):
        return model
    fitted = descend(slow, candidates[index], graduate=False)
    return Model(slow, fitted, judge(slow, fitted))
