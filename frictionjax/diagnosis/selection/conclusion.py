"""The last word: the verdict once a free force and a map over the position were tried beside what was accepted."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round, dropping
from frictionjax.diagnosis.selection.search import Decision, decision_of
from frictionjax.diagnosis.selection.verdict_rule import most_left
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison, table_of_one
from frictionjax.physics.effects import catalogue

CEILING, SHAPE, INSTEAD = "ceiling", "shape", "instead"
"""What is tried once the search has ended. Beside the last model: a force that is free; a map over the position beside
a force of the position. And such a map instead of an effect that was named after that force."""
_OTHER_SHAPE = "less likely than another shape of {}: a map of its force over the position explains more"


def asked_afterwards(tried: str, chain: Sequence[Round]) -> tuple[str, ...]:
    """What stands, among the tables of a diagnosis, for what was `tried` beside the last model of the `chain`."""
    return (tried, *(one.reference for one in chain if one.accepted is not None))


def tables_of(
    afterwards: Mapping[str, ModelComparison | None], chain: Sequence[Round]
) -> Iterator[ComparisonTable]:
    """What was tried `afterwards` beside the last model of the `chain`, as tables that are stored."""
    own = chain[-1].table
    for tried, row in afterwards.items():
        if row is not None:
            asked = asked_afterwards(tried, chain)
            yield table_of_one(tried, asked, row, chaotic=row.chaotic, imposed=own.imposed)


def beside_a_map(
    decision: Decision, tried: Callable[[Sequence[Round]], ComparisonTable | None], rule: Rule
) -> Decision:
    """The `decision`, or one without the names that stand in for another shape of a force of the position.

    Gravity on a linkage is a pendulum, and beside that whatever imitates the rest: a dead zone, a spring. So each
    effect that was named after a force of the position is compared with a map over the position in its place, and is
    dropped, with all that was named after it, where the map is clearly likelier by the `rule`, less one nat for each
    parameter that it has more (Akaike).

    **Arguments:** `tried`, what gives the table of such a comparison for the last name of a chain, as `table_of_map`
    makes it; None where there is none.
    """
    chain = [one for one in decision.rounds if one.accepted is not None]
    for place in range(1, len(chain)):
        forces = [one.row.effect for one in chain[:place] if _is_of_position(one.row.effect)]
        table = tried(chain[: place + 1]) if forces else None
        if table is None:
            continue
        mapped, named, before = table.rows
        lead = mapped.lead_over(named)
        fair = dataclasses.replace(lead, total=lead.total - (mapped.free - named.free))
        if fair.in_errors(rule) > rule.rivals.lead:
            why = _OTHER_SHAPE.format(", ".join(forces))
            return decision_of([*chain[:place], dropping(chain[place], why)], before, rule)
    return decision


def table_of_map(
    chain: Sequence[Round], mapped: ModelComparison, named: ModelComparison, before: ModelComparison
) -> ComparisonTable:
    """A map over the position instead of the last effect of the `chain`, as a table that is stored.

    **Arguments:** each model against the base model: with the map, `mapped`; with the effect, `named`; without both,
    `before`.
    """
    table = table_of_one(
        INSTEAD,
        asked_afterwards(INSTEAD, chain),
        mapped,
        chaotic=named.chaotic,
        imposed=chain[-1].table.imposed,
    )
    return dataclasses.replace(table, rows=(mapped, named, before))


def _is_of_position(effect: str) -> bool:
    return catalogue()[effect][0].about.of_position


def below_ceiling(decision: Decision, free: ModelComparison | None, rule: Rule) -> Decision:
    """The `decision`, or `unknown` where it was `adequate` and a force that is `free` predicts better, by the `rule`.

    **Arguments:** `free`, the model with the free force against the one without it; None where it was not tried.
    """
    if decision.verdict == "adequate" and free is not None and is_above(free, rule):
        return dataclasses.replace(decision, verdict="unknown", remains=True, share=1.0)
    return decision


def is_above(free: ModelComparison, rule: Rule) -> bool:
    """Whether the model with a `free` force predicts held-out recordings better than the one without it: by more than
    chance, and by what matters, by the `rule`."""
    drop = free.misfits_before[1] - free.misfits_after[1]
    return free.held_out.in_errors(rule) > rule.ceiling.lead and drop > rule.limits.adequate


def of_another_shape(decision: Decision, mapped: ModelComparison | None, rule: Rule) -> Decision:
    """The `decision`, or `named` where it was `unknown`, a force of the position was accepted, and a map over the
    position beside it leaves little enough for a name, by the `rule`.

    A spring may harden, and a linkage moves its weight along another curve than a pendulum: what is missing is named,
    and its equation is an approximation.

    **Arguments:** `mapped`, the model with that map against the base model; None where there is no such map.
    """
    if decision.verdict != "unknown" or mapped is None:
        return decision
    exact = [one.row.exact[-1] for one in decision.rounds if one.accepted is not None]
    share = float(np.clip(1.0 - mapped.gains(rule).share, 0.0, 1.0))
    if not share < most_left(exact, rule=rule):
        return decision
    return dataclasses.replace(decision, verdict="named", remains=False, share=share)
