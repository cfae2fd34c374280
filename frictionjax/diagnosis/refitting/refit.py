"""Refit: the short list of candidates, converged with all parameters free, and judged."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import search_bandwidth
from frictionjax.diagnosis.refitting.backlash_search import load_ratio
from frictionjax.diagnosis.refitting.descents import (
    CandidateDescent,
    RefitStart,
    along_the_minimum,
    at_the_resonance,
    behind_a_gap,
    first_descent,
    from_before,
    from_the_balance,
    further,
    with_a_peak,
    with_slow_observer,
)
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.refitting.shortlist import backlash_candidates
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.resonance import Pair
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.start.force_balance import Balanced


@dataclasses.dataclass(frozen=True)
class Hints:
    """What the recordings and the screening show besides the short list: where a refit may start.

    **Attributes:**

    - `pair`: antiresonance and resonance in the data, where they show any.
    - `absorbed`: trials of what the base parameters can stand in for (`absorbed_by_base`).
    - `gaps`: trials of a load behind a gap, one a form: it is searched where nothing explains most and stick lacks a
      part of the inertia, or where it is on the short list.
    - `stick_inertia`: the inertia that noise in stick shows, where a recording has some.
    - `base_effects`: how many effects the base model has.
    - `balanced`: gives the trials of forces that the force balance asks for, each with what it says (`force_balance`);
      called only where refits are stuck.
    - `before`: trials whose candidates were refitted before, with observers of other gains, and what was found.
    """

    pair: Pair | None = None
    absorbed: Sequence[Trial] = ()
    gaps: Sequence[Trial] = ()
    stick_inertia: float | None = None
    base_effects: int = 0
    balanced: Callable[[], Sequence[tuple[Trial, Balanced]]] = tuple
    before: Sequence[tuple[Trial, Model]] = ()


def refit_all(
    trials: list[Trial],
    model: Model,
    scales: dict[str, float],
    executor: Executor,
    hints: Hints = Hints(),
    best: Model | None = None,
    *,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> list[Refitted]:
    """Refit `trials`, each an effect beside those of `model`, from their one-step estimates: all with the fast
    observer, and those that come near the best of them with the slow one.

    A base model with something missing may have come to rest far from the truth, and a candidate that starts there may
    look refuted. Where the best leaves much of the misfit of the base model, the absorbed ones are fitted from a plain
    size and the base parameters that undo most of it; and, where that is far from the noise, all from where its fit
    started, with as much of the effect as its test promised, or as the resonance shows, and those that the force
    balance asks for, from it. What was refitted before starts from there, too.

    **Arguments:**

    - `trials`: the short list.
    - `model`: the model without them.
    - `scales`: the plant's sizes.
    - `executor`: runs them side by side.
    - `hints`: where refits may start.
    - `best`: a candidate that was refitted before: those that fall behind it are given up, too.
    - `rule`: what is unpredictable beside a gap.
    - `effort`: when candidates are given up.
    """
    if not trials:
        return []
    budget, start = effort.refitting, _start(model, scales, hints, best, rule, effort)
    candidates = _best_of_each_form(_longest_first(executor, start, trials))
    candidates = _foremost(candidates, start, budget.lagging)
    candidates = list(executor.map(lambda one: further(start, one), candidates))
    candidates += executor.map(lambda pair: from_before(start, *pair), hints.before)
    candidates = _from_other_starts(candidates, trials, start, hints, executor)
    finalists = _near_the_best(candidates, start)
    return list(executor.map(lambda one: with_slow_observer(start, one), finalists))


def refit_balanced(
    model: Model,
    scales: dict[str, float],
    executor: Executor,
    hints: Hints,
    *,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> list[Refitted]:
    """Refits of the forces alone that the force balance asks for, from it, and from where they were refitted before;
    arguments as in `refit_all`."""
    start = _start(model, scales, hints, None, rule, effort)
    candidates = list(executor.map(lambda pair: from_the_balance(start, *pair), hints.balanced()))
    candidates += executor.map(lambda pair: from_before(start, *pair), hints.before)
    candidates = _best_of_each_form(candidates)
    return list(executor.map(lambda one: with_slow_observer(start, one), candidates))


def _start(
    model: Model, scales: dict[str, float], hints: Hints, best: Model | None, rule: Rule, effort: Effort
) -> RefitStart:
    bandwidth = search_bandwidth(model.posterior, model.fitted.vector)
    whole = model.posterior.at_bandwidth(bandwidth)
    fast, misfit = _searched(whole, model.fitted.vector, effort)
    return RefitStart(
        model=model,
        fast=fast,
        whole=whole,
        misfit=misfit,
        best=math.inf if best is None else _misfit_of_search(best, fast, bandwidth),
        scales=scales,
        # Under an imposed motion nothing helps a wrong model along its way: each minimum of the base model has a wall.
        graduate=model.posterior.batch.imposed,
        ratio=load_ratio(model.posterior, model.fitted.vector, hints.stick_inertia, effort=effort),
        pair=hints.pair,
        base_effects=hints.base_effects,
        rule=rule,
        effort=effort,
    )


def _searched(whole: Posterior, vector: Float[Numbers, " q"], effort: Effort) -> tuple[Posterior, float]:
    """What first descents are of, and its misfit at the `vector`: the first part of the recordings of the `whole`
    objective where they are long, and where it shows what the model misses."""
    misfit, budget = float(whole.misfits([vector])[0]), effort.refitting
    if whole.batch.imposed or int(np.max(whole.batch.lengths)) <= budget.searched_samples:
        return whole, misfit
    part = whole.first(budget.searched_samples)
    there = float(part.misfits([vector])[0])
    return (part, there) if there > budget.searched_part * misfit else (whole, misfit)


def _misfit_of_search(model: Model, searched: Posterior, bandwidth: float) -> float:
    """The misfit of the `model` with the observers of a search of this `bandwidth`, on the recordings that are
    `searched`."""
    own = model.posterior.at_bandwidth(bandwidth).on_recordings_of(searched)
    return float(own.misfits([model.fitted.vector])[0])


def _from_other_starts(
    candidates: list[CandidateDescent],
    trials: list[Trial],
    start: RefitStart,
    hints: Hints,
    executor: Executor,
) -> list[CandidateDescent]:
    """The `candidates`, where none reaches the noise fitted again with a Stribeck peak; where all leave much of the
    misfit also those that the base parameters can undo; and where it is far from the noise from where the base fit
    started, and, where that does not help either, a load behind a gap."""
    if start.above_the_noise(candidates):
        candidates = _foremost(candidates, start, start.effort.refitting.near)
        candidates = list(executor.map(lambda one: with_a_peak(start, one), candidates))
    # A model that has effects already has left the minimum that the base model came to rest in.
    first, absorbed = not start.has_found, list[CandidateDescent]()
    if first and start.leaves_much(candidates):
        absorbed = list(executor.map(lambda trial: along_the_minimum(start, trial), hints.absorbed))
    if first and start.stuck([*candidates, *absorbed]):
        candidates = list(executor.map(lambda one: at_the_resonance(start, one), candidates))
        candidates += executor.map(lambda pair: from_the_balance(start, *pair), hints.balanced())
    candidates = candidates + absorbed
    if start.stuck(candidates):
        gaps = backlash_candidates(trials)
        if start.ratio is not None:
            gaps += [t for t in hints.gaps if t.effect not in {other.effect for other in gaps}]
        found = executor.map(lambda trial: behind_a_gap(start, trial), gaps)
        candidates = candidates + [one for one in found if one is not None]
    return candidates


def _near_the_best(candidates: list[CandidateDescent], start: RefitStart) -> list[CandidateDescent]:
    """Those of the `candidates` that go on to the last descent: near the best gain, the best of each form."""
    budget = start.effort.refitting
    gains = np.array([start.misfit - one.fitted.misfit for one in candidates])
    most = start.misfit - start.lowest(candidates)
    hopeless = start.has_found and most < budget.hopeless * start.misfit
    if hopeless or gains.max() <= budget.near * most:
        # One of them goes on, to be shown: none will be named.
        return [candidates[int(np.argmax(gains))]]
    chosen = [one for one, gain in zip(candidates, gains, strict=True) if gain > budget.near * most]
    return _best_of_each_form(chosen)


def _best_of_each_form(candidates: list[CandidateDescent]) -> list[CandidateDescent]:
    """The `candidates` without those of a form that started from another place, too, and ended better there."""
    best: dict[str, CandidateDescent] = {}
    for one in candidates:
        form = type(one.trial.form).__name__
        if form not in best or one.fitted.misfit < best[form].fitted.misfit:
            best[form] = one
    return list(best.values())


def _longest_first(executor: Executor, start: RefitStart, trials: list[Trial]) -> list[CandidateDescent]:
    """The first descent of each of the `trials`, in their order. Those with the most parameters start first: started
    last, the slowest of all would keep one core busy while the others wait."""
    order = sorted(range(len(trials)), key=lambda number: -len(trials[number].vector))
    done = executor.map(lambda trial: first_descent(start, trial), [trials[number] for number in order])
    return [made for _, made in sorted(zip(order, done, strict=True), key=lambda pair: pair[0])]


def _foremost(candidates: list[CandidateDescent], start: RefitStart, part: float) -> list[CandidateDescent]:
    """Those that gain more than `part` of what the best one gains on the misfit at the `start`, and the first few."""
    order = sorted(range(len(candidates)), key=lambda number: candidates[number].fitted.misfit)
    most = start.misfit - start.lowest(candidates)
    return [
        candidates[number]
        for place, number in enumerate(order)
        if place < start.effort.refitting.least_kept
        or start.misfit - candidates[number].fitted.misfit > part * most
    ]
