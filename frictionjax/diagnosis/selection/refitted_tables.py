"""Tables that are made as a search asks for them: models refitted, and compared above a floor."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.base_model.credibility import made_credible
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.ahead import held_out_ahead, lead_ahead
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import Answer
from frictionjax.diagnosis.refitting.refitted import Refitted, ease
from frictionjax.diagnosis.refitting.shortlist import confused_with
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.selection.acceptance import least_share_of, ranked
from frictionjax.diagnosis.selection.candidate_table import Ground, ground_of, table_of_candidates
from frictionjax.diagnosis.selection.refit_candidates import with_tests
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.selection.stored_tables import (
    asked_of_all_recordings,
    asked_of_candidates,
    asked_of_move,
    asked_of_rebuilt,
    asked_of_whole,
)
from frictionjax.diagnosis.table import ComparisonTable, Lead, ModelComparison, table_of_one
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import extend
from frictionjax.physics.effects import AbstractEffect


@runtime_checkable
class Refits(Protocol):
    """What tests and refits the catalogue: `CandidateRefitter`."""

    def beside(self, model: Model, number: int) -> tuple[Model, list[Trial], list[Refitted]]:
        """As `CandidateRefitter.beside`, of the `model` and the `number`."""
        ...

    def related(
        self, model: Model, names: frozenset[str], best: Model | None = None
    ) -> tuple[list[Trial], list[Refitted]]:
        """As `CandidateRefitter.related`, of the `model`, the `names` and the `best`."""
        ...


@dataclasses.dataclass(frozen=True)
class Made:
    """What a table was made of: the model `before`, the `trials`, the `refits` in the order of its rows, the `ground`
    of the comparisons."""

    before: Model
    trials: list[Trial]
    refits: list[Refitted]
    ground: Ground


class RefittedTables:
    """The comparisons that a search asks for, made by refits, and all of them kept in `tables`.

    **Arguments:**

    - `base`: the fitted base model.
    - `refits`: tests and refits the catalogue.
    - `scales`: the plant's own sizes by name.
    - `answer`: gives the answer to noise and a force of the likeliest of models (`Answers.of_likeliest`).
    - `rule`: for what enters the comparisons.
    - `effort`: of refits.
    """

    def __init__(
        self,
        base: Model,
        refits: Refits,
        scales: dict[str, float],
        answer: Callable[[Sequence[Model]], Answer],
        *,
        rule: Rule = Rule(),
        effort: Effort = Effort(),
    ) -> None:
        self.tables: list[ComparisonTable] = []
        self._base, self._refits, self._scales, self._answer = base, refits, scales, answer
        self._rule, self._effort = rule, effort
        self._made: dict[str, Made] = {}
        self._settled: dict[str, Refitted] = {}
        self._rest: dict[tuple[str, ...], Model] = {}
        self._single: dict[tuple[str, ...], ModelComparison] = {}
        # With the model: its number is its own while it is there.
        self._errors: dict[int, tuple[Model, np.ndarray]] = {}

    def candidates(self, number: int, chain: Sequence[Round]) -> ComparisonTable:
        """As in `Tables`: of this `number`, after the `chain`."""
        model = self.accepted(chain[-1]).model if chain else self._base
        model, trials, refits = self._refits.beside(model, number)
        asked = asked_of_candidates(number, chain)
        return self.compared(asked, model, trials, refits, before=self._floor_of(chain))

    def settle(self, found: Round) -> None:
        """Refit the model that the round `found` accepted against what it leaves itself, under an imposed motion."""
        own = self.accepted(found)
        model = ease(own.model, rule=self._rule, effort=self._effort)
        if model is not own.model:
            self._settled[found.reference] = Refitted(own.trial, model)

    def whole(self, chain: Sequence[Round]) -> ModelComparison:
        """As in `Tables`, of the `chain`."""
        last = next(one for one in reversed(chain) if one.accepted is not None)
        base, floor = self._made[chain[0].table.key].before, self._made[chain[-1].table.key].ground.floor
        rest = [one for one in chain if one.accepted is not None and one is not last]
        without = self.accepted(rest[-1]).model if rest else base
        return self._against(asked_of_whole(chain), base, self.accepted(last).model, floor, without=without)

    def all_recordings(self, first: Round) -> ModelComparison:
        """As in `Tables`, of the round `first`."""
        own = self._made[first.table.key]
        found = fitted_to_all(own.before)
        return self._against(asked_of_all_recordings(first), own.before, found, own.ground.floor)

    def without(self, chain: Sequence[Round], place: int) -> ModelComparison:
        """As in `Tables`, of the `chain` and the `place`."""
        asked, last = asked_of_move("without", chain, place), chain[-1]
        full, others = self.accepted(last).model, [k for k in range(len(chain)) if k != place]
        rest = with_some(self._made[chain[0].table.key].before, full, others, self._scales)
        self._rest[asked[1:]] = rest
        own = self.accepted(chain[place]).trial.form
        return self._against(asked, rest, full, self._made[last.table.key].ground.floor, own)

    def fewer(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round]
    ) -> ComparisonTable:
        """As in `Tables`, of the `chain`, the `place`, and the `number` after those `before`."""
        kept = [own for other, own in enumerate(chain) if other != place]
        asked, own = asked_of_move("fewer", chain, place, number), kept[number]
        base, trial = self._made[chain[0].table.key].before, self.accepted(own).trial
        rest = self._rest[asked_of_move("", chain, place)[1:]]
        if number < len(kept) - 1:
            rest = with_some(base, rest, range(number + 1), self._scales)
        refits = [Refitted(trial, rest)]
        trials = self._made[own.table.key].trials
        if number == 0:
            first, model = self.step(chain[0]), base
            # Its period may have shown only beside the effect that goes: with its own trials then, too.
            passed = [t for t in trials if t.effect == trial.effect and own is not chain[0]]
            trials = self._made[chain[0].table.key].trials + passed
            refits += [r for r in first.refits if r.form != refits[0].form]
        else:
            model = self.accepted(before[-1]).model  # the others were refitted beside the one that goes
        return self.compared(asked, model, trials, refits, before=self._floor_of(before))

    def swap(self, chain: Sequence[Round], place: int) -> ComparisonTable:
        """As in `Tables`, of the `chain` and the `place`."""
        own, full = chain[place], self.accepted(chain[-1]).model
        others = [number for number in range(len(chain)) if number != place]
        rest = with_some(self._made[chain[0].table.key].before, full, others, self._scales)
        inside = {type(effect).name for effect in rest.posterior.drive.effects}
        trials, refits = self._refits.related(rest, confused_with(own.row.effect) - inside, full)
        asked = asked_of_move("swap", chain, place)
        self._rest[asked] = rest
        incumbent = Refitted(self.accepted(own).trial, full)
        # Their tests beside the others, and those that the incumbent has passed.
        passed = [t for t in self._made[own.table.key].trials if t.effect == incumbent.effect]
        return self.compared(asked, rest, trials + passed, [incumbent, *refits])

    def rebuilt(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round], swap: ComparisonTable
    ) -> ComparisonTable:
        """As in `Tables`, of the `chain`, the `place`, the `number` after those `before`, and the table `swap`."""
        kept = [own for other, own in enumerate(chain) if other != place]
        own, base = kept[number], self._made[chain[0].table.key].before
        rest = self._rest[swap.asked]
        if number < len(kept) - 1:
            rest = with_some(base, rest, range(number + 1), self._scales)
        model = self.accepted(before[-1]).model if before else base
        refitted = Refitted(self.accepted(own).trial, rest)
        passed = [t for t in self._made[own.table.key].trials if t.effect == refitted.effect]
        trials = self._made[chain[0].table.key].trials + passed
        tests, rivals = self._refits.related(model, frozenset(own.rivals), rest) if own.rivals else ([], [])
        asked = asked_of_rebuilt(chain, place, number, swap)
        trials = with_tests(trials, tests)
        return self.compared(asked, model, trials, [refitted, *rivals], before=self._floor_of(before))

    def compared(
        self,
        asked: tuple[str, ...],
        model: Model,
        trials: list[Trial],
        refits: list[Refitted],
        *,
        before: np.ndarray | None = None,
    ) -> ComparisonTable:
        """The table of what was `asked`: `refits` of the best of the `trials` compared with the `model`; `before` as in
        `ground_of`."""
        answer = self._answer([model, *(refit.model for refit in refits)])
        ground = ground_of(model, refits, answer, before, rule=self._rule)
        return self.keep(asked, Made(model, trials, refits, ground))

    def keep(self, asked: tuple[str, ...], made: Made) -> ComparisonTable:
        """The table of what was `asked`, of models that are `made`, and kept."""
        key = f"t{len(self.tables)}"
        table = table_of_candidates(
            key, asked, made.before, made.trials, made.refits, made.ground, rule=self._rule
        )
        self._made[key] = made
        self.tables.append(table)
        return table

    def accepted(self, found: Round) -> Refitted:
        """The candidate that the round `found` accepted."""
        if found.accepted is None:
            raise ValueError(f"Nothing was accepted in table {found.table.key}.")
        own = self._made[found.table.key].refits[found.accepted]
        return self._settled.get(found.reference, own) if found.settled == found.accepted else own

    def step(self, found: Round) -> Step:
        """The round `found` with its models, the candidate that explains most first."""
        made, table = self._made[found.table.key], found.table
        refits = list(made.refits)
        if found.settled is not None:
            reference = f"{table.key}.{found.settled}"
            refits[found.settled] = self._settled.get(reference, refits[found.settled])
        order = ranked(table, self._rule)
        return Step(
            before=made.before,
            trials=made.trials,
            refits=[refits[row] for row in order],
            compared=[table.rows[row] for row in order],
            floor=made.ground.floor,
            force=made.ground.force,
            accepted=None if found.accepted is None else refits[found.accepted],
            rivals=found.rivals,
            together=found.together,
            dropped=found.dropped,
            least_share=least_share_of(table, self._rule),
        )

    def _floor_of(self, chain: Sequence[Round]) -> np.ndarray | None:
        return self._made[chain[-1].table.key].ground.floor if chain else None

    def _against(
        self,
        asked: tuple[str, ...],
        before: Model,
        after: Model,
        floor: np.ndarray,
        added: AbstractEffect | None = None,
        *,
        without: Model | None = None,
    ) -> ModelComparison:
        """One comparison, kept as a table of one row, with the lead 0.1 s ahead over the model `without` the last
        effect; its effect has passed its test before."""
        if asked in self._single:
            return self._single[asked]
        row = self._single[asked] = compare(
            before.judgement,
            after.judgement,
            floor,
            added=added,
            makes_credible=made_credible(before, [after], self._rule)[0],
            ahead=None if without is None else self._ahead(without, after),
            rule=self._rule,
        )
        key, chaotic, imposed = f"t{len(self.tables)}", is_chaotic(before), before.posterior.batch.imposed
        self.tables.append(table_of_one(key, asked, row, chaotic=chaotic, imposed=imposed))
        return row

    def _ahead(self, before: Model, after: Model) -> Lead | None:
        """The lead of `after` over `before` 0.1 s ahead."""
        batch = before.posterior.batch
        if batch.imposed:
            return None
        for one in (before, after):
            if id(one) not in self._errors:
                self._errors[id(one)] = (one, held_out_ahead(one))
        old, new = (self._errors[id(one)][1] for one in (before, after))
        return lead_ahead(old, new, np.asarray(batch.dt)[before.judgement.held_out])


def with_some(base: Model, full: Model, places: Sequence[int], scales: dict[str, float]) -> Model:
    """The `base` model with some of the effects of `full`, converged with everything free.

    **Arguments:**

    - `base`: the model without effects.
    - `full`: the same with several.
    - `places`: which of them stay.
    - `scales`: the plant's own sizes by name.

    It starts once with the other parameters of `full` (as they follow the strengths that go to zero, where that leaves
    less) and once with those of `base`, and the better end is returned.
    """
    effects = full.posterior.drive_of(full.fitted.vector).effects[len(base.posterior.drive.effects) :]
    count = len(base.posterior.layout)
    # The same weights as in `full`: recordings may have been eased since, and what is chaotic left out.
    own = full.posterior
    empty = eqx.tree_at(lambda j: (j.evidence, j.weights), base.posterior, (own.evidence, own.weights))

    def with_kept(vector: Float[np.ndarray, " q"]) -> tuple[Posterior, Float[np.ndarray, " q"]]:
        posterior = empty
        for place in places:
            posterior, vector = extend(posterior, vector, effects[place], scales)
        return posterior, vector

    def of_full(vector: Float[np.ndarray, " q"]) -> tuple[Posterior, Float[np.ndarray, " q"]]:
        return with_kept(np.concatenate([vector[:count], vector[len(own.layout) :]]))

    gone = [len(base.posterior.drive.effects) + k for k in range(len(effects)) if k not in places]
    starts = [of_full(vector) for vector in (full.fitted.vector, silenced(full, gone))]
    misfits = starts[0][0].misfits([vector for _, vector in starts])
    starts = [starts[int(np.nanargmin(misfits))], with_kept(base.fitted.vector)]
    ends = [(posterior, descend(posterior, vector, graduate=False)) for posterior, vector in starts]
    posterior, fitted = min(ends, key=lambda end: end[1].misfit)
    return Model(posterior, fitted, judge(posterior, fitted))


def silenced(full: Model, gone: Sequence[int]) -> Float[np.ndarray, " q"]:
    """Where the cost near the end of the `full` model is least once the strengths of the effects at the places `gone`
    are zero: an inertia that made up for one goes back with it.

    Of the quadratic cost (1/2) d' H d with d = -s for the strengths s that go, the others follow by H_oo^-1 H_os s.
    """
    layout, vector = full.posterior.layout, np.array(full.fitted.vector)
    own = np.array([free.path.startswith(tuple(f"effects.{place}." for place in gone)) for free in layout])
    linear = np.array([free.parameter.transform == "linear" for free in layout])
    going, others = np.flatnonzero(own & linear), np.delete(np.arange(vector.size), np.flatnonzero(own))
    hessian = np.asarray(full.fitted.near.hessian)
    pull = hessian[np.ix_(others, going)] @ vector[going]
    vector[others] += np.linalg.lstsq(hessian[np.ix_(others, others)], pull, rcond=1e-12)[0]
    vector[going] = 0.0
    return vector


def lower_base(full: Model, base: Model, rule: Rule) -> Model | None:
    """The `base` model converged from where the `full` one ended, without the effects of that; None where it ends no
    lower by what the `rule` calls significant."""
    posterior = base.posterior
    there = with_some(base, full, (), {}).fitted.vector
    if posterior.misfits([there])[0] >= base.fitted.misfit - rule.limits.adequate:
        return None
    fitted = descend(posterior, there, graduate=False)
    return Model(posterior, fitted, judge(posterior, fitted))


def fitted_to_all(model: Model) -> Model:
    """The `model` fitted to all recordings, the held-out ones included, and judged as before."""
    posterior = eqx.tree_at(lambda j: j.fitted, model.posterior, (np.ones_like(model.posterior.fitted[0]),))
    fitted = descend(posterior, model.fitted.vector, graduate=False)
    judgement = eqx.tree_at(lambda j: j.held_out, judge(posterior, fitted), model.judgement.held_out)
    return Model(posterior, fitted, judgement)
