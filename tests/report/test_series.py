"""Long series made short, and the window worth a closer look."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis, fake_recording

from frictionjax.report.series import envelope, holdout_first, is_extended, limits, zoom


def test_an_envelope_keeps_every_extreme():
    y = np.random.default_rng(0).standard_normal(50_001)
    y[31_234], y[17] = 9.0, -8.0
    t = np.arange(y.size) / 1000.0
    short_t, short_y = envelope(t, y, columns=700)
    assert short_t.shape == short_y.shape
    assert short_t.size <= 2 * 701
    assert (short_y.max(), short_y.min()) == (9.0, -8.0)
    assert abs(short_t[short_y.argmax()] - 31.234) < 0.08
    assert np.all(np.diff(short_t) >= 0)


def test_a_short_series_is_left_as_it_is():
    t = np.arange(100.0)
    assert envelope(t, t)[1] is t


def test_a_gap_stays_a_gap():
    y = np.ones(10_000)
    y[2000:4000] = np.nan
    y[7000] = np.nan
    short_t, short_y = envelope(np.arange(10_000.0), y, columns=100)
    inside = (short_t >= 2000) & (short_t < 4000)
    assert np.isnan(short_y[inside]).all()
    assert np.isfinite(short_y[~inside]).all()


def test_the_close_up_is_where_the_extension_helps_most():
    recording = fake_recording(n=10_000)
    window = zoom(recording)
    assert window.stop - window.start == 500
    assert window.start <= 6300 <= window.stop + 250
    nearer = replace(recording, residual_force_extended=recording.residual_force)
    # Nothing is improved: the largest residual is shown.
    assert abs(zoom(nearer).start - window.start) < 300


@pytest.mark.parametrize("n", [1, 7, 99, 101])
def test_the_close_up_of_a_short_recording_is_all_of_it(n):
    recording = fake_recording(n=200)
    series = {name: value[:n] for name, value in vars(recording).items() if np.ndim(value) == 1}
    window = zoom(replace(recording, **series))
    assert 0 <= window.start < window.stop <= n
    assert window.stop - window.start == min(n, 100)


def test_a_deviation_of_zero_or_infinity_does_not_choose_the_close_up():
    recording = fake_recording(n=10_000)
    std = recording.residual_force_std.copy()
    std[:100], std[9000:] = 0.0, np.inf
    assert abs(zoom(replace(recording, residual_force_std=std)).start - zoom(recording).start) < 50


def test_limits_hold_what_is_finite():
    low, high = limits(np.array([np.nan, 1.0]), np.array([3.0, -np.inf]), margin=0.0)
    assert (low, high) == (1.0, 3.0)
    low, high = limits(np.array([np.nan]))
    assert low < high
    low, high = limits(np.array([5.0, 5.0]))
    assert low < 5.0 < high


def test_order_and_extension():
    fitted, held_out = fake_recording("a", role="fit"), fake_recording("b")
    assert [recording.name for recording in holdout_first((fitted, held_out))] == ["b", "a"]
    assert is_extended(fake_diagnosis(n=200))
    same = replace(fitted, predicted_extended=fitted.predicted_base)
    assert not is_extended(replace(fake_diagnosis(n=200), recordings=(same,)))
    assert not is_extended(adequate_diagnosis())
