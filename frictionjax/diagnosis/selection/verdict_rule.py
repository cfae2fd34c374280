"""The verdict: how little the named effects must leave, or else it is `unknown`."""

from collections.abc import Sequence

import numpy as np

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.table import ModelComparison, within
from frictionjax.diagnosis.verdict import Verdict


def most_left(exact: Sequence[bool], *, rule: Rule = Rule()) -> float:
    """Share of the misfit that accepted effects may leave together, and still be the name of what is missing.

    A delay is the same on every machine: what it leaves is something else. An equation of creep or of hysteresis is an
    approximation, and what it leaves may be no more than that. Several effects have more ways to stand in for another.

    **Arguments:** `exact`, of each effect whether its equation is exact; the `rule`.
    """
    limits = rule.limits
    if len(exact) == 1:
        return limits.one_exact if all(exact) else limits.one
    return limits.several_exact if all(exact) else limits.several


def adequate(misfits: tuple[float, float], errors: tuple[float, float], rule: Rule) -> bool:
    """Whether a model with these `misfits`, which chance may raise by some of these standard `errors`, is at the noise
    on fit and held-out recordings, by the `rule`."""
    return all(within(misfits, errors, rule.limits.adequate, rule))


def verdict_of(
    chain: Sequence[Round], whole: ModelComparison | None, *, rule: Rule = Rule()
) -> tuple[Verdict, tuple[bool, float]]:
    """`adequate` when the base model is at the noise on fit and held-out recordings, with its parameters as they were
    fitted or with those of all recordings together; `named` when what was accepted explains enough of the whole, or
    leaves nothing significant; else `unknown`. Then whether something significant is left, and its share.

    **Arguments:** the `chain` of rounds; `whole`, the last accepted model against the base model, None where nothing
    was accepted; the `rule`.
    """
    if whole is None:
        table = chain[0].table
        if chain[0].together or adequate(table.misfits, table.misfit_errors, rule):
            return "adequate", (False, 0.0)
        return "unknown", (True, 1.0)
    share = float(np.clip(1.0 - whole.gains(rule).share, 0.0, 1.0))
    most = rule.limits.remains * rule.limits.adequate
    remains = not all(within(whole.misfits_after, whole.misfit_errors, most, rule))
    if share < most_left(whole.exact, rule=rule) or not remains:
        return "named", (remains, share)
    return "unknown", (True, share)
