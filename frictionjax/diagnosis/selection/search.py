"""Stepwise selection: effects are added, dropped and swapped, by tables of comparisons alone.

The search knows no models. It asks for a table, decides by the rule, and asks for the next one: of a supplier that
refits (`refitted_tables`), or of one that looks up what was stored (`stored_tables`).
"""

import dataclasses
from collections.abc import Collection, Sequence
from typing import Protocol, runtime_checkable

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import (
    acceptable,
    best_likelier,
    choose,
    explains_enough,
    only_complete,
    predicts_ahead,
)
from frictionjax.diagnosis.selection.confidence import Evidence, evidence_of
from frictionjax.diagnosis.selection.round import Round, dropping
from frictionjax.diagnosis.selection.verdict_rule import adequate, most_left, verdict_of
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison, within
from frictionjax.diagnosis.verdict import Verdict

_TOO_LITTLE = "clearly likelier, but all that was found explains too little of the misfit to be named"
_NOT_AHEAD = "clearly likelier one sample ahead, but held-out recordings are predicted worse 0.1 s ahead"
_INCUMBENT = 0  # row of the effect that is there already, in the table of a swap
_NOT_NEEDED = "not needed: refitted to all recordings, the base model reaches the noise floor"


@runtime_checkable
class Tables(Protocol):
    """What supplies the comparisons that a search asks for. A `chain` holds the rounds so far, each with an accepted
    candidate, in the order in which their effects were added."""

    def candidates(self, number: int, chain: Sequence[Round]) -> ComparisonTable:
        """The catalogue's candidates beside what the `chain` accepted: the round of this `number`, from 0 on."""
        ...

    def settle(self, found: Round) -> None:
        """Take notice that the round `found` accepted a candidate, before anything is asked that rests on it."""
        ...

    def whole(self, chain: Sequence[Round]) -> ModelComparison:
        """The model that the `chain` accepted last against the base model, above the floor of its last table."""
        ...

    def all_recordings(self, first: Round) -> ModelComparison:
        """The base model of the round `first`, refitted to all recordings, against itself as it was."""
        ...

    def without(self, chain: Sequence[Round], place: int) -> ModelComparison:
        """The model of the `chain` against the one without the effect at the `place`, refitted."""
        ...

    def fewer(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round]
    ) -> ComparisonTable:
        """Of the `chain` without the effect at the `place`, the effect of this `number` beside those `before` it."""
        ...

    def swap(self, chain: Sequence[Round], place: int) -> ComparisonTable:
        """The effect at the `place` of the `chain` and all that are confused with it, beside the others."""
        ...

    def rebuilt(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round], swap: ComparisonTable
    ) -> ComparisonTable:
        """As `fewer`, with the rivals of that effect, after the table `swap` let another in at the `place`."""
        ...


@dataclasses.dataclass(frozen=True)
class Decision:
    """What a search came to.

    **Attributes:** `rounds`, `verdict`, `remains` (whether something significant is left), `share` (of the misfit that
    is left), `evidence` (for each name).
    """

    rounds: tuple[Round, ...]
    verdict: Verdict
    remains: bool
    share: float
    evidence: tuple[Evidence, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the accepted effects."""
        return tuple(one.row.effect for one in self.rounds if one.accepted is not None)

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Each name, and after it those that the recordings cannot tell from it."""
        return tuple((one.row.effect, *one.rivals) for one in self.rounds if one.accepted is not None)


def decide(tables: Tables, rule: Rule, most: int) -> Decision:
    """Search by the `tables` and the `rule` for at most so many effects, `most`, and say what is named."""
    chain = Search(tables, rule, most).run()
    whole = tables.whole(chain) if any(one.accepted is not None for one in chain) else None
    return decision_of(chain, whole, rule)


def decision_of(chain: Sequence[Round], whole: ModelComparison | None, rule: Rule) -> Decision:
    """What the rounds of the `chain` come to by the `rule`; `whole`: the last accepted model against the base model,
    None where nothing was accepted."""
    verdict, (remains, share) = verdict_of(chain, whole, rule=rule)
    return Decision(tuple(chain), verdict, remains, share, tuple(evidence_of(chain, whole, rule=rule)))


@dataclasses.dataclass(frozen=True)
class Search:
    """The moves of a stepwise selection.

    **Attributes:** `tables` (what supplies the comparisons), `rule`, `most` (effects at most).
    """

    tables: Tables
    rule: Rule
    most: int

    def run(self) -> list[Round]:
        """The rounds: each with an accepted candidate, but for a last one in which nothing was."""
        first = self._next(self.tables.candidates(0, ()), [])
        if self._is_open(first):
            return [dropping(first, _NOT_NEEDED, together=True)]
        if first.accepted is None:
            return [first]
        chain = self._add([first])
        if all(one.accepted is None for one in chain) or explains_enough(self.tables.whole(chain), self.rule):
            return chain
        return [dropping(first, _TOO_LITTLE)]

    def _next(self, table: ComparisonTable, chain: list[Round], *, complete: bool = False) -> Round:
        """The round of the `table` after the `chain`, which may be `complete`, with the likeliest candidate that
        predicts held-out recordings 0.1 s ahead, too."""
        refused: list[int] = []
        while True:
            found = self._accept(table, refused)
            if complete:
                found = only_complete(found, self.rule)
            if found.accepted is None:
                return dropping(found, _NOT_AHEAD) if refused else found
            if predicts_ahead(self.tables.whole([*chain, found])):
                return found
            refused.append(found.accepted)

    def _accept(self, table: ComparisonTable, refused: Collection[int] = ()) -> Round:
        found = choose(table, self.rule, refused)
        return found if found.accepted is None else self._settled(found, found.accepted)

    def _settled(self, found: Round, row: int) -> Round:
        """The round `found` with the candidate `row` accepted."""
        accepted = dataclasses.replace(found, accepted=row, settled=row)
        self.tables.settle(accepted)
        return accepted

    def _is_open(self, first: Round) -> bool:
        """Whether the fitted recordings leave a parameter open: the base model is adequate there, not on the held-out
        ones, and on all once it is fitted to all. A true model then predicts others badly."""
        table, limits = first.table, self.rule.limits
        own = within(table.misfits, table.misfit_errors, limits.adequate, self.rule)
        if own != (True, False):
            return False
        refitted = self.tables.all_recordings(first)
        if first.accepted is not None:
            lead = first.row.lead_over(refitted)
            if lead.in_errors(self.rule) > self.rule.rivals.lead:
                return False
        return adequate(refitted.misfits_after, refitted.misfit_errors, self.rule)

    def _tentative(self, refused: Round) -> Round | None:
        """The round with its likeliest clear candidate accepted, although it explains too little alone."""
        row = best_likelier(refused.table, self.rule)
        return None if row is None else self._settled(refused, row)

    def _add(self, chain: list[Round]) -> list[Round]:
        """The `chain` with further effects, until nothing significant is left or nothing else is acceptable."""
        for number in range(len(chain), self.most):
            whole = self.tables.whole(chain)
            share = whole.gains(self.rule).share
            at_the_noise = adequate(whole.misfits_after, whole.misfit_errors, self.rule)
            if at_the_noise or self._leaves_chaos(whole):
                break
            complete = share > self.rule.accept.enough_share
            found = self._next(self.tables.candidates(number, chain), chain, complete=complete)
            if found.accepted is None:
                changed = None if complete else self.instead(chain, found)
                if changed is None:
                    return [*chain, found]
                chain = changed
                continue
            chain = [*chain, found]
            fewer = self.drop(chain)
            if len(fewer) < len(chain):
                return fewer
            chain = self.swap(chain)
        return chain

    def _leaves_chaos(self, whole: ModelComparison) -> bool:
        """Whether contacts are what is missing, having explained enough of the `whole`: what they leave is chaos, and
        no effect beside them explains most of that."""
        share = whole.gains(self.rule).share
        return whole.chaotic and 1.0 - share < most_left(whole.exact, rule=self.rule)

    def superfluous(self, chain: Sequence[Round]) -> int | None:
        """Place of the first effect of the `chain` that is not needed beside the others; None where all are. The one
        accepted last was tested beside the others when it came, and each was significant when it came."""
        for place in range(len(chain) - 1):
            least = self.rule.accept.least_share
            if not acceptable(self.tables.without(chain, place), self.rule, least_share=least)[0]:
                return place
        return None

    def drop(self, chain: list[Round]) -> list[Round]:
        """The same `chain`, or, where an effect is not needed beside the others, rounds without it: the first of those
        that stay is compared again with the candidates of the first round."""
        place = self.superfluous(chain)
        return chain if place is None else self._fewer(chain, place)

    def _fewer(self, chain: list[Round], place: int) -> list[Round]:
        """Rounds without the effect at the `place` of the `chain`, that has been compared with the model without it."""
        fewer: list[Round] = []
        for number in range(len(chain) - 1):
            table = self.tables.fewer(chain, place, number, fewer)
            found = self._accept(table)
            fewer.append(found)
            if found.accepted is None or found.row.form != table.rows[0].form:
                break
        return fewer

    def swap(self, chain: list[Round]) -> list[Round]:
        """The same `chain`, or rounds in which an earlier effect made way for one that it is confused with, or for
        itself with another period, or of another form.

        While it was alone it had to stand in for what was accepted later, so that a wrong one may have won. What comes
        in is put last, and so is what the recordings cannot tell from another beside the others.
        """
        for place, own in enumerate(list(chain[:-1])):
            table = self.tables.swap(chain, place)
            found = self._accept(table)
            if found.accepted is None:
                continue
            if found.rivals or self._takes_its_place(table, found.accepted):
                return [*self._rebuilt(chain, place, table), found]
            # Beside the others it can be distinguished from all of them.
            chain = [*chain[:place], dataclasses.replace(own, rivals=()), *chain[place + 1 :]]
        return chain

    def _takes_its_place(self, table: ComparisonTable, row: int) -> bool:
        """Whether the `row` of a swap's `table` is another effect than the incumbent, or the same one elsewhere, with
        another period or of another form, that the recordings can tell from it."""
        if table.rows[row].effect != table.rows[_INCUMBENT].effect:
            return True
        return row != _INCUMBENT and table.lead(row, _INCUMBENT, self.rule) >= self.rule.rivals.lead

    def _rebuilt(self, chain: list[Round], place: int, swap: ComparisonTable) -> list[Round]:
        """The `chain` without the effect at the `place`. Each of the others was found beside it and is needed there;
        alone it need not explain most."""
        rebuilt: list[Round] = []
        for number in range(len(chain) - 1):
            table = self.tables.rebuilt(chain, place, number, rebuilt, swap)
            rivals = tuple(sorted({row.effect for row in table.rows[1:]}))
            rebuilt.append(Round(table, 0, rivals))
        return rebuilt

    def instead(self, chain: list[Round], refused: Round) -> list[Round] | None:
        """Rounds in which an effect took the place of one that it is confused with, found by what was `refused` after
        the `chain`.

        Beside a wrong name the second effect of two explains too little to be accepted, and nothing would compare the
        first one again. So it is tried out: taken for accepted, swapped, and kept where another model came in, all are
        needed, and together they explain nearly all of the misfit. None where that is not so.

        Where no other name came in, but the first one elsewhere, what was refused goes again: it has shown a better
        minimum of what is named already.
        """
        started = self._tentative(refused)
        if started is None:
            return None
        tried = [*chain, started]
        changed = self.swap(tried)
        if [one.reference for one in changed] == [one.reference for one in tried]:
            return None
        if {one.row.effect for one in changed} == {one.row.effect for one in tried}:
            return self._elsewhere(chain, changed, started)
        share = self.tables.whole(changed).gains(self.rule).share
        if share <= self.rule.accept.enough_share or len(self.drop(changed)) < len(changed):
            return None
        return changed

    def _elsewhere(self, chain: list[Round], changed: list[Round], started: Round) -> list[Round] | None:
        """The effects of the `chain` as they are in the rounds `changed`, without that of the round `started`; None
        where they explain no more than before."""
        place = [one.row.effect for one in changed].index(started.row.effect)
        self.tables.without(changed, place)  # what is left without it is where `fewer` starts
        found = self._fewer(changed, place)
        if any(one.accepted is None for one in found):
            return None
        before, after = (self.tables.whole(some).gains(self.rule) for some in (chain, found))
        return found if after.worth > before.worth else None
