"""The last word: the verdict once a free force and a map over the position were tried beside what was accepted."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Decision
from frictionjax.diagnosis.selection.verdict_rule import most_left
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison, table_of_one

CEILING, SHAPE = "ceiling", "shape"
"""What is tried beside the last model once the search has ended: a force that is free; a map over the position beside a
force of the position."""


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
