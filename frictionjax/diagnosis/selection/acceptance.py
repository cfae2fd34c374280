"""Acceptance: which candidate of a table enters the model, as a function of the table and the rule alone."""

from collections.abc import Collection

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round, dropping
from frictionjax.diagnosis.table import ComparisonTable, Lead, ModelComparison, within

_NOTHING_LACKS = "the model without it is adequate, without any allowance for chance"
_NOT_COMPLETE = "what is named explains nearly all of the misfit; of the rest this effect explains too little"


def acceptable(row: ModelComparison, rule: Rule, *, least_share: float = 0.0) -> tuple[bool, str]:
    """Whether the candidate of a `row` may enter the model by the `rule`, and if not, why not.

    The model with it must be clearly likelier on all recordings, and likelier on those that it was fitted to and on the
    held-out ones, which determined nothing of it. What is periodic along the stroke must be recorded to repeat in it.
    Beside other names, or where the model without it is adequate, it must explain at least a `least_share` of the
    misfit (`least_share_of`).
    """
    gains = row.gains(rule)
    if not gains.repeats:
        return False, "its period is too long to repeat along the recorded stroke"
    if not likelier(row, rule):
        said = ", ".join(
            f"{_nats(lead)} on the {where}"
            for lead, where in ((row.fit, "fit"), (row.held_out, "held-out recordings"))
        )
        return False, f"not clearly likelier (log-likelihood {said})"
    if gains.share > least_share or least_share == 0.0 or row.makes_credible:
        return True, ""
    explained = f"{100 * gains.share_fit:.0f} % on the fit, {100 * gains.share_holdout:.0f} % on the held-out"
    return False, f"explains too little ({explained} recordings)"


def _nats(lead: Lead) -> str:
    return f"{lead.total:+.3g} ± {lead.error:.2g}"


def likelier(row: ModelComparison, rule: Rule) -> bool:
    """Whether chance does not do what the candidate of a `row` does, by the `rule`: it leads by so many standard errors
    on both sets of recordings together, and by some on the fitted and on the held-out ones alone."""
    gains = row.gains(rule)
    each = min(gains.lead_fit, gains.lead_holdout)
    return bool(gains.lead > rule.accept.lead and each > rule.accept.lead_each)


def least_share_of(table: ComparisonTable, rule: Rule) -> float:
    """Share of the misfit that a candidate of the `table` must explain, by the `rule`: none where it is the first name
    of a model that misses something, and nearly all where the model without it is adequate, as what it left would
    otherwise count as unknown."""
    if all(within(table.misfits, table.misfit_errors, rule.limits.adequate, rule)):
        return rule.accept.enough_share
    return 0.0 if table.is_first else rule.accept.least_share


def explains_enough(whole: ModelComparison, rule: Rule) -> bool:
    """Whether what was found, compared with the base model in `whole`, explains enough to be named at all, by the
    `rule`: of the misfit or, since far from the noise the misfit is a logarithm, of the power."""
    gains = whole.gains(rule)
    return (
        gains.share > rule.accept.least_share
        or gains.energy > rule.accept.enough_share
        or whole.makes_credible
    )


def predicts_ahead(row: ModelComparison) -> bool:
    """Whether the model of a `row` predicts held-out positions 0.1 s ahead at least as well as the one without its last
    effect.

    Innovations are those of an observer, sample by sample, and an effect can make them smaller by what it does to the
    observer, or by following the colour of a sensor's noise. What is there is predicted farther ahead, too.
    """
    return row.ahead is None or row.ahead.total >= 0.0


def ranked(table: ComparisonTable, rule: Rule) -> list[int]:
    """The rows of the `table`, the one that explains most first, by the `rule`."""
    return sorted(range(len(table.rows)), key=lambda row: -table.rows[row].gains(rule).worth)


def choose(table: ComparisonTable, rule: Rule, refused: Collection[int] = ()) -> Round:
    """The round in which the likeliest acceptable candidate of the `table` is accepted, by the `rule`: that with the
    largest gain of the log-likelihood over all recordings, less one for each parameter (Akaike). Rows that were
    `refused` are left out. A model whose misfits are adequate without any allowance for chance lacks nothing."""
    if max(table.misfits) <= rule.limits.adequate:
        return dropping(Round(table, None), _NOTHING_LACKS)
    least = least_share_of(table, rule)
    rows = [(row, own) for row, own in enumerate(table.rows) if row not in refused]
    may = [row for row, own in rows if acceptable(own, rule, least_share=least)[0]]
    if not may:
        return Round(table, None)
    accepted = max(may, key=lambda row: gain_of(table.rows[row]))
    name = table.rows[accepted].effect
    rivals = {
        table.rows[row].effect
        for row in may
        if table.rows[row].effect != name and table.lead(accepted, row, rule) < rule.rivals.lead
    }
    return Round(table, accepted, tuple(sorted(rivals)))


def gain_of(row: ModelComparison) -> float:
    """Gain of the log-likelihood on all recordings over the model without the candidate of the `row`, less one for each
    of its parameters."""
    return row.fit.total + row.held_out.total - row.free


def best_likelier(table: ComparisonTable, rule: Rule) -> int | None:
    """The likeliest candidate of the `table` that chance does not bring, although it explains too little alone; None
    where there is none."""
    clear = [row for row, own in enumerate(table.rows) if likelier(own, rule) and own.gains(rule).share > 0.0]
    return max(clear, key=lambda row: gain_of(table.rows[row]), default=None)


def only_complete(found: Round, rule: Rule) -> Round:
    """The round `found`, with nothing accepted unless it explains nearly all of what was left, or leaves an adequate
    model, by the `rule`."""
    if found.accepted is None or found.row.gains(rule).share > rule.accept.enough_share:
        return found
    row = found.row
    complete = all(within(row.misfits_after, row.misfit_errors, rule.limits.adequate, rule))
    return found if complete else dropping(found, _NOT_COMPLETE)
