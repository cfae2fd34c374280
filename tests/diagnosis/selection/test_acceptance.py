"""Acceptance: which candidate of a table enters the model."""

import dataclasses

import numpy as np
import pytest
from helpers_rule import candidate, table

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import acceptable, choose, least_share_of, likelier
from frictionjax.diagnosis.table import Lead

RULE = Rule()
LEAST_SHARE, LEAD, EACH = RULE.accept.least_share, RULE.accept.lead, RULE.accept.lead_each


@pytest.mark.parametrize("p_value", [1e-9, 1.0])
def test_what_the_fitted_recordings_do_not_ask_for_is_not_named(p_value):
    """Of a misfit below the floor a share is no number to go by: held-out recordings alone would name it."""
    shares, known = (1.73, 0.83), {"before": (-0.0076, 0.063), "p_value": p_value}
    assert acceptable(candidate(shares, leads=(2.1, 3.0), **known), RULE)[0]
    may, why = acceptable(candidate(shares, leads=(-2.1, 3.0), **known), RULE)
    assert (
        not may
        and why
        == "not clearly likelier (log-likelihood -2.1 ± 1 on the fit, +3 ± 1 on the held-out recordings)"
    )


def test_beside_others_a_candidate_must_explain_much_of_fit_and_held_out_recordings():
    def may(shares, least_share=LEAST_SHARE, **more):
        return acceptable(candidate(shares, **more), RULE, least_share=least_share)

    enough = LEAST_SHARE + 0.01
    assert may((0.9, 0.8)) == may((enough, enough)) == (True, "")
    for shares in ((0.9, LEAST_SHARE - 0.01), (LEAST_SHARE - 0.01, 0.9), (0.9, -0.5)):
        expected = f"({100 * shares[0]:.0f} % on the fit, {100 * shares[1]:.0f} % on the held-out recordings)"
        assert may(shares) == (False, f"explains too little {expected}")
        # The first name need not, nor what makes a model of none.
        assert may(shares, 0.0)[0] and may(shares, makes_credible=True)[0]


def test_only_where_a_first_name_is_looked_for_it_need_not_explain_much():
    found = candidate((0.2, 0.2))
    first, second = ("candidates", "0"), ("candidates", "1", "t0.0")
    assert least_share_of(table(found, asked=first), RULE) == 0.0
    assert least_share_of(table(found, asked=second), RULE) == LEAST_SHARE
    adequate = table(found, asked=first, misfits=(0.004, 0.004))
    assert least_share_of(adequate, RULE) == RULE.accept.enough_share
    assert [choose(table(found, asked=asked), RULE).accepted for asked in (first, second)] == [0, None]
    assert choose(adequate, RULE).accepted is None


def test_a_candidate_must_be_likelier_on_all_recordings_and_on_both_sets():
    over, under = EACH + 0.1, EACH - 0.1
    both = LEAD / np.sqrt(2.0)
    for leads, enough in (
        ((both + 0.1, both + 0.1), True),
        ((both - 0.1, both - 0.1), False),
        ((over, 9.0), True),
        ((9.0, over), True),
        ((under, 9.0), False),
        ((9.0, under), False),
    ):
        assert likelier(candidate((0.9, 0.55), leads=leads), RULE) == enough
        assert acceptable(candidate((0.9, 0.55), leads=leads, p_value=1.0), RULE)[0] == enough


@pytest.mark.parametrize("noisy", ["fit", "held_out"])
def test_a_noisy_set_of_recordings_does_not_hide_what_the_other_shows(noisy):
    quiet = candidate((0.9, 0.9), leads=(LEAD, LEAD))
    loud = Lead(100.0 * 1.5 * EACH, 100.0, 100)
    assert likelier(dataclasses.replace(quiet, **{noisy: loud}), RULE)


@pytest.mark.parametrize(("factor", "accepted"), [(0.95, None), (1.05, 0)])
def test_a_model_that_is_adequate_without_allowing_for_chance_lacks_nothing(factor, accepted):
    low = (factor * RULE.limits.adequate, 0.0)
    found = candidate((1.0, 1.0), before=low)
    chosen = choose(table(found, misfits=low, misfit_errors=(1.0, 1.0)), RULE)
    assert chosen.accepted == accepted and ("is adequate" in chosen.dropped) == (accepted is None)


def test_too_few_clusters_show_nothing():
    few = Lead(9.0, 1.0, RULE.accept.least_clusters - 1)
    for lead in ("fit", "held_out"):
        assert not likelier(dataclasses.replace(candidate((0.9, 0.9), leads=(9.0, 9.0)), **{lead: few}), RULE)


def test_of_those_that_may_be_accepted_the_likeliest_is_but_for_its_parameters():
    rich, plain = candidate((0.2, 0.2), leads=(50.0, 50.0)), candidate((0.9, 0.9), leads=(49.0, 49.0))
    lead = ((0, 1, Lead(1.0, 1.0, 9)),)
    for free, first in ((7, 0), (8, 0), (10, 1)):
        both = table(
            dataclasses.replace(rich, free=free, effect="rich"),
            dataclasses.replace(plain, free=7),
            between=lead,
        )
        found = choose(both, RULE)
        assert found.accepted == first and len(found.rivals) == 1


def test_what_is_periodic_must_be_seen_to_repeat():
    for wave, enough in (
        ((0.9, False), False),
        ((1.1, False), True),
        ((1.9, True), False),
        ((2.1, True), True),
    ):
        may, why = acceptable(candidate((0.95, 0.95), waves=(wave,)), RULE)
        assert may == enough
        assert why == ("" if enough else "its period is too long to repeat along the recorded stroke")
