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


@pytest.mark.parametrize("ratio", [1e-4, 0.01, 0.3, 1.0, 4.0])
def test_lag_is_the_exact_first_order_response(ratio):
    """The state at the samples from scipy's difference equation, the mean over a sample from the equation."""
    tau = ratio * float(DT)
    lagged = np.asarray(effect("DriveLag", time_constant=tau).apply(U, DT))
    decay = np.exp(-1.0 / ratio)
    state, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], np.asarray(U), zi=[float(U[0]) * 1.0])
    following = np.append(state, decay * state[-1] + (1.0 - decay) * float(U[-1]))[1:]
    # tau di/dt = u - i, integrated over a sample: mean i = u - tau (i_next - i)/dt.
    np.testing.assert_allclose(lagged, np.asarray(U) - ratio * (following - state), atol=1e-12)


def test_step_response_of_the_lag():
    step = jnp.concatenate([jnp.zeros(1), jnp.ones(400)])
    tau = 40.0 * float(DT)
    mean = effect("DriveLag", time_constant=tau).apply(step, DT)
    t = np.arange(400) * float(DT)
    exact = 1.0 - tau / float(DT) * (np.exp(-t / tau) - np.exp(-(t + float(DT)) / tau))
    np.testing.assert_allclose(mean[1:], exact, rtol=1e-12)


def test_lag_has_a_derivative_everywhere_also_at_zero():
    def output(ratio):
        return effect("DriveLag", time_constant=ratio * DT).apply(U, DT)

    at_zero = jax.jacfwd(output)(0.0)
    np.testing.assert_allclose(at_zero, (output(1e-6) - output(0.0)) / 1e-6, rtol=1e-6, atol=1e-6)
    for ratio in (1e-3, 0.02, 0.4, 3.0):
        slope = jax.jacfwd(output)(ratio)
        central = (output(ratio + 1e-7) - output(ratio - 1e-7)) / 2e-7
        np.testing.assert_allclose(slope, central, rtol=1e-5, atol=1e-6)
        assert np.all(np.isfinite(slope))


def test_a_small_lag_is_a_small_delay():
    lag = effect("DriveLag", time_constant=0.02 * DT).apply(U, DT)
    delay = effect("Delay", delay=0.02 * DT).apply(U, DT)
    np.testing.assert_allclose(lag, delay, atol=1e-12)
