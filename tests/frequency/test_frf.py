"""The frequency response agrees with scipy, and its standard deviation with the scatter of many records."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import coherence, cont2discrete, csd, freqz, lfilter, welch

from frictionjax.core import InputError, PrecisionError
from frictionjax.excitation import multisine
from frictionjax.frequency import FRF, estimate_frf

RATE = 2000.0
PLANT = cont2discrete(([16.0], [0.03, 4.0, 2000.0]), 1.0 / RATE)[:2]


def _respond(u):
    """Exact answer of a spring, a damper and an inertia to a held input."""
    return lfilter(PLANT[0][0], PLANT[1], u)


def _record(seed, n, noise):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    x = _respond(u)
    return u, x + noise * x.std() * rng.standard_normal(n)


WINDOWS = ["hann", "hamming", "blackman", "boxcar", np.arange(1.0, 513.0)]


@pytest.mark.parametrize(
    ("window", "overlap", "detrend"),
    [(window, overlap, "constant") for window in WINDOWS for overlap in (0.0, 0.5, 0.8)]
    + [(window, 0.5, detrend) for window in WINDOWS for detrend in ("linear", "none")],
    ids=lambda value: str(value) if np.ndim(value) == 0 else "values",
)
def test_it_agrees_with_scipy(window, overlap, detrend):
    u, x = _record(1, 5000, 0.3)
    # Something to take away.
    x = x + x.std() * (3.0 + np.linspace(0.0, 1.0, x.size))
    segment = 512
    frf = estimate_frf(u, x, RATE, segment=segment, window=window, overlap=overlap, detrend=detrend)
    options = {
        "fs": RATE,
        "window": window,
        "nperseg": segment,
        "noverlap": int(overlap * segment),
        "detrend": False if detrend == "none" else detrend,
    }
    frequency, cross = csd(u, x, **options)
    np.testing.assert_allclose(frf.frequency, frequency, rtol=1e-12)
    # At zero frequency a detrended segment may hold nothing but rounding errors: scipy divides them, we do not.
    driven = np.isfinite(frf.std)
    assert np.all(driven[1:])
    expected = (cross / welch(u, **options)[1])[driven]
    np.testing.assert_allclose(frf.response[driven], expected, rtol=1e-10)
    np.testing.assert_allclose(frf.coherence[driven], coherence(u, x, **options)[1][driven], rtol=1e-10)


def test_an_odd_segment_agrees_with_scipy():
    u, x = _record(2, 3000, 0.1)
    frf = estimate_frf(u, x, RATE, segment=301)
    expected = csd(u, x, RATE, nperseg=301)[1] / welch(u, RATE, nperseg=301)[1]
    np.testing.assert_allclose(frf.response, expected, rtol=1e-10)
    assert frf.frequency.shape == frf.response.shape == frf.coherence.shape == frf.std.shape == (151,)


def test_fifty_half_overlapping_hann_segments_are_worth_47():
    """The paper's settings: 50 averages of 8192 samples."""
    n = 8192 + 49 * 4096
    frf = estimate_frf(np.ones(n), np.ones(n), 1e4)
    assert frf.averages_effective == pytest.approx(50.0 / (1.0 + 2.0 * 49.0 / 50.0 / 36.0), rel=1e-9)
    assert frf.averages_effective == pytest.approx(47.4, abs=0.05)
    separate = estimate_frf(np.ones(n), np.ones(n), 1e4, window="boxcar", overlap=0.0)
    assert separate.averages_effective == pytest.approx(25.0)
    assert separate.bin_correlation == pytest.approx(1.0)
    # Hann without overlap: 35 / 18 neighbouring bins are worth one.
    assert estimate_frf(np.ones(n), np.ones(n), 1e4, overlap=0.0).bin_correlation == pytest.approx(
        35.0 / 18.0
    )


@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.75])
def test_the_standard_deviation_is_the_scatter_of_two_hundred_records(overlap):
    seeds, n, segment = 200, 6144, 1024
    u, x = (np.stack(part) for part in zip(*(_record(s, n, 1.0) for s in range(seeds)), strict=True))
    batch = jax.vmap(lambda u, x: estimate_frf(u, x, RATE, segment=segment, overlap=overlap))(u, x)
    assert batch.response.shape == (seeds, 513)
    band = slice(5, 120)
    truth = freqz(PLANT[0][0], PLANT[1], worN=np.asarray(batch.frequency[0, band]), fs=RATE)[1]
    error = np.asarray(batch.response)[:, band] / truth - 1.0
    std = np.asarray(batch.std)[:, band] / np.abs(truth)
    # Real and imaginary part each have the variance std^2. One number a record, so that bins may be correlated.
    excess = np.mean(np.abs(error) ** 2 / 2.0 - std**2, axis=1) / np.mean(std**2)
    assert abs(excess.mean()) < 5.0 * excess.std() / np.sqrt(seeds)
    assert excess.std() / np.sqrt(seeds) < 0.03
    # The mean over the band scatters as `bin_correlation` promises.
    weight = 1.0 / np.mean(std**2, axis=0)
    mean = np.real(error) @ weight / weight.sum()
    promised = float(batch.bin_correlation[0]) / weight.sum()
    assert mean.var() / promised == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / seeds))


@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.75])
def test_magnitude_and_phase_scatter_as_promised(overlap):
    """Each on its own against two hundred records; counting all segments as independent would fail it."""
    seeds, n, segment = 200, 32_768, 1024
    u, x = (np.stack(part) for part in zip(*(_record(s, n, 1.0) for s in range(seeds)), strict=True))
    batch = jax.vmap(lambda u, x: estimate_frf(u, x, RATE, segment=segment, overlap=overlap))(u, x)
    # Where coherence is high, both are linear in the noise; neighbouring bins share a window, so every third.
    # Segments are long enough that noise, not what the window cuts off, makes the scatter.
    band = slice(6, 48, 3)
    turned = np.asarray(batch.response)[:, band] / np.mean(np.asarray(batch.response)[:, band], axis=0)
    scatter = {"magnitude": np.abs(turned) - 1.0, "phase": np.angle(turned)}
    for part, error in scatter.items():
        std = np.asarray(batch.phase_std)[:, band]
        if part == "magnitude":
            std = np.asarray(batch.std / np.abs(batch.response))[:, band]
        off = error - error.mean(axis=0)
        each = np.mean(off**2 / np.mean(std**2, axis=0), axis=1) * seeds / (seeds - 1)
        gate = 4.5 * each.std() / np.sqrt(seeds)
        assert abs(each.mean() - 1.0) < gate < 0.25
        if overlap == 0.75:
            # The naive number of segments promises errors too small by more than the gate.
            segments = 1 + (n - segment) // (segment // 4)
            naive = (segments - 1.0) / (float(batch.averages_effective[0]) - 1.0)
            assert abs(naive * each.mean() - 1.0) > gate
    silent = estimate_frf(np.zeros(4096), np.zeros(4096), RATE, segment=512)
    assert np.all(np.isinf(silent.phase_std))


def test_a_batch_is_its_members():
    records = [_record(seed, 4096, 0.1) for seed in (0, 1)]
    u, x = (np.stack(part) for part in zip(*records, strict=True))
    batch = jax.vmap(lambda u, x: estimate_frf(u, x, RATE, segment=1024))(u, x)
    for i, record in enumerate(records):
        alone = estimate_frf(*record, RATE, segment=1024)
        assert eqx.tree_equal(alone, jax.tree.map(lambda part, i=i: part[i], batch), rtol=1e-9, atol=1e-15)


def test_lines_without_power_have_no_answer_and_no_nan():
    u = np.tile(multisine(jax.random.key(0), 1000, RATE, (10.0, 100.0), 1.0, odd=True), 6)
    frf = estimate_frf(u, _respond(u), RATE, segment=1000, window="boxcar", overlap=0.0)
    silent = np.asarray(frf.frequency) > 102.0
    assert np.all(np.isinf(frf.std[silent]))
    assert np.all(frf.response[silent] == 0.0)
    assert np.all(frf.coherence[silent] == 0.0)
    driven = np.abs(frf.response) > 0.0
    assert np.all(np.isfinite(frf.std[driven]))
    still = estimate_frf(np.zeros(4096), np.zeros(4096), RATE, segment=512)
    assert all(np.all(~np.isnan(part)) for part in (still.response, still.coherence, still.std))


def test_new_numbers_compile_nothing_new():
    from_record = eqx.filter_jit(
        eqx.debug.assert_max_traces(lambda u, x, rate: estimate_frf(u, x, rate, segment=512), max_traces=1)
    )
    for seed in range(3):
        u, x = _record(seed, 4096, 0.1)
        assert isinstance(from_record(jnp.asarray(u), jnp.asarray(x), jnp.asarray(RATE + seed)), FRF)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"segment": 8192}, "4 to 2730"),
        ({"segment": 3000}, "two segments"),
        ({"segment": 2}, "`segment`"),
        ({"x": np.zeros(4000)}, "4096 samples and `x` holds 4000"),
        ({"x": np.zeros((2, 4096))}, "vmap"),
        ({"u": np.where(np.arange(4096) == 7, np.nan, 0.0)}, "`u` holds 1 values .* sample 7"),
        ({"overlap": 1.0}, "`overlap`"),
        ({"window": "kaiser"}, "hann, hamming"),
        ({"window": np.ones(3)}, r"shape \(3,\)"),
        ({"detrend": "cubic"}, "`detrend`"),
    ],
)
def test_bad_arguments_are_refused_with_a_cure(change, words):
    arguments = {"u": np.zeros(4096), "x": np.zeros(4096), "segment": 512, **change}
    u, x = arguments.pop("u"), arguments.pop("x")
    with pytest.raises(InputError, match=words):
        estimate_frf(u, x, RATE, **arguments)


def test_float32_is_refused():
    with jax.enable_x64(False), pytest.raises(PrecisionError):
        estimate_frf(np.zeros(4096), np.zeros(4096), RATE, segment=512)
