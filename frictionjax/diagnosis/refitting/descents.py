"""Descents of one candidate: where it starts, and how it goes on."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, has_contacts
from frictionjax.diagnosis.evidence.step_length import steps_needed, with_steps
from frictionjax.diagnosis.refitting.backlash_search import heavier, search_backlash, without_chaos
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.resonance import Pair
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.estimation.descent.robust import Ending, RobustFit, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend
from frictionjax.estimation.parameters import changed, pack
from frictionjax.estimation.start.force_balance import Balanced
from frictionjax.physics.effects import AbstractLoadEffect

Vector = Float[Numbers, " q"]


@dataclasses.dataclass(frozen=True)
class RefitStart:
    """What all candidates of a round start from.

    **Attributes:** `model` (without them), `fast` (its objective with the observers of a search, of the first part
    of long recordings) and `whole` (of all of them), its `misfit` by the first, that of the `best` candidate that
    was refitted before (infinite where none was), `scales` (the plant's sizes), `graduate` (whether descents begin
    with a wide loss), `ratio` (part of the inertia that stick lacks, or None), `pair` (antiresonance and resonance,
    or None), `base_effects` (how many the base model has), `rule`, `effort`.
    """

    model: Model
    fast: Posterior
    whole: Posterior
    misfit: float
    best: float
    scales: dict[str, float]
    graduate: bool
    ratio: float | None
    pair: Pair | None
    base_effects: int
    rule: Rule
    effort: Effort

    @property
    def has_found(self) -> bool:
        """Whether the model has effects that the base model has not."""
        return len(self.model.posterior.drive.effects) > self.base_effects

    def lowest(self, candidates: Sequence["CandidateDescent"]) -> float:
        """The lowest misfit of the `candidates` and of the best one before them."""
        return min(self.best, *(one.fitted.misfit for one in candidates))

    def above_the_noise(self, candidates: Sequence["CandidateDescent"]) -> bool:
        """Whether the `candidates` and the best one before them leave anything."""
        return self.lowest(candidates) > self.rule.limits.adequate

    def leaves_much(self, candidates: Sequence["CandidateDescent"]) -> bool:
        """Whether the `candidates` and the best one before them leave much of the misfit, above the noise."""
        budget = self.effort.refitting
        return self.above_the_noise(candidates) and self.lowest(candidates) > budget.left * self.misfit

    def stuck(self, candidates: Sequence["CandidateDescent"]) -> bool:
        """Whether the `candidates` and the best one before them leave much of a misfit that is far from the noise."""
        return self.leaves_much(candidates) and self.misfit > self.effort.refitting.far

    def extended(self, trial: Trial) -> tuple[Posterior, Vector]:
        """Objective and vector of the model with the silent effect of the `trial`."""
        return extend(self.fast, self.model.fitted.vector, trial.form, self.scales)

    def own(self, posterior: Posterior) -> slice:
        """Places of the candidate's own parameters in a vector of its objective `posterior`."""
        return slice(len(self.model.posterior.layout), len(posterior.layout))


@dataclasses.dataclass(frozen=True)
class CandidateDescent:
    """A candidate under way: the `trial` that it comes from, its objective `posterior`, and where it is, `fitted`."""

    trial: Trial
    posterior: Posterior
    fitted: RobustFit


def first_descent(start: RefitStart, trial: Trial) -> CandidateDescent:
    """The first steps of the candidate of a `trial`: from its one-step estimate and, where these leave much, from the
    other starts of its effect."""
    posterior, alone = start.extended(trial)
    vector = _placed(posterior, alone, trial.vector)
    if start.graduate:
        return CandidateDescent(
            trial, posterior, _lowest(start, posterior, [vector, *_other_starts(start, posterior, vector)])
        )
    found = _first_steps(start, posterior, [vector])
    budget = start.effort.refitting
    if not found.misfit > max(budget.far, budget.settled * start.misfit):
        return CandidateDescent(trial, posterior, found)
    # Far from the noise one step for all parameters may lead astray: those of the model stay where they were.
    own, with_load = start.own(posterior), isinstance(trial.form, AbstractLoadEffect)
    others = _other_starts(start, posterior, alone)
    others = [uncoupled(posterior, one) if with_load else one for one in others]
    other = _first_steps(start, posterior, [changed(alone, own, np.asarray(trial.vector)[own]), *others])
    return CandidateDescent(trial, posterior, min(found, other, key=lambda fitted: fitted.misfit))


def further(start: RefitStart, candidate: CandidateDescent) -> CandidateDescent:
    """The `candidate` after the rest of the steps of its first descent."""
    found, budget = candidate.fitted, start.effort.refitting
    if start.graduate or found.ending in (Ending.AT_REST, Ending.NO_STEP):
        return candidate
    steps = budget.steps - budget.first_steps
    fitted = descend(
        candidate.posterior, found.vector, graduate=False, steps=steps, tolerance=budget.tolerance
    )
    return dataclasses.replace(candidate, fitted=fitted)


def at_the_resonance(start: RefitStart, candidate: CandidateDescent) -> CandidateDescent:
    """The `candidate`, or a better end of it from where the base fit started, with as much of the effect as its test
    promised, or as the resonance shows."""
    trial, posterior, own = candidate.trial, candidate.posterior, start.own(candidate.posterior)
    vector = changed(posterior.start, own, np.asarray(trial.vector)[own])
    if start.pair is not None and isinstance(trial.form, AbstractLoadEffect):
        shown = {"ratio": start.pair.ratio, "frequency": np.log(start.pair.frequency)}
        for place in range(own.start, own.stop):
            name = posterior.layout[place].parameter.name
            vector = changed(vector, place, shown[name]) if name in shown else vector
    return _or_better(
        candidate, _lowest(start, posterior, [vector, *_other_starts(start, posterior, vector)])
    )


def with_a_peak(start: RefitStart, candidate: CandidateDescent) -> CandidateDescent:
    """The `candidate`, or a better end of it with the Stribeck peak that the base fit started with, and all else as it
    is. A fit that misses something may lose the peak: where Fs is near Fc, no small step of Fs or vs says where it
    is."""
    posterior, vector = candidate.posterior, candidate.fitted.vector
    for place, free in enumerate(posterior.layout):
        if free.path in ("friction.Fs", "friction.vs"):
            vector = changed(vector, place, np.asarray(posterior.start)[place])
    return _or_better(candidate, _lowest(start, posterior, [vector]))


def along_the_minimum(start: RefitStart, trial: Trial) -> CandidateDescent:
    """The candidate of a `trial` that base parameters can undo, from a plain size and base parameters that undo it."""
    posterior, vector = start.extended(trial)
    budget = start.effort.refitting
    first = _placed(posterior, vector, trial.valley)
    return CandidateDescent(
        trial, posterior, descend(posterior, first, steps=budget.first_steps, tolerance=budget.tolerance)
    )


def from_the_balance(start: RefitStart, trial: Trial, balanced: Balanced) -> CandidateDescent:
    """The candidate of a `trial` from what the force balance says of it, friction and inertia included: their ranges
    are about that, too, as the base fit may be far off."""
    posterior, vector = start.extended(trial)
    count, budget = len(posterior.layout), start.effort.refitting
    ends = []
    for drive in balanced.drives:
        first = changed(
            np.zeros_like(vector),
            slice(0, count),
            pack(posterior.layout, drive.with_effects(balanced.effect)),
        )
        there = eqx.tree_at(lambda p: p.start, posterior, first)
        fitted = descend(there, first, steps=budget.steps, tolerance=budget.tolerance)
        ends.append(CandidateDescent(trial, there, fitted))
    return min(ends, key=lambda one: one.fitted.misfit)


def from_before(start: RefitStart, trial: Trial, found: Model) -> CandidateDescent:
    """The candidate of a `trial` from where it was `found` by observers with other gains."""
    posterior, _ = start.extended(trial)
    budget, theirs, there = start.effort.refitting, found.posterior, found.fitted.vector
    # The sizes in which it is counted may have been others.
    own = np.asarray(pack(posterior.layout, theirs.drive_of(there)))
    vector = np.concatenate([own, np.asarray(there)[len(theirs.layout) :]])
    fitted = descend(posterior, vector, graduate=False, steps=budget.steps, tolerance=budget.tolerance)
    return CandidateDescent(trial, posterior, fitted)


def behind_a_gap(start: RefitStart, trial: Trial) -> CandidateDescent | None:
    """The candidate of a `trial` with a gap, searched; None where no gap predicts sliding better."""
    posterior, vector = start.extended(trial)
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    found = search_backlash(
        slow, vector, start.scales["zs"], start.ratio, rule=start.rule, effort=start.effort
    )
    if found is None:
        return None
    return CandidateDescent(trial, posterior, descend(posterior, found, graduate=False, steps=0))


def with_slow_observer(start: RefitStart, candidate: CandidateDescent) -> Refitted:
    """The `candidate` after its last descent, with the slow observer, and judged. Where it ends above the model without
    it, the first descent led it astray, and it starts again from there: a richer model never explains less."""
    found, rule = candidate.fitted.vector, start.rule
    slow = candidate.posterior.on_recordings_of(start.whole).at_bandwidth(SLOW_BANDWIDTH)
    if has_contacts(candidate.trial.form):
        # Contacts are shorter than anything else in the machine.
        slow = without_chaos(slow, found, rule=rule)
        slow = without_chaos(with_steps(slow, steps_needed(slow, found, rule=rule)), found, rule=rule)
    budget = start.effort.refitting
    steps, tolerance = budget.slow_steps, budget.slow_tolerance
    fitted = descend(slow, found, graduate=False, steps=steps, tolerance=tolerance)
    if not (has_contacts(candidate.trial.form) or fitted.misfit <= start.model.fitted.misfit):
        _, silent = start.extended(candidate.trial)
        own = start.own(slow)
        others = (changed(silent, own, np.asarray(found)[own]), silent)
        ends = [descend(slow, one, graduate=False, steps=steps, tolerance=tolerance) for one in others]
        fitted = min(ends, key=lambda end: end.misfit)
    return Refitted(candidate.trial, Model(slow, fitted, judge(slow, fitted)))


def uncoupled(posterior: Posterior, vector: Vector) -> Vector:
    """`vector` of a machine with a second inertia, with the inertia that it has taken for that of the motor alone, as
    it shows where the load is free in its gap most of the time: J is larger, stiffness and damping are what they
    were."""
    load = posterior.drive_of(vector).load_side
    assert load is not None
    return heavier(posterior, vector, 1.0 / (1.0 - load.ratio))


def _placed(posterior: Posterior, vector: Vector, estimate: Float[Numbers, " p"]) -> Vector:
    """`vector` with the `estimate` of a test: parameters, and the starting deflections of the fitted recordings."""
    count, rows = len(posterior.layout), np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
    places = np.concatenate([np.arange(count), count + rows])
    return changed(vector, places, estimate)


def _other_starts(start: RefitStart, posterior: Posterior, vector: Vector) -> list[Vector]:
    """`vector` with the parameters of the effect where a refit of it starts besides."""
    other, own = vector, start.own(posterior)
    for place in range(own.start, own.stop):
        parameter = posterior.layout[place].parameter
        if parameter.other_start is None:
            continue
        scale = parameter.scale
        unit = scale if isinstance(scale, float) else start.scales[str(scale)]
        log = parameter.transform == "log"
        value = np.log(parameter.other_start * unit) if log else parameter.other_start
        other = changed(other, place, value)
    return [] if other is vector else [other]


def _or_better(candidate: CandidateDescent, other: RobustFit) -> CandidateDescent:
    """The `candidate` at the lower of its own end and the `other`."""
    return dataclasses.replace(
        candidate, fitted=min(candidate.fitted, other, key=lambda fitted: fitted.misfit)
    )


def _lowest(start: RefitStart, posterior: Posterior, starts: list[Vector]) -> RobustFit:
    """The lowest end of descents from the `starts` that begin with a wide loss."""
    budget = start.effort.refitting
    ends = [descend(posterior, one, steps=budget.steps, tolerance=budget.tolerance) for one in starts]
    return min(ends, key=lambda fitted: fitted.misfit)


def _first_steps(start: RefitStart, posterior: Posterior, starts: list[Vector]) -> RobustFit:
    """The lowest end of the first steps from the `starts`."""
    budget = start.effort.refitting
    # From a step that gains a wide loss leads no further than the noise's own.
    ends = [
        descend(posterior, one, graduate=False, steps=budget.first_steps, tolerance=budget.tolerance)
        for one in starts
    ]
    return min(ends, key=lambda fitted: fitted.misfit)
