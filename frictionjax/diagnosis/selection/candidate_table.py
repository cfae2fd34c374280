"""A table of candidates: refitted models compared with the one without them, above the floor that the best leaves."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.optimize import root_scalar

from frictionjax.diagnosis.base_model.credibility import made_credible
from frictionjax.diagnosis.evidence.comparison import between, compare, forms_of
from frictionjax.diagnosis.evidence.judgement import Judgement, explained
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import (
    Answer,
    colour,
    floor_of,
    force_noise,
    gap_force,
    quietness,
    scatter,
)
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.table import ComparisonTable

_HALVINGS = 30  # of what is excused
_LOWEST = -50.0  # logarithm of a factor on a floor, below any in use: powers are in units of the noise


class Ground(NamedTuple):
    """The floor of a table.

    **Attributes:** `floor` (power of each block that a perfect model would leave), `force` (unmeasured force over
    Coulomb friction), `excused` (whether it was to be raised for a candidate with a gap).
    """

    floor: np.ndarray
    force: float
    excused: bool


def effect_p_values(trials: list[Trial]) -> dict[str, float]:
    """Effect -> smallest p-value of its `trials` times their number (Bonferroni over forms and grid), at most 1."""
    grouped: dict[str, list[float]] = {}
    for trial in trials:
        grouped.setdefault(trial.effect, []).append(trial.p_value)
    return {name: min(1.0, min(values) * len(values)) for name, values in grouped.items()}


def table_of_candidates(
    key: str,
    asked: tuple[str, ...],
    model: Model,
    trials: list[Trial],
    refits: list[Refitted],
    ground: Ground,
    *,
    rule: Rule = Rule(),
) -> ComparisonTable:
    """The `refits` compared with the `model`, in their order.

    **Arguments:**

    - `key`, `asked`: of the table.
    - `model`: what is there; `trials` of what may be added, and `refits` of the best of those.
    - `ground`: the floor.
    - `rule`: for what enters the comparisons.
    """
    p_values, judgement = effect_p_values(trials), model.judgement
    credible = made_credible(model, [refit.model for refit in refits], rule)
    rows = tuple(
        compare(
            judgement,
            refit.model.judgement,
            ground.floor,
            added=refit.trial.form,
            p_value=p_values[refit.effect],
            makes_credible=makes,
            rule=rule,
        )
        for refit, makes in zip(refits, credible, strict=True)
    )
    return ComparisonTable(
        key=key,
        asked=asked,
        before=forms_of(judgement),
        misfits=judgement.misfits(ground.floor),
        misfit_errors=judgement.misfit_errors(),
        chaotic=is_chaotic(model),
        rows=rows,
        between=between([refit.model.judgement for refit in refits], ground.floor),
        force=ground.force,
        excused=ground.excused,
        imposed=model.posterior.batch.imposed,
    )


def ground_of(
    model: Model,
    refits: list[Refitted],
    answer: Answer,
    before: np.ndarray | None = None,
    *,
    rule: Rule = Rule(),
) -> Ground:
    """The floor above which the `refits` and the `model` are compared: what the best of them leaves.

    **Arguments:**

    - `model`, `refits`: as in `table_of_candidates`.
    - `answer`: of the likeliest of them to noise and a force.
    - `before`: floor of the round that led to the `model`, which a model with a gap keeps.
    - `rule`: the numbers of `Rule.floor`.
    """
    powers = [model.judgement.power, *(r.model.judgement.power for r in refits)]
    quiet = np.min([quietness(power, answer, model.posterior) for power in powers], axis=0)
    force = min(force_noise(power, answer, model.posterior, quiet, rule=rule) for power in powers)
    # What raises all of a recording alike, by little, whatever the model, is no physics.
    floor = floor_of(force, answer, quiet)
    floor = floor * np.min([colour(power, floor, model.posterior, rule=rule) for power in powers], axis=0)
    if model.posterior.batch.imposed:
        # Errors that do not count in the fits do not count here either.
        floor = np.maximum(floor, model.posterior.batch.eased[:, None])
    else:
        floor = not_above_what_is_left(floor, [model.judgement, *(r.model.judgement for r in refits)])
    if is_chaotic(model):
        return Ground(floor if before is None else np.maximum(floor, before), force, False)
    best = _best(model, refits, floor, rule)
    if best is None or not is_chaotic(best.model):
        return Ground(floor, force, False)
    found = best.model
    # One that explains too little of what is predictable must not excuse itself.
    if not may_excuse(explained_where_predictable(model, found, floor, rule=rule), rule):
        return Ground(floor, force, False)
    # Where in its gap the load begins is not known: that parts two runs where no force does.
    own = scatter(found.posterior, found.fitted.vector, gap_force(force, rule))
    raised = excused_floor(model.judgement, floor, quiet + own, rule=rule)
    # What a gap excuses must not let in another candidate, to which it does not belong.
    keeps = raised is not floor and keeps_the_best(model, refits, floor, raised, rule=rule)
    return Ground(raised if keeps else floor, force, raised is not floor)


def not_above_what_is_left(floor: np.ndarray, models: list[Judgement]) -> np.ndarray:
    """The `floor` of each block, lowered in the fitted and in the held-out recordings by a factor of their own until
    the likeliest of the `models` on all recordings is not below it.

    Noise whose level was estimated too high, and the scatter of blocks of few samples (the logarithm of their power is
    below that of its mean), leave even an imperfect model less than the floor. A better one would then explain nothing
    more, however much likelier it is.
    """
    likeliest = min(models, key=lambda one: float(one.clusters(floor).sum()))
    factors = [
        1.0 if misfit >= 0.0 else float(np.exp(_root(likeliest, floor, which)))
        for which, misfit in enumerate(likeliest.misfits(floor))
    ]
    return floor * np.where(likeliest.held_out, factors[1], factors[0])[:, None]


def _root(model: Judgement, floor: np.ndarray, which: int) -> float:
    """Logarithm of the factor on the `floor` above which the `model` misses nothing, in fit (0) or held-out (1)."""

    def misfit(log: float) -> float:
        return model.misfits(np.exp(log) * floor)[which]

    # Without any noise, of a simulation, there is no root.
    return root_scalar(misfit, bracket=(_LOWEST, 0.0)).root if misfit(_LOWEST) > 0.0 else _LOWEST


def may_excuse(shares: tuple[float, float], rule: Rule) -> bool:
    """Whether a candidate with a gap explains enough, these `shares` of the predictable blocks, for its chaos to be
    excused by the `rule`."""
    return min(shares) > rule.floor.excuse_share


def keeps_the_best(
    model: Model, refits: list[Refitted], floor: np.ndarray, raised: np.ndarray, *, rule: Rule = Rule()
) -> bool:
    """Whether the same one of the `refits` explains most of what the `model` misses above the `raised` floor as above
    the `floor`; the `rule` ranks them."""
    return _best(model, refits, raised, rule) is _best(model, refits, floor, rule)


def _best(model: Model, refits: list[Refitted], floor: np.ndarray, rule: Rule) -> Refitted | None:
    """That of the `refits` which explains most above the `floor`."""

    def worth(refit: Refitted) -> float:
        fit, held = explained(model.judgement, refit.model.judgement, floor, rule=rule)
        return fit + held

    return min(refits, key=lambda refit: -worth(refit), default=None)


def explained_where_predictable(
    before: Model, found: Model, floor: np.ndarray, *, rule: Rule = Rule()
) -> tuple[float, float]:
    """Share of the misfit of `before` that `found` removes, fit and held-out, in the blocks that its fit used.

    **Arguments:** `before` and `found`, two models; the `floor`; the `rule`.
    """
    kept = np.asarray(found.posterior.weights[0]).reshape(found.judgement.power.shape) > 0.0
    ends = [
        eqx.tree_at(lambda j: j.power, model.judgement, np.where(kept, model.judgement.power, floor))
        for model in (before, found)
    ]
    return explained(ends[0], ends[1], floor, rule=rule)


def excused_floor(
    before: Judgement, floor: np.ndarray, left: np.ndarray, *, rule: Rule = Rule()
) -> np.ndarray:
    """The `floor`, raised towards what a chaotic machine leaves even before its true model, `left`: in blocks in which
    the model `before` it errs more than that, and by no more than the `rule` excuses of what that model misses."""
    whole, left = np.array(before.misfits(floor)), np.minimum(left, before.power)
    for _ in range(_HALVINGS):
        raised = np.maximum(floor, left)
        if np.all(np.array(before.misfits(raised)) >= rule.floor.excused_part * whole):
            return raised
        left = 0.5 * left
    return floor
