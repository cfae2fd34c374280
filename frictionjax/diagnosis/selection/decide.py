"""Weigh: what the refitted candidates may be named for, seen above the floor that the best of them leaves."""

import dataclasses

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evidence.comparison import Compared, compare
from frictionjax.diagnosis.evidence.judgement import (
    ADEQUATE_MISFIT,
    Judgement,
    advantage,
    explained,
    left_over,
)
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import (
    Answer,
    colour,
    floor_of,
    force_noise,
    quietness,
    scatter,
)
from frictionjax.diagnosis.refitting.backlash_search import SHAKING
from frictionjax.diagnosis.refitting.refitted import Refitted, ease
from frictionjax.diagnosis.screening.score_test import Trial

LEAST_SHARE = 0.45
"""Share of the misfit that an effect must explain, on fit and on held-out recordings, to be accepted."""
LEAST_ENERGY = 0.8
"""Where nothing reaches the noise floor: share of the excess power, on fit and on held-out recordings. Where
something else is missing, half of it is easily explained."""
FAR_FROM_NOISE = 0.8
"""Misfit above which the likelihood's logarithm hides a share of the power: errors of 8.9 times the power of the floor,
three times its rms."""
SIGNIFICANCE = 1e-3
# Short recordings have few clusters, and the score test little power in them. Standard errors by which a refit must
# lead on the recordings that it never saw, and on these and the fitted ones in sum, to count as significant all the
# same.
_LEADS = 2.0, 6.0
# Share of the misfit, on fit and on held-out recordings, that is significant by itself where the held-out ones, which
# no fit has seen, are not at the noise without the candidate.
_MOST_OF_IT = 0.6
_LEAD = 2.5  # standard errors by which a rival must trail before the recordings can tell it from the leader
_BEHIND = 0.5  # of the sum of the explained shares by which a candidate that is named may trail the best
_HALVINGS = 30  # of what is excused
_ALIKE = 0.03  # of the sum of the explained shares


class Step(eqx.Module):
    """One round of the selection.

    **Attributes:** `before` (model without the candidates; better than the one the round began with when a refit led to
    a better one), `trials` (every test), `refits` (the short list, best first), `compared` (each of them against
    `before`), `floor` (power of each block), `force` (unmeasured force over Coulomb friction), `accepted` (or None),
    `rivals` (names that the recordings cannot tell from the accepted one), `together` (whether the model without them
    is at the noise everywhere once it is fitted to all recordings), `dropped` (why an effect that might have been
    accepted was not, after all; "" where none was).
    """

    before: Model
    trials: list[Trial]
    refits: list[Refitted]
    compared: list[Compared]
    floor: np.ndarray
    force: float
    accepted: Refitted | None
    rivals: tuple[str, ...] = eqx.field(static=True)
    together: bool = eqx.field(static=True, default=False)
    dropped: str = eqx.field(static=True, default="")


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
        brings the held-out recordings, which it never saw, to the noise or most of the way there: what acts in a few
        seconds of many has few clusters to be tested in.

    What is periodic along the stroke must be seen to repeat in it. What the fitted recordings do not ask for is not
    named, though held-out ones be predicted better with it: that is where their own deflections came to rest.
    """
    if not found.repeats:
        return False, "its period is too long to be seen to repeat along the stroke"
    if found.lead_fit < 0.0:
        return False, "the recordings that it is fitted to are explained no better with it"
    if not clear(found, before, floor, p_value):
        return False, f"not significant (p = {p_value:.2g})"
    if min(found.share_fit, found.share_holdout) > LEAST_SHARE:
        return True, ""
    far = min(before.misfits(floor)) > FAR_FROM_NOISE
    energy = min(found.energy_fit, found.energy_holdout)
    if far and energy > LEAST_ENERGY and min(found.share_fit, found.share_holdout) > 0.0:
        return True, ""
    shares = f"{100 * found.share_fit:.0f} % on the fit, {100 * found.share_holdout:.0f} % on the held-out"
    return False, f"explains too little ({shares} recordings)"


def clear(found: Compared, before: Judgement, floor: np.ndarray, p_value: float) -> bool:
    """Whether chance does not do what the candidate does; arguments as in `acceptable`."""
    leads = found.lead_holdout > _LEADS[0] and found.lead_fit + found.lead_holdout > _LEADS[1]
    return p_value <= SIGNIFICANCE or leads or _mends(found, before, floor)


def _mends(found: Compared, before: Judgement, floor: np.ndarray) -> bool:
    """Whether the candidate is adequate on fit and held-out recordings, or explains most of the misfit there, and the
    model without it was not adequate on the held-out ones, which no fit has seen: by more than chance adds there."""
    news = left_over(before.misfits(floor), (found.share_fit, found.share_holdout))
    most = min(found.share_fit, found.share_holdout) > _MOST_OF_IT
    return not before.within(floor, ADEQUATE_MISFIT)[1] and (max(news) < ADEQUATE_MISFIT or most)


def weigh(
    model: Model,
    trials: list[Trial],
    refits: list[Refitted],
    answer: Answer,
    before: Step | None = None,
) -> Step:
    """Which of the `refits` may be added to the `model`, seen above the floor that the best of them leaves.

    **Arguments:**

    - `model`: what is there; `trials` of what may be added, and `refits` of the best of those.
    - `answer`: of the base model to a force.
    - `before`: the step that led to the `model`, for the floor of what is chaotic.
    """
    powers = [model.judgement.power, *(r.model.judgement.power for r in refits)]
    quiet = np.min([quietness(power, answer, model.joint) for power in powers], axis=0)
    force = min(force_noise(power, answer, model.joint, quiet) for power in powers)
    # What raises all of a recording alike, by little, whatever the model, is no physics.
    floor = floor_of(force, answer, quiet)
    floor = floor * np.min([colour(power, floor, model.joint) for power in powers], axis=0)
    # Errors that do not count in the fits do not count here either.
    floor = np.maximum(floor, model.joint.batch.eased[:, None])
    ranked = _ranked(model, refits, floor)[1]
    raised = floor
    if is_chaotic(model) and before is not None:
        raised = np.maximum(floor, before.floor)
    elif not is_chaotic(model) and ranked and is_chaotic(ranked[0].model):
        found = ranked[0].model
        # One that explains too little of what can be told must not excuse itself.
        if min(_explained_where_told(model, found, floor)) > LEAST_SHARE:
            # Nobody is told where in its gap the load begins: that parts two runs where no force does.
            own = scatter(found.joint, found.fitted.vector, max(force, SHAKING))
            raised = _excused(model.judgement, floor, quiet + own)
    floor, compared, ranked = _above(model, refits, floor, raised)
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


def _above(
    model: Model, refits: list[Refitted], floor: np.ndarray, raised: np.ndarray
) -> tuple[np.ndarray, dict[int, Compared], list[Refitted]]:
    """The `raised` floor, and the `refits` as they compare above it, best first; the `floor` instead, where what a gap
    excuses would let in another that it does not belong to."""
    compared, ranked = _ranked(model, refits, floor)
    if raised is floor:
        return floor, compared, ranked
    excused = _ranked(model, refits, raised)
    if is_chaotic(model) or excused[1][0] is ranked[0]:
        return raised, *excused
    return floor, compared, ranked


def _ranked(
    model: Model, refits: list[Refitted], floor: np.ndarray
) -> tuple[dict[int, Compared], list[Refitted]]:
    """The `refits` against the `model` above the `floor`, by their identity, and the best of them first."""
    compared = {id(r): compare(model.judgement, r.model.judgement, floor) for r in refits}
    return compared, sorted(refits, key=lambda r: -compared[id(r)].worth)


def _explained_where_told(before: Model, found: Model, floor: np.ndarray) -> tuple[float, float]:
    """Share of the misfit of `before` that `found` removes, fit and held-out, in the blocks that its fit saw."""
    kept = np.asarray(found.joint.weights[0]).reshape(floor.shape) > 0.0
    ends = [
        eqx.tree_at(lambda j: j.power, model.judgement, np.where(kept, model.judgement.power, floor))
        for model in (before, found)
    ]
    return explained(ends[0], ends[1], floor)


def _excused(before: Judgement, floor: np.ndarray, left: np.ndarray) -> np.ndarray:
    """The `floor`, raised towards what a chaotic machine leaves even before its true model, `left`: in blocks in which
    the model `before` it errs more than that, and by no more than half of what that model misses."""
    whole, left = np.array(before.misfits(floor)), np.minimum(left, before.power)
    for _ in range(_HALVINGS):
        raised = np.maximum(floor, left)
        if np.all(np.array(before.misfits(raised)) >= 0.5 * whole):
            return raised
        left = 0.5 * left
    return floor


def dropping(step: Step, why: str, *, together: bool = False) -> Step:
    """The same step with nothing accepted, and `why`."""
    return dataclasses.replace(step, accepted=None, rivals=(), together=together, dropped=why)


def settled(step: Step) -> Step:
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
