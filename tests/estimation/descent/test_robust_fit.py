"""The robust fit of the diagnosis: recovers known parameters, knows how well, says what went wrong, compiles once."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import (
    FINE,
    NOISE,
    PLANT,
    RATE,
    VOLT,
    base_fit,
    closed_loop,
    experiment,
    moves,
    open_loop,
    stick_noise,
    truth,
)
from helpers_plants import effect

from frictionjax.core.compile_time import CompileClock
from frictionjax.diagnosis.base_model.fit_base import message_of, parameters_of, said_of_errors
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.estimation import starting_values
from frictionjax.estimation.constraints import Constraints
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.refine import OneFit, Refined, at_start
from frictionjax.estimation.descent.robust import _STEPPER, Ending, RobustFit, _RobustPlace, descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.parameters import changed, effect_layout, pack
from frictionjax.estimation.result import make_result
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.uncertainty import StandardErrors, Uncertainty, covariance_of, estimates
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
def reported():
    """What a fit reported on its progress."""
    return []


@pytest.fixture(scope="module")
def fitted(reported):
    """Four short recordings of a known plant, fitted from what the recordings alone say."""
    recordings = experiment()
    start = starting_values(recordings, motor_constant=KM)
    return base_fit(start.drives, recordings, progress=lambda stage, done: reported.append((stage, done)))


@pytest.fixture(scope="module")
def parameters(fitted):
    return parameters_of(fitted, UNITS)


def test_the_truth_is_recovered_from_starting_values(fitted, parameters):
    _recovered(parameters, truth(PLANT))
    assert fitted.fitted.converged
    assert message_of(fitted) == ""
    # The drive is that which predicts best with one step a sample, the parameters those of finer steps.
    assert truth(fitted.judgement.drive) == pytest.approx(
        {k: e.value for k, e in parameters.items()}, rel=2e-3
    )
    assert max(e.stderr / e.value for e in parameters.values()) < 0.005


def test_at_the_truth_nothing_is_left_but_noise(fitted):
    """The misfit of a true model is zero, as far as four short recordings know their noise (2 % each)."""
    assert abs(fitted.fitted.misfit) < 0.015


def test_standard_errors_carry_units(parameters):
    assert {name: estimate.unit for name, estimate in parameters.items()} == {
        "J": "N*m*s^2/rad",
        "sigma0": "N*m/rad",
        "sigma1": "N*m*s/rad",
        "sigma2": "N*m*s/rad",
        "Fc": "N*m",
        "Fs": "N*m",
        "vs": "rad/s",
    }


def test_the_covariance_is_one(fitted):
    posterior, near = fitted.posterior, fitted.fitted.near
    evaluations, hessian = posterior.evaluated(fitted.fitted.vector), np.asarray(near.hessian)
    (own,), prior = posterior.curvatures(evaluations), np.asarray(posterior.prior)
    np.testing.assert_allclose(own.sum(axis=0) + np.diag(prior**2), hessian, atol=1e-9 * hessian.max())
    covariance = covariance_of(posterior, evaluations, near)
    assert covariance.shape == (11, 11)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12 * np.max(covariance))
    assert np.min(np.linalg.eigvalsh(covariance)) > -1e-9 * np.max(np.diag(covariance))
    # A logarithm's standard error is the relative one.
    J = parameters_of(fitted, UNITS, lacking=True)["J"]
    assert np.sqrt(covariance[0, 0]) == pytest.approx(J.stderr / J.value, rel=1e-6)


def _as_a_fit(posterior, vector):
    """What `fit` states of the same minimum of the same objective."""
    state = at_start(posterior, vector)
    refined = Refined(state, OneFit(np.zeros(0, bool), 1).started(state))
    return make_result(refined, (tuple("abcd"[: posterior.batch.x.shape[0]]),), UNITS, ()).parameters


def test_a_diagnosis_states_the_errors_of_a_fit(fitted, quiet):
    """Two roads to the same values, errors and units: with all parameters determined, and with some by the prior."""
    end = _ended(*quiet)
    for model in (fitted, end):
        stated = parameters_of(model, UNITS, lacking=True)
        assert stated == _as_a_fit(model.posterior, model.fitted.vector)
    by_prior = {name for name, one in stated.items() if one.stderr == np.inf}
    assert {"sigma2", "vs"} <= by_prior < set(stated)


def test_clusters_add_up_to_the_gradient(fitted):
    """But for the prior, the gradient of the cost that was brought down is the sum over clusters of 0.5 s."""
    posterior, vector = fitted.posterior, fitted.fitted.vector
    clusters = np.asarray(fitted.fitted.near.clusters[0])
    off = (vector - posterior.start) * posterior.prior**2
    gradient = np.asarray(posterior.near(vector).gradient - off)
    size = np.sqrt(np.sum(np.asarray(clusters) ** 2, axis=0))
    np.testing.assert_allclose(np.sum(clusters, axis=0) / size, gradient / size, atol=1e-9)


def test_progress_is_reported_in_order(fitted, reported):
    done = [fraction for _, fraction in reported]
    assert done == sorted(done)
    assert 0.0 <= done[0] <= done[-1] <= 1.0
    assert all(stage.startswith("base fit") for stage, _ in reported)


def test_new_numbers_do_not_compile_again(fitted):
    """Numbers are data: new recordings of the same shapes, and new starts, go through the same programs."""
    start = fitted.posterior.drive
    base_fit((start, start), experiment(seed=1))
    clock = CompileClock()
    again = base_fit((_other_start(J=1.02), _other_start(J=0.9, Fc=1.1, vs=2.0)), experiment(seed=2))
    assert clock.seconds == 0.0
    assert again.fitted.misfit < 0.02
    assert again.fitted.converged
    for name, value in truth(PLANT).items():
        assert truth(again.judgement.drive)[name] == pytest.approx(value, rel=0.015), name


def test_the_best_of_several_starts_goes_on(fitted, parameters):
    first = fitted.posterior.drive
    hopeless = eqx.tree_at(
        lambda d: (d.friction.sigma0, d.friction.vs),
        first,
        (first.friction.sigma0 / 300.0, first.friction.vs * 20.0),
    )
    again = base_fit((hopeless, first), experiment())
    for name, found in parameters_of(again, UNITS).items():
        assert abs(found.value - parameters[name].value) < parameters[name].stderr


def test_a_regime_that_the_model_misses_does_not_pull_the_others():
    """Friction that rises with the square of speed, which the base has not: what sticks is fitted all the same."""
    drive = PLANT.with_effects(effect("QuadraticDrag", drag=0.05))
    recordings = experiment(drive=drive)
    found = base_fit((_other_start(J=1.1, sigma0=0.9, Fc=0.95),), recordings)
    assert found.fitted.misfit > 0.03
    for name, tolerance in {"J": 0.01, "sigma0": 0.02, "sigma1": 0.05}.items():
        assert truth(found.judgement.drive)[name] == pytest.approx(truth(PLANT)[name], rel=tolerance), name


@pytest.mark.slow
def test_a_known_inertia_is_kept_and_not_reported():
    found = base_fit((_other_start(Fc=1.1, sigma2=0.8),), experiment(), known_inertia=True)
    parameters = parameters_of(found, UNITS)
    assert "J" not in parameters
    assert float(found.judgement.drive.J) == truth(PLANT)["J"]
    expected = truth(PLANT)
    expected.pop("J")
    _recovered(parameters, expected)


def test_starts_without_finite_predictions_are_refused():
    """A motor constant of 1e300 makes every trajectory overflow."""
    hopeless = eqx.tree_at(lambda drive: drive.motor_constant, PLANT, 1e300 * PLANT.motor_constant)
    with pytest.raises(ValueError, match="No starting value gives finite predictions"):
        base_fit((hopeless,), experiment())


@pytest.fixture(scope="module")
def quiet():
    """Noise at a fiftieth of break-away: hardly anything shows beyond inertia, stiffness and damping."""
    recording = open_loop("quiet", stick_noise(1.2, level=0.02), seed=3)
    return robust_posterior(PLANT, make_batch((recording,), encoder_step=FINE), np.zeros(1, bool))


def _ended(posterior, vector, ending=Ending.AT_REST):
    fitted = RobustFit(vector, posterior.near(vector), float(posterior.misfits([vector])[0]), ending)
    return Model(posterior, fitted, judge(posterior, fitted))


def test_messages_are_sentences(quiet):
    posterior, vector = quiet
    assert message_of(_ended(posterior, vector)) == ""
    assert (
        message_of(_ended(posterior, vector, Ending.STEPS))
        == "The fit stopped while still improving slightly."
    )
    end = _ended(posterior, jnp.asarray(vector).at[0].set(posterior.start[0] + 2.0))
    assert message_of(end) == "At the end of its range: J."
    J = parameters_of(end, UNITS, lacking=True)["J"]
    assert not J.identified and J.stderr == float("inf")
    lost = _ended(posterior, jnp.asarray(vector).at[0].set(jnp.nan))
    for lacking in (True, False):
        assert not any(one.identified for one in parameters_of(lost, UNITS, lacking=lacking).values())


def test_a_strength_may_double_in_a_step_and_a_logarithm_not_leave_its_minimum(quiet):
    """A lag in units of a sample may have to grow forty-fold; logarithms go 1.5 at most."""
    posterior, vector = quiet
    more, longer = extend(posterior, vector, effect("FrictionLag"), plant_scales(PLANT, posterior.batch))
    place = len(more.layout) - 1
    for now, longest in ((0.0, 1.5), (20.0, 20.0)):
        near = more.near(longer)
        slope = jnp.zeros_like(near.gradient).at[jnp.asarray([0, place])].set(-1e6)
        far = eqx.tree_at(lambda n: (n.gradient, n.hessian), near, (slope, jnp.eye(slope.size)))
        there = _RobustPlace(more, 2e-3, changed(longer, place, now), (), far).longest
        step = _STEPPER.step(far.hessian, far.gradient, 0.0, there)
        assert step[place] == longest
        assert step[0] == 1.5


def test_an_elastic_core_that_starts_bent_is_found_in_a_held_out_recording():
    """Nothing slips in it, so that a bend lasts: it moves the innovations more than all that no model would leave."""
    drive = PLANT.with_effects(effect("ElastoPlastic", plasticity=1.0, core=0.6))
    bend, quiet = float(PLANT.friction.Fs / PLANT.friction.sigma0), {"noise": 1e-7, "substeps": 4}
    slow = 0.3 * VOLT * np.sin(2 * np.pi * 0.4 * np.arange(6000) / RATE)
    recordings = (
        open_loop("stick", stick_noise(), seed=1, drive=drive, **quiet),
        open_loop("slow", slow, seed=2, drive=drive, role="holdout", z0=0.05 * bend, **quiet),
    )
    batch = make_batch(recordings, encoder_step=FINE)
    scales = plant_scales(PLANT, batch)
    posterior, vector = robust_posterior(drive, batch, np.array([False, True]), scales=scales)
    found = descend(posterior.at_bandwidth(SLOW_BANDWIDTH), vector, graduate=False)
    assert float(found.vector[-1]) == pytest.approx(0.05, rel=0.02)
    assert float(np.median(np.asarray(found.near.powers[0])[1])) == pytest.approx(1.0, abs=0.15)


def test_a_descent_from_an_overflow_ends_where_it_began(quiet):
    posterior, vector = quiet
    found = descend(posterior, jnp.asarray(vector).at[0].set(jnp.nan))
    assert not found.converged
    assert found.misfit == float("inf")
    assert np.isnan(found.vector[0])
    np.testing.assert_array_equal(found.vector[1:], vector[1:])


def test_what_the_recordings_do_not_hold_is_not_identified(quiet):
    """A parameter without information rests on the prior: its standard error is the prior's, not zero."""
    found = parameters_of(_ended(*quiet), UNITS)
    assert found["J"].identified
    assert found["sigma0"].identified
    for name in ("sigma2", "vs"):
        assert not found[name].identified, f"{name} = {found[name].value} +- {found[name].stderr}"


def test_every_free_parameter_has_a_row_of_its_own(quiet):
    """Cogging and friction along the stroke both call their parameters sine, cosine and period."""
    drive = PLANT.with_effects(effect("Ripple"), effect("PeriodicPositionDependence"))
    layout = effect_layout(drive, {"Fc": 0.5})
    vector = pack(layout, drive)
    posterior = eqx.tree_at(
        lambda p: (p.constraints, p.drive, p.start), quiet[0], (Constraints(layout, (), ()), drive, vector)
    )
    known = StandardErrors(np.eye(6), np.eye(6), np.ones(6))
    assert len(estimates(posterior, Uncertainty(vector, known, np.zeros(6, bool)), {})) == 6


def test_an_effect_of_zero_strength_changes_no_misfit(quiet):
    """`extend` keeps ranges, prior and observer; the parameters stand before the starting deflections."""
    posterior, vector = quiet
    vector = jnp.asarray(vector).at[0].add(0.01).at[-1].set(0.1)
    more, longer = extend(posterior, vector, effect("Creep"), plant_scales(PLANT, posterior.batch))
    assert [free.label for free in more.layout[len(posterior.layout) :]] == ["compliance", "time_constant"]
    assert longer.shape[0] == vector.shape[0] + 2
    assert float(longer[-1]) == 0.1
    assert more.misfits([longer])[0] == pytest.approx(posterior.misfits([vector])[0], rel=1e-9)
    assert float(more.near(longer).cost) == pytest.approx(float(posterior.near(vector).cost), rel=1e-9)


@pytest.mark.slow
def test_sliding_alone_recovers_the_truth():
    """Guesses of the stiffness are corrected by the reversals."""
    more = moves(positions=(-0.2, 0.1, 0.3), durations=(0.4, 0.3, 0.5))
    recordings = (closed_loop("moves", moves(), seed=4), closed_loop("more", more, seed=5))
    found = base_fit(starting_values(recordings, motor_constant=KM).drives, recordings)
    _recovered(parameters_of(found, UNITS), truth(PLANT))


def test_finer_steps_take_out_what_one_step_a_sample_costs():
    """Simulated with sixteen steps a sample and a fiftieth of the noise: a descent takes one step, and is biased."""
    batch = make_batch(experiment(noise=0.02 * NOISE, seed=3, substeps=16), encoder_step=0.02 * FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(4, bool))
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    found = descend(slow, vector, graduate=False)
    parameters = parameters_of(Model(slow, found, judge(slow, found)), UNITS)
    coarse, expected = truth(slow.drive_of(found.vector)), truth(PLANT)
    fine = {name: estimate.value for name, estimate in parameters.items()}

    def farthest(values):
        return max(abs(values[name] - expected[name]) / parameters[name].stderr for name in expected)

    assert farthest(coarse) > 5.0
    assert farthest(fine) < 3.0


@pytest.mark.slow
def test_errors_of_a_gap_are_said_to_be_too_small(fitted):
    scales = plant_scales(PLANT, fitted.posterior.batch)
    for name, said in (("Backlash", "Backlash makes the motion chaotic"), ("Creep", "")):
        posterior, vector = extend(fitted.posterior, fitted.fitted.vector, effect(name), scales)
        with_effect = RobustFit(vector, posterior.near(vector), 0.0, Ending.AT_REST)
        model = Model(posterior, with_effect, judge(posterior, with_effect))
        stated = said_of_errors(model)
        assert stated.startswith(said)
        assert bool(stated) == bool(said)


@pytest.mark.slow
def test_an_effect_is_fitted_with_the_base():
    drive = PLANT.with_effects(effect("ConstantLoad", load=0.06))
    batch = make_batch(experiment(drive=drive, seed=4), encoder_step=FINE)
    start = PLANT.with_effects(effect("ConstantLoad"))
    posterior, vector = robust_posterior(start, batch, np.zeros(4, bool), scales=plant_scales(PLANT, batch))
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    found = descend(slow, descend(posterior, vector).vector, graduate=False)
    assert found.converged
    parameters = parameters_of(Model(slow, found, judge(slow, found)), UNITS)
    _recovered(parameters, truth(PLANT) | {"load": 0.06})
    assert parameters["load"].unit == "N*m"


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_experiments():
    """Forty experiments with new noise: scatter over stated error, gated by the scatter's own standard error.

    The recordings have no unmeasured force; the integration error of the steps of a fit counts as one, and stated
    errors are up to twice the scatter.
    """
    count = 40
    fits = [parameters_of(base_fit((PLANT,), experiment(seed=seed)), UNITS) for seed in range(count)]
    values = np.array([[e.value for e in found.values()] for found in fits])
    stated = np.sqrt(np.mean([[e.stderr**2 for e in found.values()] for found in fits], axis=0))
    ratio = np.std(values, axis=0, ddof=1) / stated
    allowed = 1.0 + 3.0 / np.sqrt(2.0 * (count - 1))
    assert np.all(ratio < allowed), ratio
    assert np.all(ratio > 0.5 / allowed), ratio
    # A bias far below a thousandth is left by the correction of the bristle, which is not linear in the noise.
    bias = np.mean(values, axis=0) / np.array(list(truth(PLANT).values())) - 1.0
    stderr = np.std(values, axis=0, ddof=1) / np.sqrt(count) / np.array(list(truth(PLANT).values()))
    assert np.all(np.abs(bias) < 3.0 * stderr + 1e-3), bias
