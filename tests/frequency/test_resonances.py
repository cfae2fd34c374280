"""Resonance and antiresonance are read between the lines, and from a real bench."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from frictionjax.core import InputError
from frictionjax.frequency import best_linear_approximation, estimate_frf, resonances

BENCH = Path(__file__).parents[3] / "shared" / "real" / "motor_bench"


def _two_inertias(f, antiresonance, resonance, damping=0.02):
    """Speed of a motor that a flexible coupling ties to a load, behind a delay."""
    s = 2j * np.pi * f
    wa, wr = 2.0 * np.pi * antiresonance, 2.0 * np.pi * resonance
    response = (s**2 + 2.0 * damping * wa * s + wa**2) / (s**2 + 2.0 * damping * wr * s + wr**2) / (s + 5.0)
    return response * np.exp(-2e-3 * s)


@pytest.mark.parametrize("spacing", [0.5, 1.0, 4.0])
@pytest.mark.parametrize(("antiresonance", "resonance"), [(53.4, 76.4), (50.0, 70.0), (76.4, 53.4)])
def test_both_are_found_between_the_lines(spacing, antiresonance, resonance):
    f = np.arange(13.0, 250.0, spacing)
    found = resonances(f, _two_inertias(f, antiresonance, resonance))
    # A twentieth of the spacing, plus what the slope of the rest does to lines four spacings away.
    assert found.resonance == pytest.approx(resonance, abs=0.05 * spacing + 0.1)
    assert found.antiresonance == pytest.approx(antiresonance, abs=0.05 * spacing + 0.1)
    assert found.resonance_damping == pytest.approx(0.02, abs=0.004)
    assert found.antiresonance_damping == pytest.approx(0.02, abs=0.004)


def test_noise_moves_them_little_and_the_band_chooses():
    f = np.arange(10.0, 200.0)
    response = _two_inertias(f, 50.0, 70.0) * (1.0 + 3.0 / (1.0 - (f / 150.0) ** 2 + 0.02j * f / 150.0))
    rng = np.random.default_rng(0)
    for _ in range(20):
        noise = 1.0 + 0.01 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        assert resonances(f, response * noise, band=(40.0, 90.0)).resonance == pytest.approx(70.0, abs=0.5)
        assert resonances(f, response * noise, band=(120.0, 180.0)).resonance == pytest.approx(150.0, abs=1.0)


def test_a_band_with_a_peak_alone_has_no_antiresonance():
    f = np.arange(2.0, 150.0)
    s = 2j * np.pi * f
    found = resonances(f, 16.0 / (0.03 * s**2 + 2.0 * s + 2000.0))
    assert found.resonance == pytest.approx(np.sqrt(2000.0 / 0.03) / (2.0 * np.pi), rel=1e-9)
    assert found.resonance_damping == pytest.approx(2.0 / (2.0 * np.sqrt(60.0)), rel=1e-9)
    assert found.antiresonance is None
    assert found.antiresonance_damping is None


@pytest.mark.parametrize(
    ("f", "response", "band", "words"),
    [
        (np.arange(9.0), np.ones(8), None, "shapes|shape"),
        (np.arange(9.0), np.arange(9.0), (2.0, 4.0), "holds 3 lines"),
        (np.arange(9.0), np.arange(9.0), None, "neither a peak nor a dip from 1 to 8 Hz"),
        (np.arange(9.0), np.zeros(9), None, "holds 0 lines"),
        (np.arange(9.0), np.full(9, np.nan), None, "holds 0 lines"),
    ],
)
def test_bad_arguments_are_refused_with_a_cure(f, response, band, words):
    with pytest.raises(InputError, match=words):
        resonances(f, response, band=band)


def _bench(name):
    if not (BENCH / name).exists():
        pytest.skip("the shared recordings are not here")
    return loadmat(BENCH / name, squeeze_me=True)


def test_the_motor_bench_is_distorted_by_friction():
    """An odd multisine on a real motor: both distortions far above the noise, the odd one more."""
    data = _bench("MultisineTypeB.mat")
    power = np.abs(np.fft.rfft(data["ref"]))
    lines = np.flatnonzero(power > 1e-6 * power.max())
    assert lines.size == 60
    assert np.all(lines % 2 == 1)
    bla = best_linear_approximation(
        data["iq_refx"], data["omega_max"], 2500.0, period=2500, lines=lines, transient=2, correct_input=False
    )
    # Published for this file: about 12 and 6 times the noise. Noise of 18 periods: each ratio is known to a few
    # per cent, but the published look may have chosen lines in another way.
    assert 9.0 < float(bla.odd.ratio) < 15.0
    assert 4.0 < float(bla.even.ratio) < 8.0
    assert max(float(bla.odd.p_value), float(bla.even.p_value)) < 1e-12
    assert float(bla.odd.distortion) > float(bla.even.distortion)
    # In relation to the motion itself, that is about one per cent.
    assert 0.005 < float(bla.odd.distortion) / np.sqrt(np.mean(bla.output**2)) < 0.02


def test_the_motor_bench_resonates_where_both_multisines_say():
    """Lines 4 Hz apart and lines 1 Hz apart, and noise averaging of the latter, agree within a Hz."""
    found = []
    for name, step in (("MultisineTypeB.mat", 4), ("MultisineTypeA.mat", 1)):
        data = _bench(name)
        lines = np.arange(13 if step == 4 else 11, 251, step)
        bla = best_linear_approximation(
            data["iq_refx"], data["omega_max"], 2500.0, period=2500, lines=lines, transient=2
        )
        found.append(resonances(bla.frequency, bla.response, band=(30.0, 110.0)))
    assert found[0].resonance == pytest.approx(found[1].resonance, abs=0.3)
    assert found[0].antiresonance == pytest.approx(found[1].antiresonance, abs=1.0)
    # Published: about 70 to 73 Hz and about 50 Hz; the peak of the raw response lies between 75 and 78 Hz.
    assert 75.0 < found[1].resonance < 78.0
    assert 52.0 < found[1].antiresonance < 55.0
    frf = estimate_frf(data["iq_refx"], data["omega_max"], 2500.0, segment=2500, window="boxcar", overlap=0.0)
    peak = np.argmax(np.where(np.asarray(frf.frequency) > 60.0, np.abs(frf.response), 0.0)[:150])
    assert abs(float(frf.frequency[peak]) - found[1].resonance) < 1.0
