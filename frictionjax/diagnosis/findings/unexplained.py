"""What remains beyond what was named: how much, where, and on what it depends."""

from frictionjax.diagnosis.findings.residual_map import ResidualModel
from frictionjax.diagnosis.mismatch_map.where_words import strongest
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.search import Decision
from frictionjax.diagnosis.verdict import MismatchBin, Unexplained


def unexplained_of(
    decision: Decision,
    bins: tuple[MismatchBin, ...],
    residual: ResidualModel | None,
    *,
    rule: Rule = Rule(),
) -> Unexplained:
    """What remains by the `decision`: whether it is significant and its share, in which regime, and over which variable
    a map of it predicts held-out recordings."""
    present, share = decision.remains, decision.share
    regimes = [b for b in bins if b.axis == "regime"]
    if decision.verdict == "unknown" and residual is None:
        place = strongest(bins, "regime", rule=rule)
    else:
        place = max(regimes, key=lambda b: b.count * max(b.excess_extended - 1.0, 0.0), default=None)
    where = place.bin if place is not None and present else ""
    if residual is None:
        return Unexplained(present, share, where)
    strong = strongest(bins, "regime", rule=rule)
    where = strong.bin if strong is not None else where
    variable = residual.variable if residual.helps else ""
    if variable:
        where = f"{where}; carried by {variable}"
    return Unexplained(
        present, share, where, variable, residual.row.gains(rule).share_holdout if variable else 0.0
    )
