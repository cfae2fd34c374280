"""The rivals in identification: a refit with numba and scipy, and least squares on filtered derivatives."""

import shutil
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(
    not (REPOSITORY / "benchmarks").is_dir(), reason="an installed package has no benchmarks"
)

STAGE = np.array([13.7, 3.5e5, 840.0, 41.0, 25.6, 29.2, 7.7e-3])
MOTOR_CONSTANT = 28.0


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """The benchmarks are no part of the installed package."""
    monkeypatch.syspath_prepend(str(REPOSITORY))


@pytest.fixture
def refit_numba(importable):
    """The rival, where numba is installed."""
    pytest.importorskip("numba")
    from benchmarks.rivals import refit_numba

    return refit_numba


NOISE = 0.2e-6  # m


def _recordings(rival, seed):
    """A break-away sine and force noise at 2 kHz, 0.2 um of white noise on the positions."""
    dt, random = 5e-4, np.random.default_rng(seed)
    t = dt * np.arange(4000)
    slides = 1.15 * STAGE[5] * np.sin(2.0 * np.pi * 1.5 * t)
    shakes = 0.7 * STAGE[5] * np.random.default_rng(1).normal(size=t.size)
    return [
        (push / MOTOR_CONSTANT, rival.free_run(STAGE, push, dt) + NOISE * random.normal(size=t.size), dt)
        for push in (slides, shakes)
    ]


def test_the_free_run_of_numba_is_that_of_lsoda(refit_numba):
    from benchmarks.rivals import scipy_lsoda

    dt = 5e-4
    push = 1.15 * STAGE[5] * np.sin(2.0 * np.pi * 1.5 * dt * np.arange(1000))
    exact = scipy_lsoda.simulate(STAGE, push, dt, 1e-8)
    error = [np.std(refit_numba.free_run(STAGE, push, dt, substeps=n) - exact) for n in (2, 4)]
    assert error[0] < 1e-4 * np.ptp(exact)
    assert error[1] < 0.4 * error[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_refit_recovers_the_truth_within_its_covariance(refit_numba, sign):
    """White noise alone, so the classical covariance holds: the squared distance to the truth is chi-squared."""
    recordings, s_rec = _recordings(refit_numba, 11), np.full(2, NOISE)
    theta, info = refit_numba.refit(recordings, MOTOR_CONSTANT, STAGE * (1.0 + 0.3 * sign), s_rec)

    def at(logs):
        return refit_numba.residuals(np.exp(logs), recordings, MOTOR_CONSTANT, s_rec)

    truth, step = np.log(STAGE), 1e-5
    jacobian = np.stack([(at(truth + d) - at(truth - d)) / (2.0 * step) for d in step * np.eye(7)], axis=1)
    away = jacobian @ (np.log(theta) - truth)
    assert away @ away < 24.3  # exceeded by chance once in 1000 fits
    assert info.success
    # 1 a residual, and a standard deviation of sqrt(2 / 8000).
    assert abs(2.0 * info.cost / 8000 - 1.0) < 4.0 * np.sqrt(2.0 / 8000)
    # Differences included: at least one Jacobian a phase.
    assert info.nfev > 16


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_refit_in_c_is_that_of_numba(refit_numba):
    """Two roads to one answer, residuals, derivatives and the end of the fit."""
    from benchmarks.rivals.refit_c import Refit

    recordings, s_rec = _recordings(refit_numba, 11), np.full(2, NOISE)
    rival, logs, step = Refit(), np.log(1.1 * STAGE), 1e-5
    values, slopes = rival.residuals(logs, recordings, MOTOR_CONSTANT, s_rec)

    def at(logs):
        return refit_numba.residuals(np.exp(logs), recordings, MOTOR_CONSTANT, s_rec)

    np.testing.assert_allclose(values, at(logs), rtol=0, atol=1e-7 * np.ptp(values))
    for slope, d in zip(slopes.T, step * np.eye(7), strict=True):
        expected = (at(logs + d) - at(logs - d)) / (2.0 * step)
        np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-2 * np.ptp(expected))
    theta, info = rival.refit(recordings, MOTOR_CONSTANT, 1.3 * STAGE, s_rec)
    other, of_numba = refit_numba.refit(recordings, MOTOR_CONSTANT, 1.3 * STAGE, s_rec)
    # The same minimum: apart by a small part of a standard error.
    assert info.success
    assert info.nfev < of_numba.nfev
    assert abs(info.cost - of_numba.cost) < 0.05
    np.testing.assert_allclose(theta, other, rtol=3e-3)


def test_a_wild_step_leaves_finite_residuals(refit_numba):
    recordings = _recordings(refit_numba, 11)
    wild = STAGE * np.array([1e-300, 1e250, 1e200, 1.0, 1e-200, 1e-250, 1e-300])
    with np.errstate(all="ignore"):
        run = refit_numba.free_run(wild, MOTOR_CONSTANT * recordings[1][0], 5e-4)
        assert not np.all(np.isfinite(run))
    found = refit_numba.residuals(wild, recordings, MOTOR_CONSTANT, np.full(2, NOISE))
    assert np.all(np.isfinite(found))
    assert np.max(np.abs(found)) == 1e6


def test_many_refits_in_two_processes_are_the_refits_one_by_one(refit_numba):
    sets, s_rec = [_recordings(refit_numba, seed) for seed in (1, 2, 3)], np.full(2, NOISE)
    starts = STAGE * np.array([[1.1], [0.9], [1.05]])
    begin = time.perf_counter()
    thetas, seconds, infos = refit_numba.refit_many(sets, MOTOR_CONSTANT, starts, s_rec, processes=2)
    everything = time.perf_counter() - begin
    alone, info = refit_numba.refit(sets[0], MOTOR_CONSTANT, starts[0], s_rec)
    np.testing.assert_allclose(thetas[0], alone, rtol=1e-9)
    assert infos[0].nfev == info.nfev
    assert len({tuple(theta) for theta in thetas}) == 3
    # Starting the processes and compiling in them is not in the time.
    assert 0.0 < seconds < everything


# A mass of 10 kg with Coulomb and viscous friction under a PD controller of 8 Hz.
MASS, COULOMB, VISCOUS = 10.0, 5.0, 20.0
TRUTH = np.array([MASS, COULOMB, VISCOUS, 0.0])
OMEGA = 2.0 * np.pi * 8.0


@cache
def _closed_loop(noise, draws, samples=8000, dt=1e-3, parts=5):
    """Inputs and measured positions, shape (draws, samples), and the reference (samples,): the controller sees the
    position with white noise of standard deviation `noise`. Coulomb friction stops the mass, but does not push it."""
    t = dt * np.arange(samples)
    phases = ((0.05, 0.7, 0.0), (0.01, 2.3, 1.0))
    target = np.sum([a * np.sin(2.0 * np.pi * f * t + p) for a, f, p in phases], axis=0)
    speed = np.sum([2.0 * np.pi * f * a * np.cos(2.0 * np.pi * f * t + p) for a, f, p in phases], axis=0)
    seen = noise * np.random.default_rng(7).normal(size=(samples, draws))
    x, v, before = np.full(draws, target[0]), np.full(draws, speed[0]), None
    inputs, h = np.empty((samples, draws)), dt / parts
    for k in range(samples):
        seen[k] += x
        rate = speed[k] if before is None else (seen[k] - before) / dt
        push = inputs[k] = MASS * (OMEGA**2 * (target[k] - seen[k]) + 1.4 * OMEGA * (speed[k] - rate))
        before = seen[k]
        for _ in range(parts):
            free = (v * (1.0 - 0.5 * h * VISCOUS / MASS) + h * push / MASS) / (1.0 + 0.5 * h * VISCOUS / MASS)
            after = np.sign(free) * np.maximum(np.abs(free) - h * COULOMB / MASS, 0.0)
            x, v = x + 0.5 * h * (v + after), after
    return inputs.T, seen.T, target


def _estimates(noise, draws, *, by_reference=False, cutoff=None, every=1):
    from benchmarks.rivals.inverse_dynamics import inverse_dynamics

    inputs, seen, target = _closed_loop(noise, draws)
    instruments = [target] if by_reference else None
    done = [
        inverse_dynamics([(u, x, 1e-3)], 1.0, cutoff, 0.05, every=every, instruments=instruments)
        for u, x in zip(inputs, seen, strict=True)
    ]
    return np.array([values for values, _ in done]), np.array([errors for _, errors in done])


FILTERED = {"cutoff": 30.0, "every": 1}
DECIMATED = {"cutoff": None, "every": 10}


@pytest.mark.parametrize("options", [FILTERED, DECIMATED], ids=["filtered", "decimated"])
def test_inverse_dynamics_finds_the_truth_without_noise(options):
    values, _ = _estimates(0.0, 1, **options)
    # What is left is the five steps a sample of the simulation, and what the reversals send through the filter.
    np.testing.assert_allclose(values[0], TRUTH, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("options", [FILTERED, DECIMATED], ids=["filtered", "decimated"])
def test_inverse_dynamics_is_biased_in_closed_loop(options):
    """The mass comes out too small: the controller pushes against the noise that the second difference magnifies."""
    draws = 40
    values, errors = _estimates(100e-6, draws, **options)
    bias = values.mean(axis=0) - TRUTH
    assert bias[0] < -3.0 * values[:, 0].std(ddof=1) / np.sqrt(draws)
    # Nor do the standard errors that each fit reports cover it.
    assert bias[0] < -3.0 * errors[:, 0].mean()
    assert bias[0] < -0.02 * MASS


def test_the_bias_of_inverse_dynamics_goes_with_the_variance_of_the_noise():
    means = [_estimates(noise, 40, **FILTERED)[0][:, 0].mean() - MASS for noise in (50e-6, 100e-6)]
    assert 3.0 < means[1] / means[0] < 5.0


@pytest.mark.parametrize("options", [FILTERED, DECIMATED], ids=["filtered", "decimated"])
def test_instruments_from_the_reference_take_the_bias_away(options):
    draws = 40
    values, errors = _estimates(100e-6, draws, by_reference=True, **options)
    exact, _ = _estimates(0.0, 1, by_reference=True, **options)
    scatter = values.std(axis=0, ddof=1)
    assert np.all(np.abs(values.mean(axis=0) - exact[0]) < 3.5 * scatter / np.sqrt(draws))
    # The reference goes with the motion, so they are not merely vague: 3 % of the mass is found.
    assert scatter[0] < 0.03 * MASS
    assert np.all(scatter < 1.5 * errors.mean(axis=0))


@pytest.mark.parametrize("every", [1, 7])
def test_of_a_free_mass_the_second_difference_is_the_force_between(every):
    from benchmarks.rivals.inverse_dynamics import between, derivatives

    dt, u = 1e-3, np.random.default_rng(3).normal(size=200)
    v = np.concatenate([[0.4], 0.4 + np.cumsum(u) * dt / MASS])
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * dt)])[:-1]
    _, a = derivatives(x, dt, every)
    np.testing.assert_allclose(MASS * a, between(u, every), rtol=0, atol=1e-7)


def test_a_threshold_above_the_motion_is_refused():
    from benchmarks.rivals.inverse_dynamics import inverse_dynamics

    with pytest.raises(ValueError, match="lower `threshold`"):
        inverse_dynamics([(np.ones(100), np.arange(100.0), 1.0)], 1.0, None, 2.0)
