"""Select: forward selection of effects, each accepted only if fit and held-out recordings agree."""

import dataclasses
from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from frictionjax.core import Progress
from frictionjax.diagnosis.floor import Answer, answer_to_force, floor_of, force_noise, quietness
from frictionjax.diagnosis.judge import ADEQUATE_MISFIT, Judgement, advantage, explained, judge, left_over
from frictionjax.diagnosis.name import Trial, forms_to_try, try_form
from frictionjax.diagnosis.present import Present, present_model
from frictionjax.diagnosis.refit import (
    Compared,
    Model,
    Refitted,
    compare,
    ease,
    polish,
    refit_all,
    short_list,
)
from frictionjax.diagnosis.resonance import Pair, resonance_pair
from frictionjax.diagnosis.wavelengths import wavelengths
from frictionjax.estimation.batch import Batch
from frictionjax.estimation.joint import FAST_BANDWIDTH, SLOW_BANDWIDTH
from frictionjax.estimation.robust_fit import descend, level_out
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import AbstractEffect, AbstractLoadEffect, catalogue

LEAST_GAIN = 0.0005
"""Drop of the misfit, per sample, below which a candidate is not worth a refit."""
LEAST_SHARE = 0.45
"""Share of the misfit that an effect must explain, on fit and on held-out recordings, to be named."""
LEAST_ENERGY = 0.3
"""Where nothing reaches the noise floor: share of the excess power, on fit and on held-out recordings."""
FAR_FROM_NOISE = 0.8
"""Misfit above which the likelihood's logarithm hides a share of the power: more than five times the noise."""
ENOUGH_SHARE = 0.8
"""Share of the misfit, on fit and on held-out recordings, after which no further effect is sought: what is left is then
more likely the form of the effect found than another one."""
SIGNIFICANCE = 1e-3
# Short recordings have few clusters, and the score test little power in them. Standard errors by which a refit must
# lead on the fitted recordings and on those that it never saw, to count as significant all the same.
_LEADS = 4.0, 2.0
_LEAD = 2.5  # standard errors by which a rival must trail before the recordings can tell it from the leader
_ROUNDS = 3
_LEVELLED = 0.2  # misfit above which a model may have given up a whole regime
_BEHIND = 0.5  # of the sum of the explained shares by which a candidate that is named may trail the best
_ALIKE = 0.03  # of the sum of the explained shares
_CLOSE = 0.3  # the same: nearer than this the last steps of two refits may decide between them
_WORTHLESS = 0.2  # the same: no last steps make a name of less


class Step(eqx.Module):
    """One round of the selection.

    **Attributes:** `before` (model without the candidates; better than the one the round began with when a refit led to
    a better one), `trials` (every test), `refits` (the short list, best first), `compared` (each of them against
    `before`), `floor` (power of each block), `force` (unmeasured force over Coulomb friction), `accepted` (or None),
    `rivals` (names that the recordings cannot tell from the accepted one).
    """

    before: Model
    trials: list[Trial]
    refits: list[Refitted]
    compared: list[Compared]
    floor: np.ndarray
    force: float
    accepted: Refitted | None
    rivals: tuple[str, ...] = eqx.field(static=True)


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
    presents = _presents(model)
    present, batch = presents[0], presents[0].joint.batch
    speed = np.gradient(np.asarray(batch.x), axis=1) / np.asarray(batch.dt)[:, None]
    e = np.nan_to_num(np.asarray(present.e))
    periods = {
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
        grid = forms_to_try(form, scales, periods)
        if pair is not None and issubclass(form, AbstractLoadEffect):
            grid.append(dataclasses.replace(grid[0], frequency=pair.frequency))
        return grid

    found = []
    for seen in presents:
        trials = executor.map(lambda form, seen=seen: try_form(seen, instances(form), scales), forms)
        found.append([trial for some in trials for trial in some])
    return found


def _presents(model: Model) -> list[Present]:
    """The model as it is; and, where it is far from the noise, also where it misses all regimes alike."""
    fast = model.joint.at_bandwidth(FAST_BANDWIDTH)
    present = present_model(fast, model.fitted.vector)
    if present.misfit < _LEVELLED or not isinstance(fast.batch, Batch):
        return [present]
    return [present, present_model(fast, level_out(fast, model.fitted.vector))]


def effect_p_values(trials: list[Trial]) -> dict[str, float]:
    """Effect -> smallest p-value of its trials times their number (Bonferroni over forms and grid), at most 1."""
    grouped: dict[str, list[float]] = {}
    for trial in trials:
        grouped.setdefault(trial.effect, []).append(trial.p_value)
    return {name: min(1.0, min(values) * len(values)) for name, values in grouped.items()}


def acceptable(found: Compared, before: Judgement, floor: np.ndarray, p_value: float) -> tuple[bool, str]:
    """Whether a refitted candidate may be named, and if not, why not.

    **Arguments:**

    - `found`: the candidate against the model without it.
    - `before`: that model.
    - `floor`: power of each block that a perfect model would leave.
    - `p_value`: of its score test; where that is not significant, a clear lead of the refit is, and so is a refit that
        brings the held-out recordings, which it never saw, to the noise: what acts in a few seconds of many has few
        clusters to be tested in.
    """
    leads = found.lead_fit > _LEADS[0] and found.lead_holdout > _LEADS[1]
    if p_value > SIGNIFICANCE and not leads and not _mends(found, before.misfits(floor)):
        return False, f"not significant (p = {p_value:.2g})"
    if min(found.share_fit, found.share_holdout) > LEAST_SHARE:
        return True, ""
    far = min(before.misfits(floor)) > FAR_FROM_NOISE
    energy = min(found.energy_fit, found.energy_holdout)
    if far and energy > LEAST_ENERGY and min(found.share_fit, found.share_holdout) > 0.0:
        return True, ""
    shares = f"{100 * found.share_fit:.0f} % on the fit, {100 * found.share_holdout:.0f} % on the held-out"
    return False, f"explains too little ({shares} recordings)"


def _mends(found: Compared, olds: tuple[float, float]) -> bool:
    """Whether the candidate is adequate on fit and held-out recordings, and the model without it was not so on the
    held-out ones, which no fit has seen."""
    news = left_over(olds, (found.share_fit, found.share_holdout))
    return olds[1] > ADEQUATE_MISFIT and max(news) < ADEQUATE_MISFIT


def select(
    model: Model,
    executor: Executor,
    progress: Progress,
    *,
    without: frozenset[str] = frozenset(),
    barred: frozenset[str] = frozenset(),
) -> list[Step]:
    """Add effects to the fitted base model while fit and held-out recordings agree on them.

    **Arguments:**

    - `model`: the fitted base model.
    - `executor`: runs tests and refits side by side.
    - `progress`: told as it goes.
    - `without`: names of effects, or of forms, to leave out of the catalogue.
    - `barred`: names of effects that are tested, for their smallest detectable size, but not refitted.
    """
    model = ease(model)
    scales = plant_scales(model.judgement.drive, model.joint.batch)
    answer = answer_to_force(model.joint, model.fitted.vector)
    joint = model.joint
    pair = None
    if isinstance(joint.batch, Batch):
        pair = resonance_pair(joint.batch, np.flatnonzero(np.asarray(joint.fitted) > 0))
    steps: list[Step] = []
    for number in range(_ROUNDS):
        start, span = number / _ROUNDS, 1.0 / _ROUNDS
        progress(f"testing every effect, round {number + 1}", start)
        tried = try_catalogue(model, scales, executor, without, pair)
        trials = [trial for some in tried for trial in some]
        far = max(model.judgement.misfits(np.ones((1, 1)))) > 2.0 * ADEQUATE_MISFIT
        chosen, most = [], 5 if number == 0 else 3
        for some in tried:
            open_to = [trial for trial in some if trial.effect not in barred]
            chosen += short_list(open_to, most=most, least_gain=LEAST_GAIN, far=far)
        progress(f"refitting {len(chosen)} candidates, round {number + 1}", start + 0.4 * span)
        refits = refit_all(chosen, model, scales, executor, pair)
        model = _better_base(model, refits)
        least = model.joint.batch.eased[:, None]
        worth = {id(r): compare(model.judgement, r.model.judgement, least).worth for r in refits}
        refits.sort(key=lambda r: -worth[id(r)])
        close = [r for r in refits[:2] if worth[id(r)] > max(_WORTHLESS, worth[id(refits[0])] - _CLOSE)]
        refits[: len(close)] = executor.map(polish, close)
        step = _settled(weigh(model, trials, refits, answer))
        steps.append(step)
        if step.accepted is None:
            break
        model = step.accepted.model
        whole = explained(steps[0].before.judgement, model.judgement, step.floor)
        if max(model.judgement.misfits(step.floor)) < ADEQUATE_MISFIT or min(whole) > ENOUGH_SHARE:
            break
    return steps


def weigh(model: Model, trials: list[Trial], refits: list[Refitted], answer: Answer) -> Step:
    """Which of the `refits` may be added to the `model`, seen above the floor that the best of them leaves."""
    powers = [model.judgement.power, *(r.model.judgement.power for r in refits)]
    quiet = np.min([quietness(power, answer, model.joint) for power in powers], axis=0)
    force = min(force_noise(power, answer, model.joint, quiet) for power in powers)
    # Errors that do not count in the fits do not count here either.
    floor = np.maximum(floor_of(force, answer, quiet), model.joint.batch.eased[:, None])
    compared = {id(r): compare(model.judgement, r.model.judgement, floor) for r in refits}
    ranked = sorted(refits, key=lambda r: -compared[id(r)].worth)
    p_values = effect_p_values(trials)

    # What another candidate explains far better is not named, even if that one is refused.
    most = max((compared[id(r)].worth for r in ranked), default=0.0)

    def may(r: Refitted) -> bool:
        near = compared[id(r)].worth > most - _BEHIND
        return near and acceptable(compared[id(r)], model.judgement, floor, p_values[r.effect])[0]

    accepted = next((r for r in ranked if may(r)), None)
    if accepted is not None:
        # Of two that explain alike the one with fewer parameters is named: a sine holds a spring, not the reverse.
        least = compared[id(accepted)].worth - _ALIKE
        alike = [r for r in ranked if may(r) and compared[id(r)].worth > least]
        accepted = min(alike, key=_free)
    rivals: tuple[str, ...] = ()
    if accepted is not None:
        rows = np.ones(accepted.model.judgement.held_out.shape, bool)
        rivals = tuple(
            sorted(
                {
                    r.effect
                    for r in ranked
                    if r.effect != accepted.effect
                    and may(r)
                    and advantage(accepted.model.judgement, r.model.judgement, rows, floor) < _LEAD
                }
            )
        )
    return Step(model, trials, ranked, [compared[id(r)] for r in ranked], floor, force, accepted, rivals)


def _settled(step: Step) -> Step:
    """The same step, with the model that was accepted weighed against what it leaves itself."""
    if step.accepted is None:
        return step
    eased = ease(step.accepted.model)
    if eased is step.accepted.model:
        return step
    accepted = Refitted(step.accepted.trial, eased)
    refits = [accepted if r is step.accepted else r for r in step.refits]
    return eqx.tree_at(lambda s: (s.accepted, s.refits), step, (accepted, refits))


def _free(refitted: Refitted) -> int:
    return len(refitted.model.joint.layout)


def _better_base(model: Model, refits: list[Refitted]) -> Model:
    """A better solution of the model without the candidates, found from their solutions; the same when there is none.

    A model with something missing has several minima; a refit that left a bad one must not get the credit for it.
    """
    slow = model.joint.at_bandwidth(SLOW_BANDWIDTH)
    count, own = len(slow.layout), model.fitted.misfit
    candidates = [
        jnp.concatenate([r.model.fitted.vector[:count], r.model.fitted.vector[len(r.model.joint.layout) :]])
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
