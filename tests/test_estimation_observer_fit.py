"""`observer_fit`: recovers known parameters, knows how well, says what went wrong, and compiles once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import (
    FINE,
    PLANT,
    closed_loop,
    experiment,
    moves,
    open_loop,
    stick_noise,
    truth,
)
from helpers_plants import effect

from frictionjax.core import PrecisionError
from frictionjax.core.compile_time import CompileClock
from frictionjax.estimation import starting_values
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.observer_fit import finish, observer_fit
from frictionjax.estimation.parameters import effect_layout, pack
from frictionjax.estimation.problem import make_problem
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.uncertainty import estimates, sandwich
from frictionjax.physics import Drive

KM = float(PLANT.motor_constant)
UNITS = {"force": "N*m", "position": "rad", "input": "V"}


def _recovered(parameters, expected):
    """Every parameter within five of its own standard errors, or 1 % of its value."""
    for name, value in expected.items():
        found = parameters[name]
        assert found.identified, name
        assert abs(found.value - value) < max(5.0 * found.stderr, 0.01 * abs(value)), name


def _other_start(**factors):
    """The plant with some parameters multiplied."""
    numbers = {name: value * factors.get(name, 1.0) for name, value in truth(PLANT).items()}
    J = numbers.pop("J")
    return Drive(J, type(PLANT.friction)(**numbers), KM)


@pytest.fixture(scope="module")
def told():
    """What a fit told of its progress."""
    return []


@pytest.fixture(scope="module")
def fitted(told):
    """Four short recordings of a known plant, fitted from what the recordings alone say."""
    recordings = experiment()
    start = starting_values(recordings, motor_constant=KM)
    return observer_fit(
        start.drives,
        recordings,
        encoder_step=FINE,
        units=UNITS,
        progress=lambda stage, done: told.append((stage, done)),
    )


def test_the_truth_is_recovered_from_starting_values(fitted):
    _recovered(fitted.parameters, truth(PLANT))
    assert fitted.success
    assert fitted.message == "The fit converged."
    assert truth(fitted.drive) == pytest.approx({k: e.value for k, e in fitted.parameters.items()})
    assert max(e.stderr / e.value for e in fitted.parameters.values()) < 0.005


def test_at_the_truth_nothing_is_left_but_noise(fitted):
    """The misfit of a true model is zero, as far as four short recordings know their noise (2 % each)."""
    assert abs(fitted.mismatch) < 0.015


def test_standard_errors_carry_units(fitted):
    units = {name: estimate.unit for name, estimate in fitted.parameters.items()}
    assert units == {
        "J": "N*m*s^2/rad",
        "sigma0": "N*m/rad",
        "sigma1": "N*m*s/rad",
        "sigma2": "N*m*s/rad",
        "Fc": "N*m",
        "Fs": "N*m",
        "vs": "rad/s",
    }
    assert fitted.stderr == {name: estimate.stderr for name, estimate in fitted.parameters.items()}


def test_the_covariance_is_one(fitted):
    covariance = fitted.covariance
    assert covariance.shape == (11, 11)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12 * np.max(covariance))
    assert np.min(np.linalg.eigvalsh(covariance)) > -1e-9 * np.max(np.diag(covariance))
    # A logarithm's standard error is the relative one.
    assert np.sqrt(covariance[0, 0]) == pytest.approx(
        fitted.stderr["J"] / fitted.parameters["J"].value, rel=1e-6
    )


def test_progress_is_told_in_order(fitted, told):
    done = [fraction for _, fraction in told]
    assert done == sorted(done)
    assert 0.0 <= done[0] <= done[-1] <= 1.0
    assert all(stage.startswith("base fit") for stage, _ in told)


def test_new_recordings_do_not_compile_again(fitted):
    """Numbers are data: new ones of the same shapes go through the same programs."""
    recordings, start = experiment(seed=1), fitted.problem.setting.drive
    observer_fit(
        (start, start), recordings, encoder_step=FINE, units=UNITS
    )  # one start, two: small programs differ
    clock = CompileClock()
    again = observer_fit((start, start), experiment(seed=2), encoder_step=FINE, units=UNITS)
    assert clock.seconds == 0.0
    assert again.mismatch < 0.02


def test_new_starting_values_do_not_compile_again(fitted):
    recordings = experiment(seed=1)
    clock = CompileClock()
    again = observer_fit(
        (_other_start(J=1.02), _other_start(J=0.9, Fc=1.1, vs=2.0)),
        recordings,
        encoder_step=FINE,
        units=UNITS,
    )
    assert clock.seconds == 0.0
    _recovered(again.parameters, truth(PLANT))


def test_the_best_of_several_starts_goes_on(fitted):
    first = fitted.problem.setting.drive
    hopeless = eqx.tree_at(
        lambda d: (d.friction.sigma0, d.friction.vs),
        first,
        (first.friction.sigma0 / 300.0, first.friction.vs * 20.0),
    )
    again = observer_fit((hopeless, first), experiment(), encoder_step=FINE, units=UNITS)
    for name, found in again.parameters.items():
        assert abs(found.value - fitted.parameters[name].value) < fitted.stderr[name]


def test_a_start_without_viscous_friction_is_fitted_or_refused(fitted):
    """The logarithm of zero must not leave a fit where it began, and call it converged."""
    first = fitted.problem.setting.drive
    start = eqx.tree_at(
        lambda d: (d.friction.sigma2, d.friction.Fc),
        first,
        (0.0 * first.friction.sigma2, 1.1 * first.friction.Fc),
    )
    try:
        found = observer_fit((start, start), experiment(), encoder_step=FINE, units=UNITS)
    except ValueError as error:
        assert "sigma2" in str(error)
    else:
        assert found.parameters["Fc"].value == pytest.approx(truth(PLANT)["Fc"], rel=0.01)


@pytest.mark.slow
def test_a_known_inertia_is_kept_and_not_reported():
    found = observer_fit(
        _other_start(Fc=1.1, sigma2=0.8), experiment(), encoder_step=FINE, known_inertia=True
    )
    assert "J" not in found.parameters
    assert float(found.drive.J) == truth(PLANT)["J"]
    expected = truth(PLANT)
    expected.pop("J")
    _recovered(found.parameters, expected)


def test_no_recording_is_an_error():
    with pytest.raises(
        ValueError, match=r"`recordings` is empty; `observer_fit` needs at least one recording\."
    ):
        observer_fit(PLANT, ())


def test_starts_without_finite_predictions_are_refused():
    """A motor constant of 1e300 makes every trajectory overflow."""
    hopeless = eqx.tree_at(lambda drive: drive.motor_constant, PLANT, 1e300 * PLANT.motor_constant)
    with pytest.raises(ValueError, match="No starting value gives finite predictions"):
        observer_fit(hopeless, experiment(), encoder_step=FINE)


def test_float32_is_refused():
    recordings = experiment()
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="jax_enable_x64"):
        observer_fit(PLANT, recordings)


@pytest.fixture(scope="module")
def quiet():
    """Noise at a fiftieth of break-away: hardly anything shows beyond inertia, stiffness and damping."""
    recording = open_loop("quiet", stick_noise(1.2, level=0.02), seed=3)
    return make_problem(PLANT, make_batch((recording,), encoder_step=FINE))


def test_messages_are_sentences(quiet):
    problem, vector = quiet
    done = finish(problem, vector, True, UNITS)
    assert (done.success, done.message) == (True, "The fit converged.")
    stopped = finish(problem, vector, False, UNITS)
    assert (stopped.success, stopped.message) == (False, "The fit stopped while still improving slightly.")
    end = finish(problem, vector.at[0].set(problem.setting.start[0] + 2.0), True, UNITS)
    assert end.message == "The fit converged. At the end of its range: J."
    assert not end.parameters["J"].identified
    assert end.stderr["J"] == float("inf")
    lost = finish(problem, vector.at[0].set(jnp.nan), True, UNITS)
    assert not lost.success
    assert lost.message.endswith("The derivatives overflow at the solution: no standard errors can be given.")
    assert not any(estimate.identified for estimate in lost.parameters.values())


def test_what_the_recordings_do_not_hold_is_not_identified(quiet):
    """A parameter without information rests on the prior: its standard error is the prior's, not zero."""
    problem, vector = quiet
    found = finish(problem, vector, True, UNITS).parameters
    assert found["J"].identified
    assert found["sigma0"].identified
    for name in ("sigma2", "vs"):
        assert not found[name].identified, f"{name} = {found[name].value} +- {found[name].stderr}"


def test_every_free_parameter_has_a_row_of_its_own(quiet):
    """Cogging and friction along the stroke both call their parameters sine, cosine and period."""
    drive = PLANT.with_effects(effect("Ripple"), effect("PeriodicPositionDependence"))
    layout = effect_layout(drive, {"Fc": 0.5})
    vector = pack(layout, drive)
    setting = eqx.tree_at(lambda s: (s.drive, s.start), quiet[0].setting, (drive, vector))
    assert len(estimates(layout, vector, setting, np.eye(6), {})) == 6


def test_sandwich_of_independent_noise_is_the_inverse_information():
    """Linear regression with white noise: (X'X)^-1, for clusters that are many and large enough."""
    rng = np.random.default_rng(3)
    X = rng.standard_normal((20000, 3)) @ np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 2.0]])
    e = rng.standard_normal(20000)
    gradients = (X * e[:, None]).reshape(400, 50, 3).sum(1)
    found = sandwich(X.T @ X, gradients)
    # A variance from 400 clusters has a relative standard error of sqrt(2/400).
    np.testing.assert_allclose(np.diag(found), np.diag(np.linalg.inv(X.T @ X)), rtol=3.0 * np.sqrt(2.0 / 400))


def test_sandwich_sees_what_correlates_inside_a_cluster():
    """A regressor and an error that are constant over each cluster: fifty samples are worth one."""
    rng = np.random.default_rng(4)
    x, e = (np.repeat(rng.standard_normal(2000), 50) for _ in range(2))
    gradients = (x * e).reshape(2000, 50).sum(1)[:, None]
    found = sandwich(np.array([[x @ x]]), gradients)[0, 0]
    assert found == pytest.approx(50.0 / (x @ x), rel=3.0 * np.sqrt(2.0 / 2000) * 2.0)


@pytest.mark.slow
def test_sliding_alone_recovers_the_truth():
    """Guesses of the stiffness are mended by what the reversals show."""
    more = moves(positions=(-0.2, 0.1, 0.3), durations=(0.4, 0.3, 0.5))
    recordings = (closed_loop("moves", moves(), seed=4), closed_loop("more", more, seed=5))
    found = observer_fit(starting_values(recordings, motor_constant=KM).drives, recordings, encoder_step=FINE)
    _recovered(found.parameters, truth(PLANT))


@pytest.mark.slow
def test_a_fine_simulation_is_recovered_too():
    """Simulated with four steps a sample: what one step a sample costs is below 1.5 % of any parameter."""
    recordings = experiment(substeps=4, seed=3)
    found = observer_fit(_other_start(Fc=0.9), recordings, encoder_step=FINE)
    for name, value in truth(PLANT).items():
        assert found.parameters[name].value == pytest.approx(value, rel=0.015)


@pytest.mark.slow
def test_an_effect_is_fitted_with_the_base():
    drive = PLANT.with_effects(effect("ConstantLoad", load=0.06))
    recordings = experiment(drive=drive, seed=4)
    batch = make_batch(recordings, encoder_step=FINE)
    start = PLANT.with_effects(effect("ConstantLoad"))
    found = observer_fit(start, recordings, encoder_step=FINE, scales=plant_scales(PLANT, batch), units=UNITS)
    _recovered(found.parameters, truth(PLANT) | {"load": 0.06})
    assert found.parameters["load"].unit == "N*m"


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_experiments():
    """Forty experiments with new noise: scatter over stated error, gated by the scatter's own standard error.

    The innovations of the observer are negatively correlated at low frequencies, across the borders of the
    clusters too: stated errors are larger than the scatter for what shows in smooth motion (up to 1.7 times).
    """
    count = 40
    fits = [observer_fit(PLANT, experiment(seed=seed), encoder_step=FINE) for seed in range(count)]
    values = np.array([[e.value for e in found.parameters.values()] for found in fits])
    stated = np.sqrt(np.mean([[e.stderr**2 for e in found.parameters.values()] for found in fits], axis=0))
    ratio = np.std(values, axis=0, ddof=1) / stated
    allowed = 1.0 + 3.0 / np.sqrt(2.0 * (count - 1))
    assert np.all(ratio < allowed), ratio
    assert np.all(ratio > 0.5 / allowed), ratio
    # A bias far below a thousandth is left by the correction of the bristle, which is not linear in the noise.
    bias = np.mean(values, axis=0) / np.array(list(truth(PLANT).values())) - 1.0
    stderr = np.std(values, axis=0, ddof=1) / np.sqrt(count) / np.array(list(truth(PLANT).values()))
    assert np.all(np.abs(bias) < 3.0 * stderr + 1e-3), bias
