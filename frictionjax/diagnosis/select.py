"""Select: forward selection of effects, each accepted only if fit and held-out recordings agree."""

from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Progress
from frictionjax.diagnosis.judge import Judgement, Scene, advantage, explained, judge
from frictionjax.diagnosis.name import Present, Trial, forms_to_try, try_effect
from frictionjax.diagnosis.refit import Refitted, polish, refit, rejudged, short_list
from frictionjax.diagnosis.wavelengths import wavelengths
from frictionjax.estimation.least_squares import jacobian_of
from frictionjax.estimation.observer_fit import descend
from frictionjax.estimation.problem import FAST_BANDWIDTH, SLOW_BANDWIDTH, Problem
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import catalogue

ADEQUATE_MISFIT = 0.01
"""Robust misfit per sample, above an even floor, below which nothing significant is missing (2 % of the power)."""
LEAST_GAIN = 0.002
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
_LEAD = 2.5  # standard errors by which a rival must trail before the recordings can tell it from the leader
_ROUNDS = 3


class Step(eqx.Module):
    """One round of the selection.

    **Attributes:** `trials` (every test), `refits` (the short list), `accepted` (or None), `rivals` (names that the
    recordings cannot tell from the accepted one), `before` (judgement of the model without it), `vector` (solution of
    the model without it; better than the one the round began with when a refit led to a better one).
    """

    trials: list[Trial]
    refits: list[Refitted]
    accepted: Refitted | None
    rivals: tuple[str, ...] = eqx.field(static=True)
    before: Judgement
    vector: Float[Array, " q"]


def present_model(problem: Problem, vector: Float[Array, " q"]) -> Present:
    """The fitted model, seen by the fast observer, ready for tests."""
    fast = problem.at_bandwidth(FAST_BANDWIDTH)
    e, jacobian = jacobian_of(fast.layout, vector, fast.setting)
    return Present(fast, vector, e, jacobian, fast.mismatch(vector))


def try_catalogue(present: Present, scales: dict[str, float], executor: Executor) -> list[Trial]:
    """Every form of every effect of the catalogue, except those in the model, at every point of its grid."""
    batch = present.problem.setting.batch
    speed = np.gradient(np.asarray(batch.x), axis=1) / np.asarray(batch.dt)[:, None]
    e = np.nan_to_num(np.asarray(present.e))
    periods = {
        "odd_period": wavelengths(e, speed, batch, odd=True),
        "even_period": wavelengths(e, speed, batch, odd=False),
    }
    inside = {type(effect) for effect in present.problem.setting.drive.effects}
    instances = [
        instance
        for forms in catalogue().values()
        for instance in forms_to_try(tuple(f for f in forms if f not in inside), scales, periods)
    ]
    found = executor.map(lambda instance: try_effect(present, instance, scales), instances)
    return [trial for trials in found for trial in trials]


def effect_p_values(trials: list[Trial]) -> dict[str, float]:
    """Effect -> smallest p-value of its trials times their number (Bonferroni over forms and grid), at most 1."""
    grouped: dict[str, list[float]] = {}
    for trial in trials:
        grouped.setdefault(trial.effect, []).append(trial.p_value)
    return {name: min(1.0, min(values) * len(values)) for name, values in grouped.items()}


def acceptable(candidate: Refitted, before: Judgement, p_value: float) -> tuple[bool, str]:
    """Whether a refitted candidate may be named, and if not, why not.

    **Arguments:**

    - `candidate`: the refit.
    - `before`: the model without it.
    - `p_value`: of its score test.
    """
    if p_value > SIGNIFICANCE:
        return False, f"not significant (p = {p_value:.2g})"
    if min(candidate.share_fit, candidate.share_holdout) > LEAST_SHARE:
        return True, ""
    far = before.misfit_fit > FAR_FROM_NOISE and before.misfit_holdout > FAR_FROM_NOISE
    energy = min(candidate.energy_fit, candidate.energy_holdout)
    if far and energy > LEAST_ENERGY and min(candidate.share_fit, candidate.share_holdout) > 0.0:
        return True, ""
    shares = (
        f"{100 * candidate.share_fit:.0f} % on the fit, {100 * candidate.share_holdout:.0f} % on the held-out"
    )
    return False, f"explains too little ({shares} recordings)"


def select(
    problem: Problem,
    vector: Float[Array, " q"],
    scene: Scene,
    executor: Executor,
    progress: Progress,
) -> list[Step]:
    """Add effects to the fitted base model while fit and held-out recordings agree on them.

    **Arguments:**

    - `problem`, `vector`: the fitted base model.
    - `scene`: all recordings.
    - `executor`: runs tests and refits side by side.
    - `progress`: told as it goes.
    """
    before = judge(problem.drive(vector), scene)
    scales = plant_scales(problem.drive(vector), problem.setting.batch)
    steps: list[Step] = []
    for number in range(_ROUNDS):
        start, span = number / _ROUNDS, 1.0 / _ROUNDS
        progress(f"testing every effect, round {number + 1}", start)
        trials = try_catalogue(present_model(problem, vector), scales, executor)
        far = before.structure > 2.0 * ADEQUATE_MISFIT
        chosen = short_list(trials, most=4 if number == 0 else 3, least_gain=LEAST_GAIN, far=far)
        if before.structure < ADEQUATE_MISFIT:
            chosen = []
        progress(f"refitting {len(chosen)} candidates, round {number + 1}", start + 0.4 * span)
        refits = list(executor.map(lambda trial, now=before: refit(trial, now, scene), chosen))
        better = _better_base(problem, vector, refits)
        if better is not None:
            # What looked like an effect was partly the fit of the model without it: the shares are told anew.
            vector, before = better, judge(problem.drive(better), scene)
            refits = [rejudged(r, before, scene) for r in refits]
        p_values = effect_p_values(trials)
        ranked = sorted(refits, key=lambda r: -r.worth)
        accepted = next((r for r in ranked if acceptable(r, before, p_values[r.effect])[0]), None)
        rivals: tuple[str, ...] = ()
        if accepted is not None:
            progress(f"converging {accepted.effect}", start + 0.8 * span)
            accepted = polish(accepted, before, scene)
            rivals = _inseparable(accepted, refits, before, p_values)
        steps.append(Step(trials, refits, accepted, rivals, before, vector))
        if accepted is None:
            break
        problem, vector, before = accepted.problem, accepted.vector, accepted.judgement
        whole = explained(steps[0].before, before)
        if before.structure < 2.0 * ADEQUATE_MISFIT or min(whole) > ENOUGH_SHARE:
            break
    return steps


def _better_base(
    problem: Problem, vector: Float[Array, " q"], refits: list[Refitted]
) -> Float[Array, " q"] | None:
    """A better solution of the model without the candidates, found from their solutions; None when there is none.

    A model with something missing has several minima; a refit that left a bad one must not get the credit for it.
    """
    slow = problem.at_bandwidth(SLOW_BANDWIDTH)
    count, own = len(problem.layout), slow.mismatch(vector)
    candidates = [jnp.concatenate([r.vector[:count], r.vector[len(r.problem.layout) :]]) for r in refits]
    if not candidates:
        return None
    values = slow.misfits(*candidates)
    index = int(np.argmin(values))
    value = float(values[index])
    if not value < own - max(1e-3, 0.02 * own):
        return None
    return descend(slow, candidates[index], graduate=False)[0]


def _inseparable(
    accepted: Refitted, refits: list[Refitted], before: Judgement, p_values: dict[str, float]
) -> tuple[str, ...]:
    """Other effects that would also be named and that the leader does not beat by a few standard errors."""
    rows = np.ones(accepted.judgement.loss.shape[0], bool)
    names = {
        r.effect
        for r in refits
        if r.effect != accepted.effect
        and acceptable(r, before, p_values[r.effect])[0]
        and advantage(accepted.judgement, r.judgement, rows) < _LEAD
    }
    return tuple(sorted(names))
