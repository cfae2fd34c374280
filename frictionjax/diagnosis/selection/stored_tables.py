"""Stored tables: what a search made, looked up instead of refitted, so that another rule can be tried on it."""

from collections.abc import Iterable, Sequence

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.conclusion import (
    CEILING,
    INSTEAD,
    SHAPE,
    asked_afterwards,
    below_ceiling,
    beside_a_map,
    of_another_shape,
)
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Decision, decide
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison


class NotStored(LookupError):
    """A rule leads where the stored search has not been."""


class StoredTables:
    """The `tables` that a search made by a rule, `made_by`; they answer another search by the `rule`.

    Raises `NotStored` for a table that is not among them, and for a rule whose numbers enter the tables themselves.
    """

    def __init__(self, tables: Iterable[ComparisonTable], made_by: Rule, rule: Rule) -> None:
        self._tables = {table.asked: table for table in tables}
        self._other_ranking = made_by.limits.adequate != rule.limits.adequate
        if made_by.floor != rule.floor:
            raise NotStored("numbers of `floor` enter the tables, which were made with others")

    def candidates(self, number: int, chain: Sequence[Round]) -> ComparisonTable:
        """As in `Tables`: of this `number`, after the `chain`."""
        return self._find(asked_of_candidates(number, chain))

    def settle(self, found: Round) -> None:
        """Nothing is refitted: what the round `found` accepted is stored as it was."""

    def whole(self, chain: Sequence[Round]) -> ModelComparison:
        """As in `Tables`, of the `chain`; of a candidate of the first round its own row, where nothing is refitted when
        it is accepted."""
        asked = asked_of_whole(chain)
        last = next(one for one in reversed(chain) if one.accepted is not None)
        own = last.table is chain[-1].table and not last.table.before and not last.table.imposed
        return last.row if asked not in self._tables and own else self._find(asked).rows[0]

    def all_recordings(self, first: Round) -> ModelComparison:
        """As in `Tables`, of the round `first`."""
        return self._find(asked_of_all_recordings(first)).rows[0]

    def without(self, chain: Sequence[Round], place: int) -> ModelComparison:
        """As in `Tables`, of the `chain` and the `place`."""
        return self._find(asked_of_move("without", chain, place)).rows[0]

    def fewer(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round]
    ) -> ComparisonTable:
        """As in `Tables`, of the `chain`, the `place`, and the `number` after those `before`."""
        return self._find(asked_of_move("fewer", chain, place, number))

    def swap(self, chain: Sequence[Round], place: int) -> ComparisonTable:
        """As in `Tables`, of the `chain` and the `place`."""
        return self._find(asked_of_move("swap", chain, place))

    def rebuilt(
        self, chain: Sequence[Round], place: int, number: int, before: Sequence[Round], swap: ComparisonTable
    ) -> ComparisonTable:
        """As in `Tables`, of the `chain`, the `place`, the `number` after those `before`, and the table `swap`."""
        return self._find(asked_of_rebuilt(chain, place, number, swap))

    def afterwards(self, tried: str, chain: Sequence[Round]) -> ModelComparison | None:
        """What was `tried` beside the last model of the `chain` once the search had ended (`conclusion`); None where it
        was not, or by a version that did not store it."""
        table = self._tables.get(asked_afterwards(tried, chain))
        return None if table is None else table.rows[0]

    def map_instead(self, chain: Sequence[Round]) -> ComparisonTable | None:
        """The table of a map over the position instead of the last effect of the `chain` (`conclusion.beside_a_map`);
        None where it is not stored."""
        return self._tables.get(asked_afterwards(INSTEAD, chain))

    def _find(self, asked: tuple[str, ...]) -> ComparisonTable:
        table = self._tables.get(asked)
        if table is None:
            raise NotStored(f"no table of {' '.join(asked)}")
        if table.excused and self._other_ranking:
            raise NotStored(f"table {table.key} has a floor that was raised by another limit of `adequate`")
        return table


def decide_again(tables: StoredTables, rule: Rule, most: int) -> Decision:
    """What the `rule` makes of stored `tables`, by a search for at most so many effects, `most`, and of what was tried
    when the stored search had ended."""
    decision = beside_a_map(decide(tables, rule, most), tables.map_instead, rule)
    decision = below_ceiling(decision, tables.afterwards(CEILING, decision.rounds), rule)
    return of_another_shape(decision, tables.afterwards(SHAPE, decision.rounds), rule)


def asked_of_candidates(number: int, chain: Sequence[Round]) -> tuple[str, ...]:
    """What stands for the round of this `number` after the `chain`."""
    return ("candidates", str(number), *(one.reference for one in chain[-1:]))


def asked_of_whole(chain: Sequence[Round]) -> tuple[str, ...]:
    """What stands for the last model of the `chain` against the base model."""
    last = next(one for one in reversed(chain) if one.accepted is not None)
    return ("whole", last.reference, chain[-1].table.key)


def asked_of_all_recordings(first: Round) -> tuple[str, ...]:
    """What stands for the base model of the round `first`, refitted to all recordings."""
    return ("all recordings", first.table.key)


def asked_of_move(
    move: str, chain: Sequence[Round], place: int, number: int | None = None
) -> tuple[str, ...]:
    """What stands for a `move` at the `place` of the `chain`, and its step of this `number`."""
    steps = () if number is None else (str(number),)
    return (move, str(place), *steps, *(one.reference for one in chain))


def asked_of_rebuilt(
    chain: Sequence[Round], place: int, number: int, swap: ComparisonTable
) -> tuple[str, ...]:
    """What stands for the effect of this `number` of the `chain` without the one at the `place`, with its rivals, after
    the table `swap`."""
    kept = [one for other, one in enumerate(chain) if other != place]
    return ("rebuilt", swap.key, str(number), *kept[number].rivals)
