"""Select: forward selection of effects, each accepted only if fit and held-out recordings agree."""

import dataclasses
from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from frictionjax.core import Progress
from frictionjax.diagnosis.exchange import exchanged, instead
from frictionjax.diagnosis.floor import answer_to_force
from frictionjax.diagnosis.judge import ADEQUATE_MISFIT, explained, judge
from frictionjax.diagnosis.name import Trial, forms_to_try, lots, promises_of, simulated, worth_simulating
from frictionjax.diagnosis.present import Present, present_model
from frictionjax.diagnosis.refit import (
    Model,
    Refitted,
    behind_gaps,
    compare,
    ease,
    hidden_in_the_base,
    is_chaotic,
    one_of_each,
    polish,
    refit_all,
    short_list,
)
from frictionjax.diagnosis.rejection import most_left
from frictionjax.diagnosis.resonance import Pair, resonance_pair
from frictionjax.diagnosis.review import ENOUGH_SHARE, nearly_all, only_what_ends_it, reviewed, tentative
from frictionjax.diagnosis.wavelengths import Wavelengths, wavelengths
from frictionjax.diagnosis.weigh import FAR_FROM_NOISE, Step, dropping, settled, weigh
from frictionjax.estimation.batch import Batch
from frictionjax.estimation.imposed_batch import ImposedBatch
from frictionjax.estimation.joint import FAST_BANDWIDTH, SLOW_BANDWIDTH
from frictionjax.estimation.robust_fit import descend, level_out
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import AbstractEffect, AbstractLoadEffect, catalogue

LEAST_GAIN = 0.0005
"""Drop of the misfit, per sample, below which a candidate is not worth a refit."""
_ROUNDS = 3
_TO_A_TASK = (
    4  # forms that are tested one after the other: each fills half a program, and two of them go together
)
_LEVELLED = 0.2  # misfit above which a model may have given up a whole regime
_CLOSE = 0.3  # the same: nearer than this the last steps of two refits may decide between them
_WORTHLESS = 0.2  # the same: no last steps make a name of less


def try_catalogue(
    model: Model,
    scales: dict[str, float],
    executor: Executor,
    without: frozenset[str],
    pair: Pair | None = None,
) -> list[list[Trial]]:
    """Every form of every effect of the catalogue, except those in the model and those named in `without` (effects or
    forms), at every point of its grid; second inertias at the antiresonance of the `pair`, too.

    **Returns:** the trials of the model as it is, and, where it is far from the noise, those of the model where it
    misses all regimes alike (`level_out`).
    """
    presents = _presents(model, executor)
    present, batch = presents[0], presents[0].joint.batch
    speed = np.gradient(np.asarray(batch.x), axis=1) / np.asarray(batch.dt)[:, None]
    e = np.nan_to_num(np.asarray(present.e))
    waves = {
        "odd_period": wavelengths(e, speed, batch, odd=True),
        "even_period": wavelengths(e, speed, batch, odd=False),
        "sensor_period": wavelengths(e, speed, batch, odd=False, count=2, fine=True),
    }
    inside = model.joint.setting.drive.effects
    forms = [form for name, all_forms in catalogue().items() if name not in without for form in all_forms]
    forms = [form for form in forms if form.__name__ not in without]
    if any(isinstance(effect, AbstractLoadEffect) for effect in inside):
        forms = [form for form in forms if not issubclass(form, AbstractLoadEffect)]
    # Another form of an effect that is named already is a matter of its form, not another effect.
    forms = [form for form in forms if form.name not in {effect.name for effect in inside}]

    def instances(form: type[AbstractEffect]) -> list[AbstractEffect]:
        grid = forms_to_try(form, scales, {kind: found.periods for kind, found in waves.items()})
        if pair is not None and issubclass(form, AbstractLoadEffect):
            grid.append(dataclasses.replace(grid[0], frequency=pair.frequency))
        return grid

    # All of them are queued before one is waited for: no core idles between the models.
    grids = lots([instances(form) for form in forms], _TO_A_TASK)
    promising = [
        executor.map(lambda some, seen=seen: promises_of(seen, some, scales), grids) for seen in presents
    ]
    simulating = []
    for seen, promises in zip(presents, promising, strict=True):
        promised = [one for some in promises for one in some]
        least = worth_simulating(promised)
        simulating.append(
            executor.map(
                lambda some, seen=seen, least=least: simulated(seen, some, least), lots(promised, _TO_A_TASK)
            )
        )
    return [
        [_as_chosen(trial, waves) for some in trials for own in some for trial in own]
        for trials in simulating
    ]


def _as_chosen(trial: Trial, waves: dict[str, Wavelengths]) -> Trial:
    """The `trial` of one of the strongest periods, tested as one of all those that it was chosen from."""
    chosen = [waves[str(nuisance.scale)] for nuisance in trial.form.nuisances if nuisance.grid == "period"]
    times = max((found.among / max(len(found.periods), 1) for found in chosen), default=1.0)
    return dataclasses.replace(trial, p_value=min(1.0, trial.p_value * times)) if times > 1.0 else trial


def _worth_refitting(
    model: Model, tried: list[list[Trial]], barred: frozenset[str], most: int
) -> list[Trial]:
    """The short lists of the trials, `most` forms in each. Under an imposed motion, far from the noise, every form: the
    base model has come to rest in a corner, and no step from there says what would gain after many."""
    misfits = model.judgement.misfits(np.ones((1, 1)))
    far = max(misfits) > 2.0 * ADEQUATE_MISFIT
    cornered = isinstance(model.joint.batch, ImposedBatch) and min(misfits) > FAR_FROM_NOISE
    chosen = []
    for some in tried:
        open_to = [trial for trial in some if trial.effect not in barred]
        if cornered:
            chosen += [trial for trial in one_of_each(open_to) if np.isfinite(trial.gain)]
        else:
            chosen += short_list(open_to, most=most, least_gain=LEAST_GAIN, far=far)
    return chosen


def _presents(model: Model, executor: Executor) -> list[Present]:
    """The model as it is; and, where it is far from the noise, also where it misses all regimes alike."""
    fast, vector = model.joint.at_bandwidth(FAST_BANDWIDTH), model.fitted.vector
    present = executor.submit(present_model, fast, vector)
    if not isinstance(fast.batch, Batch) or fast.misfits([vector])[0] < _LEVELLED:
        return [present.result()]
    level = level_out(fast, vector)
    return [present.result(), present_model(fast, level)]


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
    if isinstance(joint.batch, Batch):
        pair = resonance_pair(joint.batch, np.flatnonzero(np.asarray(joint.fitted) > 0))

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
    joint = eqx.tree_at(lambda joint: joint.fitted, model.joint, jnp.ones_like(model.joint.fitted))
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
