"""The level sweep: the independently computed numbers, the way back to sigma0, and the noise that it applies."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import TABLE_I

from frictionjax import InputError, level_sweep
from frictionjax.studies.level_sweep import Setting, noise, table_one

MODULE = sys.modules[level_sweep.__module__]  # the verb of the same name hides it
LOW_FREQUENCY = {
    "prbs": {0.02: 9.92e4, 0.10: 9.44e4, 0.26: 7.32e4},
    "gaussian": {0.02: 9.92e4, 0.10: 9.46e4, 0.26: 7.44e4},
}
FITTED = {
    "prbs": {0.02: 9.93e4, 0.10: 9.48e4, 0.26: 7.77e4},
    "gaussian": {0.02: 9.93e4, 0.10: 9.51e4, 0.26: 7.88e4},
}
"""Means of three records of an independent simulation of Table I with the paper's estimator, N/m."""


@pytest.fixture(scope="module")
def sweep():
    return level_sweep(levels=[0.02, 0.05, 0.1, 0.15, 0.2, 0.26], seeds=2, averages=30)


@pytest.mark.parametrize("kind", ["prbs", "gaussian"])
def test_the_independent_numbers_are_met_within_three_percent(sweep, kind):
    for quantity, numbers in (("stiffness", FITTED), ("low_frequency_stiffness", LOW_FREQUENCY)):
        mean = dict(zip(sweep.levels, sweep.mean(kind, quantity), strict=True))
        for level, number in numbers[kind].items():
            assert mean[level] == pytest.approx(number, rel=0.03)


@pytest.mark.parametrize("kind", ["prbs", "gaussian"])
def test_zero_amplitude_gives_sigma0_where_the_paper_is_a_fifth_off(sweep, kind):
    assert sweep.true_stiffness == pytest.approx(1e5, rel=1e-12)
    assert sweep.mean(kind)[-1] < 0.81e5
    found = sweep.zero_amplitude(kind).stiffness
    assert found.value == pytest.approx(1e5, rel=0.02)
    assert abs(found.value - 1e5) < 3.0 * found.stderr
    alone = sweep.zero_amplitude(kind, seed=0).stiffness
    assert alone.value == pytest.approx(1e5, rel=0.02)
    assert sweep.zero_amplitude(kind, upto=0.1).highest <= 0.1


def test_stiffness_and_coherence_fall_with_the_level_and_damping_rises(sweep):
    for kind in sweep.excitations:
        assert np.all(np.diff(sweep.mean(kind)) < 0.0)
        assert np.all(np.diff(sweep.mean(kind, "coherence")) < 0.0)
        assert np.all(np.diff(sweep.mean(kind, "damping")) > 0.0)
        assert sweep.mean(kind, "inertia")[0] == pytest.approx(1.0, rel=0.005)
        assert sweep.mean(kind, "damping")[0] == pytest.approx(1e5**0.5 + 0.4, rel=0.02)


def test_the_table_has_a_row_for_each_excitation_and_level(sweep):
    rows = sweep.table()
    assert len(rows) == 12
    assert all(np.isfinite([v for v in row.values() if not isinstance(v, str)]).all() for row in rows)
    assert rows[7]["excitation"] == "gaussian" and rows[7]["stiffness"] == sweep.mean("gaussian")[1]


@pytest.mark.parametrize("is_binary", [True, False])
def test_the_noise_ends_at_its_bandwidth_and_has_its_rms(getkey, is_binary):
    setting = Setting(20_000, 1024, 10_000.0, 500.0, (3.0, 150.0), (3.0, 8.0))
    u = np.asarray(noise(getkey(), jnp.asarray(0.3), jnp.asarray(is_binary), setting))
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.3, rel=1e-9)
    power = np.abs(np.fft.rfft(u)) ** 2
    frequency = np.fft.rfftfreq(u.size, 1e-4)
    assert power[frequency > 500.5].max() < 1e-20 * power.max()
    # Half of all the power lies in the lower half of the band for flat noise, more for held binary noise.
    share = power[frequency <= 250.0].sum() / power.sum()
    assert (share > 0.52) if is_binary else abs(share - 0.5) < 4.0 / np.sqrt(2 * 1000)


def test_parts_and_motor_constants_change_nothing(monkeypatch):
    settings = {"levels": [0.05, 0.3], "seeds": 2, "averages": 2}
    reported = []
    whole = level_sweep(**settings, progress=lambda stage, part: reported.append(part))
    assert reported == [1.0]
    monkeypatch.setattr(MODULE, "CHUNK", 3)
    by_volts = type(TABLE_I)(TABLE_I.J, TABLE_I.friction, 16.0)
    parts = level_sweep(by_volts, **settings, progress=lambda stage, part: reported.append(part))
    assert reported == pytest.approx([1.0, 1 / 3, 2 / 3, 1.0])
    for name in ("stiffness", "low_frequency_stiffness", "damping", "inertia", "coherence"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-6)


def test_table_one_is_the_paper_s():
    assert jax.tree.map(float, table_one()) == jax.tree.map(float, TABLE_I)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"levels": [0.0, 0.1]}, "`levels` must be positive"),
        ({"seeds": 1}, r"`seeds` is 1.*one record has no spread"),
        ({"averages": 1}, "`averages` is 1"),
        ({"low_band": (3.0, 3.5)}, r"`low_band` from 3.0 to 3.5 Hz contains 0 bins\. Widen it"),
    ],
)
def test_bad_settings_get_a_sentence(arguments, sentence):
    with pytest.raises(InputError, match=sentence):
        level_sweep(**arguments)


def test_unknown_excitations_and_too_few_levels_get_a_sentence(sweep):
    with pytest.raises(InputError, match=r"there is no excitation 'sine'\. Choose one of prbs, gaussian"):
        sweep.mean("sine")
    with pytest.raises(InputError, match=r"2 of the levels lie below 0\.05"):
        sweep.zero_amplitude("prbs", upto=0.05)
