"""Delay and lag of the input against exact answers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import effect
from scipy.signal import lfilter

DT = jnp.asarray(5e-4)
U = jnp.asarray(np.random.default_rng(7).normal(size=60))


def _delayed(u, samples):
    return np.asarray(effect("Delay", delay=samples * float(DT)).apply(u, DT))


@pytest.mark.parametrize("samples", [0, 1, 2, 17, 59, 80])
def test_a_delay_of_whole_samples_is_a_shift(samples):
    padded = np.concatenate([np.full(samples, float(U[0])), U])[: U.size]
    np.testing.assert_allclose(_delayed(U, samples), padded, rtol=0, atol=1e-12)


def test_a_delay_between_samples_is_the_mean_of_the_shifted_staircase():
    fine = 8
    held = np.repeat(np.asarray(U), fine)
    for part in (1, 4, 11):  # eighths of a sample
        shifted = np.concatenate([np.full(part, held[0]), held])[: held.size]
        expected = shifted.reshape(-1, fine).mean(axis=1)
        np.testing.assert_allclose(_delayed(U, part / fine), expected, atol=1e-12)


def test_a_delay_has_a_derivative_everywhere_also_at_zero():
    def output(delay):
        return effect("Delay", delay=delay).apply(U, DT)

    for delay in (0.0, 0.3 * float(DT), 1.7 * float(DT)):
        slope = jax.jacfwd(output)(delay)
        ahead = (output(delay + 1e-9) - output(delay)) / 1e-9  # one-sided: a delay is not negative
        np.testing.assert_allclose(slope, ahead, rtol=1e-5, atol=1e-3)


FINE = 4000


def _current(u, ratio):
    """Current at the samples from scipy's difference equation; its mean over each sample from the equation."""
    decay = np.exp(-1.0 / ratio)
    state, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], u, zi=[float(u[0])])
    following = np.append(state, decay * state[-1] + (1.0 - decay) * u[-1])[1:]
    # tau di/dt = u - i, integrated over a sample: mean i = u - tau (i_next - i)/dt.
    return state, u - ratio * (following - state)


def _off(u, ratio):
    """Second integral of the current over each sample less that of its mean, in samples^2, by the midpoint rule."""
    state, mean = _current(u, ratio)
    time = (np.arange(FINE) + 0.5) / FINE
    current = u[:, None] + (state - u)[:, None] * np.exp(-time / ratio)
    off = np.mean(current * (1.0 - time), axis=1) - 0.5 * mean
    return np.where(np.arange(u.size) < 2, 0.0, off)  # what there is no sample before to mend stays


@pytest.mark.parametrize("ratio", [0.01, 0.3, 1.0, 4.0])
def test_lag_is_the_exact_first_order_response(ratio):
    """Its mean over each sample, and beside the mean what moves a mass to where the current does."""
    u = np.asarray(U)
    lagged = np.asarray(effect("DriveLag", time_constant=ratio * DT).apply(U, DT))
    off = np.pad(_off(u, ratio), 1)
    expected = _current(u, ratio)[1] + 0.5 * (off[2:] - off[:-2])
    np.testing.assert_allclose(lagged, expected, atol=1e-6)  # of the midpoint rule


def test_without_a_lag_the_input_arrives_as_it_is():
    np.testing.assert_allclose(effect("DriveLag", time_constant=1e-9 * DT).apply(U, DT), U, atol=1e-8)


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_a_mass_goes_where_the_lagged_current_takes_it(ratio):
    """A free mass under the current itself, and under one force a sample: the mean alone leaves ten times as much."""
    u = np.convolve(np.random.default_rng(8).normal(size=400), np.hanning(20), "same")
    force = np.asarray(effect("DriveLag", time_constant=ratio * DT).apply(jnp.asarray(u), DT))
    mean, off = _current(u, ratio)[1], _off(u, ratio)

    def position(each, beside):
        """Positions in dt^2/J: of held forces, and of what each sample adds beside them."""
        velocity = np.concatenate([[0.0], np.cumsum(each)[:-1]])
        return np.cumsum(velocity + 0.5 * each + beside)

    exact = position(mean, off)
    error, of_the_mean = (np.std(position(each, 0.0) - exact) for each in (force, mean))
    assert error < 0.1 * of_the_mean


def test_lag_has_a_derivative_everywhere_also_at_zero():
    def output(ratio):
        return effect("DriveLag", time_constant=ratio * DT).apply(U, DT)

    at_zero = jax.jacfwd(output)(0.0)
    np.testing.assert_allclose(at_zero, (output(1e-7) - output(0.0)) / 1e-7, rtol=1e-6, atol=1e-6)
    for ratio in (1e-3, 0.02, 0.4, 3.0):
        slope = jax.jacfwd(output)(ratio)
        central = (output(ratio + 1e-7) - output(ratio - 1e-7)) / 2e-7
        np.testing.assert_allclose(slope, central, rtol=1e-5, atol=1e-6)
        assert np.all(np.isfinite(slope))


def test_a_small_lag_is_a_small_delay():
    """In the mean of each sample, and but for what mends the position."""
    lag = np.asarray(effect("DriveLag", time_constant=0.02 * DT).apply(U, DT))
    delay = np.asarray(effect("Delay", delay=0.02 * DT).apply(U, DT))
    off = np.pad(_off(np.asarray(U), 0.02), 1)
    np.testing.assert_allclose(lag - 0.5 * (off[2:] - off[:-2]), delay, atol=1e-6)
