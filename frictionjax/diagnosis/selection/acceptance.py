"""Acceptance: which candidate of a table enters the model, as a function of the table and the rule alone."""

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round, dropping
from frictionjax.diagnosis.table import Comparison, Table, whole_misfits, within

_NOT_COMPLETE = "the named effects explain nearly all; this one explains too little of the rest"


def acceptable(row: Comparison, rule: Rule) -> tuple[bool, str]:
    """Whether the candidate of a `row` may be named by the `rule`, and if not, why not.

    Where its score test is not significant, a clear lead of the refit is, and so is a refit that brings the held-out
    recordings, which no fit used, to the noise or most of the way there: what acts in a few seconds of many has few
    clusters to be tested in. What is periodic along the stroke must be recorded to repeat in it. What the fitted
    recordings do not ask for is not named, though held-out ones be predicted better with it: that is where their own
    deflections came to rest.
    """
    gains, limits = row.gains(rule), rule.accept
    if not gains.repeats:
        return False, "its period is too long to be seen to repeat along the stroke"
    if gains.lead_fit < 0.0:
        return False, "the recordings that it is fitted to are explained no better with it"
    if not clear(row, rule):
        return False, f"not significant (p = {row.p_value:.2g})"
    if gains.share > limits.least_share or row.makes_credible:
        return True, ""
    if far_from_noise(row, rule) and gains.energy > limits.least_energy and gains.share > 0.0:
        return True, ""
    explained = f"{100 * gains.share_fit:.0f} % on the fit, {100 * gains.share_holdout:.0f} % on the held-out"
    return False, f"explains too little ({explained} recordings)"


def far_from_noise(row: Comparison, rule: Rule) -> bool:
    """Whether the model without the candidate is so far from the noise that shares of the power count."""
    return min(row.misfits_before) > rule.accept.far_from_noise


def clear(row: Comparison, rule: Rule) -> bool:
    """Whether chance does not do what the candidate of a `row` does, by the `rule`."""
    gains, limits = row.gains(rule), rule.accept
    leads = (
        gains.lead_holdout > limits.lead_holdout and gains.lead_fit + gains.lead_holdout > limits.lead_both
    )
    return row.p_value <= limits.significance or leads or _removes_the_mismatch(row, rule)


def _removes_the_mismatch(row: Comparison, rule: Rule) -> bool:
    """Whether the candidate is adequate on fit and held-out recordings, or explains most of the misfit there, and the
    model without it was not adequate on the held-out ones, which no fit used: by more than chance adds there."""
    gains, adequate = row.gains(rule), rule.limits.adequate
    wholes = whole_misfits(row.misfits_before, rule)
    left = [
        whole * (1.0 - share)
        for whole, share in zip(wholes, (gains.share_fit, gains.share_holdout), strict=True)
    ]
    before = within(row.misfits_before, row.misfit_errors, adequate, rule)
    return not before[1] and (max(left) < adequate or gains.share > rule.accept.decisive_share)


def ranked(table: Table, rule: Rule) -> list[int]:
    """The rows of the `table`, the one that explains most first, by the `rule`."""
    return sorted(range(len(table.rows)), key=lambda row: -table.rows[row].gains(rule).worth)


def choose(table: Table, rule: Rule) -> Round:
    """The round in which the best acceptable candidate of the `table` is accepted, by the `rule`.

    What another candidate explains far better is not accepted, even if that one is refused. Of two that explain alike
    the one with fewer parameters is: a sine bends to a spring, not the reverse; of those with as many, the likelier one
    on all recordings.
    """
    order = ranked(table, rule)
    worth = [row.gains(rule).worth for row in table.rows]
    most = max(worth, default=0.0)
    may = [
        row
        for row in order
        if worth[row] > most - rule.accept.behind_best and acceptable(table.rows[row], rule)[0]
    ]
    if not may:
        return Round(table, None)
    least = worth[may[0]] - rule.accept.alike
    accepted = min(
        (row for row in may if worth[row] > least),
        key=lambda row: (table.rows[row].free, -_gain(table.rows[row])),
    )
    name = table.rows[accepted].effect
    rivals = {
        table.rows[row].effect
        for row in may
        if table.rows[row].effect != name and table.lead(accepted, row, rule) < rule.rivals.lead
    }
    return Round(table, accepted, tuple(sorted(rivals)))


def _gain(row: Comparison) -> float:
    """Gain of the log-likelihood over the model without the candidate of the `row`, on all recordings."""
    return row.fit.total + row.held_out.total


def best_clear(table: Table, rule: Rule) -> int | None:
    """The best candidate of the `table` that chance does not bring, although it explains too little alone: of two
    effects of one size neither may explain half. None where no candidate is clear, or promises anything."""
    for row in ranked(table, rule):
        gains = table.rows[row].gains(rule)
        promising = gains.share > 0.0 and gains.worth > rule.accept.promising
        if promising and clear(table.rows[row], rule):
            return row
    return None


def only_complete(found: Round, rule: Rule) -> Round:
    """The round `found`, with nothing accepted unless it explains nearly all of what was left, by the `rule`."""
    if found.accepted is None or found.row.gains(rule).share > rule.accept.enough_share:
        return found
    return dropping(found, _NOT_COMPLETE)


def nearly_all(whole: Comparison, rule: Rule) -> bool:
    """Whether what was accepted, compared with the base model in `whole`, explains nearly all: of the misfit or, far
    from the noise, of the power."""
    gains, enough = whole.gains(rule), rule.accept.enough_share
    return gains.share > enough or (far_from_noise(whole, rule) and gains.energy > enough)
