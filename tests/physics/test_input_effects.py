"""Delay and lag of the input against exact answers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import effect
from helpers_runs import in_steps, position_by_scipy
from scipy.signal import lfilter

from frictionjax.physics import Drive, LuGre, Push
from frictionjax.simulation.fixed import simulate

DT = jnp.asarray(5e-4)
U = jnp.asarray(np.random.default_rng(7).normal(size=60))


def _delayed(u, samples) -> Push:
    return effect("Delay", delay=samples * float(DT)).apply(u, DT)


def _moments(fine, parts):
    """Mean over each sample of what is given `parts` times in it, and the rise of the line of the same first moment."""
    each, to_go = fine.reshape(-1, parts), 1.0 - (np.arange(parts) + 0.5) / parts
    mean = each.mean(axis=1)
    return mean, -12.0 * ((each * to_go).mean(axis=1) - 0.5 * mean)


@pytest.mark.parametrize("samples", [0, 1, 2, 17, 59, 80])
def test_a_delay_of_whole_samples_is_a_shift(samples):
    padded = np.concatenate([np.full(samples, float(U[0])), U])[: U.size]
    found = _delayed(U, samples)
    np.testing.assert_allclose(found.mean, padded, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.rise, 0.0, atol=1e-12)


def test_a_delay_between_samples_has_mean_and_moment_of_the_shifted_staircase():
    fine = 8
    held = np.repeat(np.asarray(U), fine)
    for part in (1, 4, 11):  # eighths of a sample
        shifted = np.concatenate([np.full(part, held[0]), held])[: held.size]
        mean, rise = _moments(shifted, fine)
        found = _delayed(U, part / fine)
        np.testing.assert_allclose(found.mean, mean, atol=1e-12)
        np.testing.assert_allclose(found.rise, rise, atol=1e-12)


def test_a_delay_has_a_derivative_everywhere_also_at_zero():
    def output(delay):
        found = effect("Delay", delay=delay).apply(U, DT)
        return jnp.stack([found.mean, found.rise])

    for delay in (0.0, 0.3 * float(DT), 1.7 * float(DT)):
        slope = jax.jacfwd(output)(delay)
        ahead = (output(delay + 1e-9) - output(delay)) / 1e-9  # one-sided: a delay is not negative
        np.testing.assert_allclose(slope, ahead, rtol=1e-5, atol=0.2)  # of 1e4 per second


FINE = 4000


def _current(u, ratio):
    """Current at the samples from scipy's difference equation; its mean over each sample from the equation."""
    decay = np.exp(-1.0 / ratio)
    state, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], u, zi=[float(u[0])])
    following = np.append(state, decay * state[-1] + (1.0 - decay) * u[-1])[1:]
    # tau di/dt = u - i, integrated over a sample: mean i = u - tau (i_next - i)/dt.
    return state, u - ratio * (following - state)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 1.0, 4.0])
def test_lag_is_the_exact_first_order_response(ratio):
    """Its mean over each sample, and its first moment."""
    u = np.asarray(U)
    found = effect("DriveLag", time_constant=ratio * DT).apply(U, DT)
    state, mean = _current(u, ratio)
    np.testing.assert_allclose(found.mean, mean, atol=1e-10)
    time = (np.arange(FINE) + 0.5) / FINE
    current = u[:, None] + (state - u)[:, None] * np.exp(-time / ratio)
    np.testing.assert_allclose(
        found.rise, _moments(current.ravel(), FINE)[1], atol=1e-4
    )  # of the midpoint rule


def test_without_a_lag_the_input_arrives_as_it_is():
    found = effect("DriveLag", time_constant=1e-9 * DT).apply(U, DT)
    np.testing.assert_allclose(found.mean, U, atol=1e-7)
    np.testing.assert_allclose(found.rise, 0.0, atol=1e-7)


LOOSE = Drive(J=1.0, friction=LuGre(1e-3, 1e-6, 1e-6, 1e-6, 2e-6, 1.0))
"""Next to a free mass."""


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("late", [0.3, 1.5, 2.75])
def test_a_mass_goes_where_the_delayed_input_takes_it(late, substeps):
    """Against the staircase shifted on a grid twenty times finer, at every sample; whatever the steps of the scheme."""
    u, fine = np.random.default_rng(8).normal(size=200), 20
    delayed = LOOSE.with_effects(effect("Delay", delay=late * float(DT)))
    found = simulate(delayed, u, 1.0 / float(DT), substeps=substeps).x
    shifted = np.concatenate([np.full(round(late * fine), u[0]), np.repeat(u, fine)])[: u.size * fine]
    exact = simulate(LOOSE, shifted, fine / float(DT), substeps=1).x[::fine]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6 * np.ptp(exact))


@pytest.mark.parametrize("ratio", [0.4, 1.0, 4.0])
def test_a_mass_goes_where_the_lagged_current_takes_it(ratio):
    u = np.random.default_rng(8).normal(size=200)
    lagged = LOOSE.with_effects(effect("DriveLag", time_constant=ratio * DT))
    found = np.asarray(simulate(lagged, u, 1.0 / float(DT), substeps=1).x)
    fine = 200
    state, _ = _current(u, ratio)
    time = (np.arange(fine) + 0.5) / fine
    current = u[:, None] + (state - u)[:, None] * np.exp(-time / ratio)
    exact = simulate(LOOSE, current.ravel(), fine / float(DT), substeps=1).x[::fine]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-5 * np.ptp(exact))


@pytest.mark.parametrize("form", [{"Delay": {"delay": 0.4 * 5e-4}}, {"DriveLag": {"time_constant": 3e-4}}])
def test_a_stuck_machine_too_against_adaptive_steps(form):
    """In presliding, where bristles and their damping act within the sample."""
    ((name, values),) = form.items()
    stuck = Drive(J=0.03, friction=LuGre(2000.0, 3.0, 0.02, 0.5, 0.7, 0.05)).with_effects(
        effect(name, **values)
    )
    u = 0.2 * np.sign(np.random.default_rng(9).normal(size=120))
    reference = position_by_scipy(stuck, u, 1.0 / float(DT), 1e-9, 1e-11)
    error = [np.std(np.asarray(in_steps(stuck, u, 1.0 / float(DT), n).x) - reference) for n in (1, 4)]
    assert error[0] < 0.02 * np.std(reference) and error[1] < error[0] / 8.0  # second order


def test_lag_has_a_derivative_everywhere_also_at_zero():
    def output(ratio):
        found = effect("DriveLag", time_constant=ratio * DT).apply(U, DT)
        return jnp.stack([found.mean, found.rise])

    at_zero = jax.jacfwd(output)(0.0)
    np.testing.assert_allclose(at_zero, (output(1e-7) - output(0.0)) / 1e-7, rtol=1e-6, atol=1e-6)
    for ratio in (1e-3, 0.02, 0.4, 3.0):
        slope = jax.jacfwd(output)(ratio)
        central = (output(ratio + 1e-7) - output(ratio - 1e-7)) / 2e-7
        np.testing.assert_allclose(slope, central, rtol=1e-5, atol=1e-5)
        assert np.all(np.isfinite(slope))


def test_a_small_lag_is_a_small_delay():
    """In the mean of each sample."""
    lag = effect("DriveLag", time_constant=0.02 * DT).apply(U, DT)
    delay = effect("Delay", delay=0.02 * DT).apply(U, DT)
    np.testing.assert_allclose(lag.mean, delay.mean, atol=1e-6)
