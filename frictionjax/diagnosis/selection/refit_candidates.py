"""Candidates: effects of the catalogue tested beside a model, and the best of them refitted."""

import dataclasses
from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from frictionjax.core import Progress
from frictionjax.core.progress import Counting
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting.refit import Hints, refit_all, refit_balanced
from frictionjax.diagnosis.refitting.refitted import Refitted, polish
from frictionjax.diagnosis.refitting.shortlist import (
    absorbed_by_base,
    backlash_candidates,
    confused_with,
    one_of_each,
    short_list,
)
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.resonance import Pair
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.screening.try_catalogue import try_catalogue
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start.force_balance import Balanced
from frictionjax.physics.effects import AbstractEffect, catalogue

_LATER = 0.3
"""Part of the search that is shown as left after each round: most searches end with the first or the second."""


@dataclasses.dataclass(frozen=True)
class CandidateRefitter:
    """Tests the catalogue beside a model, and refits the best.

    **Attributes:** `executor` (runs tests and refits side by side), `progress` (called as it goes), `turn` (a full
    turn, position units, where the position is an angle), `pair` (antiresonance and resonance in the data, or None),
    `without` (names of effects, or of forms, that are left out), `barred` (names of effects that are tested, for their
    smallest detectable size, but not refitted), `stick_inertia` (that noise in stick shows, or None), `balanced` (gives
    the forces that the force balance asks for), `rule`, `effort`, `base_effects` (how many the base model has),
    `carried` (whether the base model is none of the machine, because one of those forces carries most of the motor
    force), `before` (what a selection with observers of other gains refitted).
    """

    executor: Executor
    progress: Progress
    turn: float
    pair: Pair | None
    without: frozenset[str]
    barred: frozenset[str]
    stick_inertia: float | None
    balanced: Callable[[], tuple[Balanced, ...]]
    rule: Rule
    effort: Effort
    base_effects: int = 0
    carried: bool = False
    before: tuple[Refitted, ...] = ()

    def beside(self, model: Model, number: int) -> tuple[Model, list[Trial], list[Refitted]]:
        """Every test beside the `model`, in the round of this `number`, and refits of the best, the two closest
        converged; with the model without them, which is a better one where a refit led to it."""
        budget, (start, stop) = self.effort.screening, shown_span(number)
        span = stop - start
        if self.carried and number == 0:
            return self._of_the_balance(model)
        testing = self._counting(f"testing every effect, round {number + 1}", start, start + 0.5 * span)
        tried = try_catalogue(
            model, self._scales(model), testing, self.without, self.pair, effort=self.effort
        )
        most = budget.first_forms if number == 0 else budget.later_forms
        chosen = self._worth_refitting(model, tried, most)
        stage = f"refitting {len(chosen)} candidates, round {number + 1}"
        refitting = self._counting(stage, start + 0.5 * span, start + 0.95 * span)
        open_to = [trial for trial in tried[0] if trial.effect not in self.barred]
        hints = Hints(
            self.pair,
            absorbed_by_base(open_to, effort=self.effort),
            backlash_candidates(open_to),
            self.stick_inertia,
            self.base_effects,
            lambda: self._asked_for(open_to),
            self._refitted_before(model, open_to),
        )
        refits = refit_all(
            chosen, model, self._scales(model), refitting, hints, rule=self.rule, effort=self.effort
        )
        trials = [trial for some in tried for trial in some]
        return self._with_twins(model, with_tests(trials, [trial for trial, _ in hints.before]), refits)

    def _refitted_before(self, model: Model, trials: list[Trial]) -> list[tuple[Trial, Model]]:
        """What was refitted before beside the effects of the `model`, each with its test among the `trials`, or that of
        then: where a test throws the motion of a model, it says nothing."""
        of_form, inside = {type(trial.form): trial for trial in trials}, _forms(model)
        return [
            (of_form.get(type(one.trial.form), one.trial), one.model)
            for one in self.before
            if one.effect not in self.barred and _forms(one.model) == [*inside, type(one.trial.form)]
        ]

    def _scales(self, model: Model) -> dict[str, float]:
        """The plant's own sizes as the `model` has them: those of the base model are far off where much is missing."""
        return plant_scales(model.judgement.drive, model.posterior.batch, turn=self.turn)

    def _counting(self, stage: str, start: float, stop: float) -> Counting:
        """The executor that says how much of a `stage` is done, from the part `start` of the search to `stop`."""
        self.progress(stage, start)
        return Counting(self.executor, self.progress, stage, start, stop)

    def _of_the_balance(self, model: Model) -> tuple[Model, list[Trial], list[Refitted]]:
        """As `beside`, of the forces alone that the force balance asks for, and of what was refitted before: beside a
        base model that is none of the machine no test says anything."""
        known = {one.effect for one in self.before if _forms(one.model)[:-1] == _forms(model)}
        names = ({one.effect.name for one in self.balanced()} | known) - self.barred
        self.progress(f"refitting {', '.join(sorted(names))}, as the force balance asks", 0.0)
        without = self.without | (frozenset(catalogue()) - names)
        tried = try_catalogue(
            model, self._scales(model), self.executor, without, self.pair, effort=self.effort
        )
        trials = [trial for some in tried for trial in some]
        before = self._refitted_before(model, trials)
        hints = Hints(
            self.pair,
            base_effects=self.base_effects,
            balanced=lambda: self._asked_for(trials),
            before=before,
        )
        refits = refit_balanced(
            model, self._scales(model), self.executor, hints, rule=self.rule, effort=self.effort
        )
        return self._with_twins(model, with_tests(trials, [trial for trial, _ in before]), refits)

    def _with_twins(
        self, model: Model, trials: list[Trial], refits: list[Refitted]
    ) -> tuple[Model, list[Trial], list[Refitted]]:
        """The `model`, or a better one that a refit led to, with the `trials` and the `refits`, and those of what the
        best of them is commonly taken for."""
        model = better_base(model, refits, effort=self.effort)
        refits = self._best_first(model, refits)
        instead, twins = self._in_place_of_the_best(model, refits)
        refits = self._best_first(model, [*refits, *twins])
        return model, with_tests(trials, instead), self._polished(model, refits)

    def _in_place_of_the_best(
        self, model: Model, refits: list[Refitted]
    ) -> tuple[list[Trial], list[Refitted]]:
        """Tests and refits of what the best of the `refits` is commonly taken for, as far as it is not among them: each
        in its place, from where it left the other parameters. A short list by first steps may lack the true one of two
        effects that look alike."""
        if not refits or self._worth(model, refits[0]) < self.effort.refitting.worthless:
            return [], []
        best, inside = refits[0], {type(effect).name for effect in model.posterior.drive.effects}
        names = confused_with(best.effect) - inside - self.barred - {one.effect for one in refits}
        return self.related(_without(best, model), names, best.model) if names else ([], [])

    def _asked_for(self, trials: list[Trial]) -> list[tuple[Trial, Balanced]]:
        """Those of the `trials` that the force balance asks for, each with what it says."""
        of_form = {type(trial.form): trial for trial in trials}
        return [(of_form[type(one.effect)], one) for one in self.balanced() if type(one.effect) in of_form]

    def related(
        self, model: Model, names: frozenset[str], best: Model | None = None
    ) -> tuple[list[Trial], list[Refitted]]:
        """Tests, and refits of the best of each form, of the effects of these `names` beside those of the `model`;
        `best` as in `refit_all`."""
        without = self.without | (frozenset(catalogue()) - names)
        tried = try_catalogue(
            model, self._scales(model), self.executor, without, self.pair, effort=self.effort
        )
        chosen = [one for some in tried for one in one_of_each(some) if np.isfinite(one.gain)]
        hints = Hints(self.pair, base_effects=self.base_effects)
        refits = refit_all(
            chosen, model, self._scales(model), self.executor, hints, best, rule=self.rule, effort=self.effort
        )
        return [trial for some in tried for trial in some], refits

    def _best_first(self, model: Model, refits: list[Refitted]) -> list[Refitted]:
        """The `refits` by what each explains of what the `model` misses."""
        return sorted(refits, key=lambda refit: -self._worth(model, refit))

    def _worth(self, model: Model, refit: Refitted) -> float:
        least = model.posterior.batch.eased[:, None]
        compared = compare(model.judgement, refit.model.judgement, least, rule=self.rule)
        return compared.gains(self.rule).worth

    def _polished(self, model: Model, refits: list[Refitted]) -> list[Refitted]:
        """The `refits`, of which the two best are converged where their last steps may decide between them."""
        budget, worth = self.effort.refitting, [self._worth(model, refit) for refit in refits[:2]]
        close = [
            refit
            for refit, own in zip(refits, worth, strict=False)
            if own > max(budget.worthless, worth[0] - budget.close)
        ]
        done = self.executor.map(lambda refit: polish(refit, effort=self.effort), close)
        return [*done, *refits[len(close) :]]

    def _worth_refitting(self, model: Model, tried: list[list[Trial]], most: int) -> list[Trial]:
        """The short lists of the trials, `most` forms in each. Under an imposed motion, far from the noise, every form:
        the base model has come to rest in a corner, and no step from there says what would gain after many."""
        budget, misfits = self.effort.screening, model.judgement.misfits(np.ones((1, 1)))
        far = max(misfits) > budget.far
        cornered = model.posterior.batch.imposed and min(misfits) > budget.cornered
        chosen = []
        for some in tried:
            open_to = [trial for trial in some if trial.effect not in self.barred]
            if cornered:
                chosen += [trial for trial in one_of_each(open_to) if np.isfinite(trial.gain)]
            else:
                chosen += short_list(open_to, most=most, far=far, effort=self.effort)
        return chosen


def shown_span(number: int) -> tuple[float, float]:
    """From which to which part of the search the round of this `number`, from 0 on, is shown; some is always left."""
    return 1.0 - _LATER**number, 1.0 - _LATER ** (number + 1)


def with_tests(trials: list[Trial], others: list[Trial]) -> list[Trial]:
    """The `trials`, and of the `others` those of effects that are not among them: where a test throws the motion of one
    model it says nothing, and beside another model it may."""
    tested = {trial.effect for trial in trials}
    return trials + [trial for trial in others if trial.effect not in tested]


def _forms(model: Model) -> list[type[AbstractEffect]]:
    return [type(effect) for effect in model.posterior.drive.effects]


def _without(refit: Refitted, model: Model) -> Model:
    """The `model`, which has all effects but that of the `refit`, with the parameters of the `refit`."""
    slow = model.posterior.at_bandwidth(SLOW_BANDWIDTH)
    own = slice(len(slow.layout), len(refit.model.posterior.layout))
    there = descend(slow, np.delete(np.asarray(refit.model.fitted.vector), own), graduate=False, steps=0)
    return Model(slow, there, judge(slow, there))


def better_base(model: Model, refits: list[Refitted], *, effort: Effort = Effort()) -> Model:
    """A better solution of the `model` without the candidates, found from their `refits`; the same when there is none.

    A model with something missing has several minima; a refit that left a bad one must not get the credit for it. How
    much better it must be is in the `effort`.
    """
    slow = model.posterior.at_bandwidth(SLOW_BANDWIDTH)
    count, own = len(slow.layout), model.fitted.misfit
    starts = [
        np.asarray(np.delete(np.asarray(r.model.fitted.vector), slice(count, len(r.model.posterior.layout))))
        for r in refits
    ]
    if not starts:
        return model
    values = slow.misfits(starts)
    index, budget = int(np.argmin(values)), effort.refitting
    if not values[index] < own - max(budget.least_better, budget.better_base * own):
        return model
    fitted = descend(slow, starts[index], graduate=False)
    return Model(slow, fitted, judge(slow, fitted))
