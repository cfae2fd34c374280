"""Errors 0.1 s ahead on held-out recordings: which of two models has the smaller ones."""

import numpy as np
import pytest

from frictionjax.diagnosis.evidence.ahead import lead_ahead, typical_error

DT = np.array([0.01, 0.02])


def _noise(seed, samples=2000):
    return np.random.default_rng(seed).standard_normal((2, samples))


def test_errors_that_are_larger_everywhere_trail_by_the_logarithm_of_their_ratio():
    before = _noise(1)
    lead = lead_ahead(before, 2.0 * before, DT)
    # 0.5 s are 50 samples of one recording and 25 of the other.
    assert lead.clusters == 40 + 80
    assert lead.total == pytest.approx(-120 * np.log(2.0))


def test_a_few_samples_at_which_a_motion_is_unstable_do_not_decide():
    """Noise grows there to a thousand times: in a mean square they would outweigh all that is better elsewhere."""
    before, after = _noise(1), 0.7 * _noise(2)
    after[:, 100:110] *= 1000.0
    assert np.mean(after**2) > np.mean(before**2)
    lead = lead_ahead(before, after, DT)
    assert lead.total > 3.0 * lead.error > 0.0


def test_chance_alone_leads_by_no_more_than_its_error():
    lead = lead_ahead(_noise(1), _noise(2), DT)
    assert abs(lead.total) < 3.0 * lead.error


def test_what_is_not_there_or_overflows_on_both_sides_counts_for_nothing():
    before, after = _noise(1), 2.0 * _noise(1)
    before[1], after[1] = np.nan, np.nan
    before[0, :50], after[0, :50] = np.inf, np.inf
    lead = lead_ahead(before, after, DT)
    assert lead.clusters == 39 and lead.total == pytest.approx(-39 * np.log(2.0))
    before[0, 50:100] = 1.0
    after[0, 50:100] = np.inf
    assert lead_ahead(before, after, DT).total < lead.total


def test_a_typical_error_is_that_of_most_of_the_time():
    errors = np.full((2, 1000), np.nan)
    errors[0], errors[1, :500] = 2.0, 2.0
    assert typical_error(errors, DT) == pytest.approx(2.0)
    # One of 20 + 20 clusters in which a motion is unstable; the root mean square is 158 times as large.
    errors[0, :50] = 2000.0
    assert typical_error(errors, DT) == pytest.approx(2.0 * 1000.0 ** (1 / 40))
    errors[0, :50] = np.inf
    assert np.isfinite(typical_error(errors, DT))
