"""Recordings side by side: noise levels, padding, masks, starting states, blocks.

What is simulated has 3000 or 6000 samples: one and the other are compiled once.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT, RATE, VOLT, open_loop, stick_noise

from frictionjax.estimation.data.batch import make_batch, noise_level, rows_of, what_was_before
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate

T = np.arange(6000) / RATE


def _recording(x, *, rate=RATE, name="run", u=None):
    return Recording(name, rate, np.zeros(len(x)) if u is None else u, np.asarray(x, float))


def _noise(seed, size=T.size, rms=NOISE):
    return rms * np.random.default_rng(seed).standard_normal(size)


MOTIONS = {
    "rest": 0.0 * T,
    "travel": 0.2 * T,
    "oscillation": 1e-3 * np.sin(2 * np.pi * 20.0 * T),
    "servo move": 0.3 * np.clip((T - 0.5) / 1.5, 0.0, 1.0) ** 3,
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_white_noise_is_recovered_from_any_motion(motion):
    """Without bias: 1 % of the noise is 2 % of its power, and 0.01 of misfit is taken for missing physics."""
    levels = [noise_level(_recording(MOTIONS[motion] + _noise(seed)), FINE) for seed in range(100)]
    stderr = np.std(levels, ddof=1) / np.sqrt(len(levels))
    assert abs(np.mean(levels) - NOISE) < 3.0 * stderr + 0.002 * NOISE
    assert np.std(levels) < 0.05 * NOISE


def test_impacts_do_not_raise_the_noise():
    x = _noise(1)
    quiet = noise_level(_recording(x), FINE)
    for k in range(500, 6000, 900):
        x[k : k + 40] += 1e-4 * np.exp(-np.arange(40) / 5.0)
    assert noise_level(_recording(x), FINE) == pytest.approx(quiet, rel=0.1)


def test_noise_is_not_below_what_quantisation_leaves():
    step = 1e-5
    x = step * np.round(1e-3 * np.sin(2 * np.pi * 0.5 * T) / step)
    floor = step / np.sqrt(12.0)
    assert noise_level(_recording(x), step) >= floor
    # Where it is not given, the smallest jump in the data is the step.
    assert noise_level(_recording(x)) >= 0.999 * floor
    assert noise_level(_recording(np.zeros(6000)), step) == floor


@pytest.fixture(scope="module")
def batch():
    """A machine at rest (2.2 s), one that moves from the start (1.03 s) and one at half the rate."""
    moving = 0.4 + 0.05 * T[:2060] + _noise(5, 2060)
    slow = np.full(1200, -0.2) + _noise(6, 1200)
    return make_batch(
        (
            _recording(0.1 + _noise(4, 4400), name="rest", u=np.ones(4400)),
            _recording(moving, name="moving", u=np.full(2060, 2.0)),
            _recording(slow, name="slow", rate=0.5 * RATE),
        ),
        encoder_step=FINE,
    )


def test_a_batch_is_padded_with_the_last_value(batch):
    assert tuple(batch.lengths) == (4400, 2060, 1200)
    assert batch.block == 100
    assert batch.x.shape == batch.u.shape == batch.valid.shape == (3, 4400)
    for row, length in enumerate(batch.lengths):
        assert np.all(np.asarray(batch.x[row, length:]) == float(batch.x[row, length - 1]))
        assert np.all(np.asarray(batch.u[row, length:]) == float(batch.u[row, length - 1]))
    assert bool(jnp.all(jnp.isfinite(batch.x)))


def test_a_batch_scores_neither_padding_nor_settling(batch):
    settled = [200, 200, 100]
    for row, (first, length) in enumerate(zip(settled, batch.lengths, strict=True)):
        expected = np.zeros(4400)
        expected[first:length] = 1.0
        np.testing.assert_array_equal(batch.valid[row], expected)
    np.testing.assert_array_equal(batch.block_count.sum(1), [4200, 1860, 1100])


def test_a_length_that_is_no_whole_number_of_blocks_is_filled_up():
    batch = make_batch((_recording(_noise(1, 2910)),), encoder_step=FINE)
    assert batch.x.shape == (1, 3000)
    assert float(batch.block_count[0, -1]) == 10.0


@pytest.mark.parametrize(
    ("samples", "padded"), [(4010, 4200), (4101, 4200), (4200, 4200), (6210, 6400), (800, 800)]
)
def test_lengths_go_by_sixteenths_of_an_octave(samples, padded):
    batch = make_batch((_recording(_noise(1, samples)),), encoder_step=FINE)
    assert batch.x.shape == batch.u.shape == batch.valid.shape == (1, padded)
    assert float(batch.valid.sum()) == samples - 200
    assert float(batch.block_count.sum()) == samples - 200


def test_a_batch_starts_where_the_recordings_start(batch):
    np.testing.assert_allclose(batch.x0, [0.1, 0.4, -0.2], atol=3 * NOISE)
    # A slope that the noise explains is no motion.
    assert float(batch.v0[0]) == float(batch.v0[2]) == 0.0
    assert float(batch.v0[1]) == pytest.approx(0.05, rel=0.01)
    np.testing.assert_allclose(batch.dt, [5e-4, 5e-4, 1e-3])
    np.testing.assert_allclose(batch.noise, NOISE, rtol=0.15)


def test_block_means_are_over_scored_samples(batch):
    squares = np.random.default_rng(0).uniform(size=(3, 4400))
    found = np.asarray(batch.block_mean(jnp.asarray(squares)))
    assert found.shape == (3, 44)
    assert found[0, 5] == pytest.approx(squares[0, 500:600].mean())
    assert found[1, 20] == pytest.approx(squares[1, 2000:2060].mean())
    assert found[0, 0] == found[1, 30] == 0.0


def test_padding_changes_no_innovation():
    """A short recording has the same misfit beside a longer one as alone."""
    short = open_loop("short", stick_noise(1.5), seed=1)
    long = open_loop("long", stick_noise(3.0, seed=1), seed=2)
    together, alone = make_batch((short, long), encoder_step=FINE), make_batch((short,), encoder_step=FINE)
    powers = []
    for batch in (together, alone):
        posterior, vector = robust_posterior(PLANT, batch, np.zeros(len(batch.lengths), bool))
        powers.append(posterior.powers([vector])[0][0, :30])
    np.testing.assert_allclose(powers[0], powers[1], rtol=1e-9)


def test_a_machine_that_never_moves_gives_no_nan():
    """Every sample the same, and the encoder's step unknown: a level of zero would divide by zero."""
    still = _recording(np.zeros(3000), u=0.1 * np.sin(2 * np.pi * 5.0 * T[:3000]))
    posterior, vector = robust_posterior(PLANT, make_batch((still,)), np.zeros(1, bool))
    assert np.isfinite(posterior.misfits([vector])[0])


def test_a_recording_of_a_few_samples_is_refused_with_a_sentence():
    with pytest.raises(ValueError, match=r"short.*samples"):
        make_batch((_recording(_noise(1, 30), name="short"),), encoder_step=FINE)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_each_sample_rate_has_its_own_noise_floor(order):
    """The same swing at 2 kHz and at 1 kHz: under the true model, both side by side misfit as little as each alone."""
    u = 1.5 * VOLT * np.sin(2 * np.pi * 2.0 * T)
    u = np.repeat(u[::2], 2)
    x = np.asarray(simulate(PLANT, u, RATE, substeps=4).x) + _noise(1)
    pair = (_recording(x, u=u, name="fast"), _recording(x[::2], u=u[::2], rate=0.5 * RATE, name="slow"))
    alone = [_misfit((recording,)) for recording in pair]
    scored = [recording.x.size - 0.1 * recording.sample_rate for recording in pair]
    expected = np.average(alone, weights=scored)
    assert _misfit(tuple(pair[k] for k in order)) == pytest.approx(expected, abs=2e-3)


def _misfit(recordings):
    held_out = np.zeros(len(recordings), bool)
    posterior, vector = robust_posterior(PLANT, make_batch(recordings, encoder_step=FINE), held_out)
    return posterior.at_bandwidth(SLOW_BANDWIDTH).misfits([vector])[0]


def test_measured_temperatures_are_kept_from_the_first_sample_on():
    """Straight lines between nine instants, in K above where the first recording began; none unless all have them."""
    t = np.arange(8000) / 1000.0
    x = np.random.default_rng(0).standard_normal(8000)

    def warm(name, begin, rate, start):
        return Recording(name, 1000.0, x, x, start_time=start, temperature=begin + rate * t)

    later, first = warm("later", 30.0, 0.5, 100.0), warm("first", 21.0, 1.0, 0.0)
    kept = np.asarray(what_was_before((later, first)).temperature)
    # A value at an end is the mean of the thirty-second part of the recording beside it.
    np.testing.assert_allclose(kept[1], np.arange(9) * 1.0, atol=0.3)
    np.testing.assert_allclose(kept[0], 9.0 + np.arange(9) * 0.5, atol=0.3)
    cold = Recording("cold", 1000.0, x, x, start_time=200.0)
    assert not np.any(np.asarray(what_was_before((first, cold)).temperature))


def test_rows_of_a_batch_are_those_rows_in_every_array(batch):
    rows = np.array([1])
    some = rows_of(batch, rows)
    assert isinstance(some.lengths, np.ndarray)
    assert isinstance(some.x, np.ndarray)
    for one, whole in zip(jax.tree.leaves(some), jax.tree.leaves(batch), strict=True):
        np.testing.assert_array_equal(one, np.asarray(whole)[rows])
