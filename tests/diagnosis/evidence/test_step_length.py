"""How many integration steps a sample a machine needs: one where its error passes for noise, else more."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT, base_fit, experiment
from helpers_plants import effect

import frictionjax as fj
from frictionjax.diagnosis.evidence.step_length import MOST, steps_needed, with_steps
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.evidence.power import sum_clusters
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales

QUIET = 0.02
"""Of the noise: little enough for the error of one step a sample to be seen."""


def _joint(noise):
    """The true model before recordings that were simulated with eight steps a sample."""
    batch = make_batch(experiment(noise=noise * NOISE, seed=3, substeps=8), encoder_step=noise * FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(4, bool))
    return posterior.at_bandwidth(SLOW_BANDWIDTH), vector


@pytest.fixture(scope="module")
def quiet():
    return _joint(QUIET)


def test_one_step_is_enough_where_its_error_passes_for_noise():
    assert steps_needed(*_joint(1.0)) == 1


def test_as_many_steps_as_make_the_error_of_the_integration_pass_for_noise(quiet):
    """One step a sample makes the true model look inadequate beside finest steps; so many do not."""
    posterior, vector = quiet
    steps = steps_needed(posterior, vector)
    assert 1 < steps <= MOST
    one, enough, finest = (with_steps(posterior, n).misfits([vector])[0] for n in (1, steps, 16))
    assert one - finest > Rule().limits.adequate
    assert abs(enough - finest) < Rule().limits.adequate


def test_blocks_that_no_fit_sees_ask_for_no_steps(quiet):
    """The blocks in which the error of the integration is largest are masked."""
    posterior, vector = quiet
    one, finest = (with_steps(posterior, n).powers([vector])[0] for n in (1, 16))
    error = np.abs(one - finest)
    calm = jnp.asarray(np.where(error < 0.05 * np.quantile(error[error > 0.0], 0.9), 1.0, 0.0))
    masked = eqx.tree_at(lambda own: own.weights, posterior, (posterior.weights[0] * calm.ravel(),))
    assert steps_needed(masked, vector) == 1 < steps_needed(posterior, vector)


def test_steps_of_a_batch_are_those_of_its_innovations(quiet):
    posterior, vector = quiet
    finer = with_steps(posterior, 2)
    assert finer.batch.substeps == 2
    count = len(posterior.layout)
    twice = posterior.recordings.with_substeps(2 * posterior.batch.substeps)
    expected = twice.standardised(posterior.drive_of(vector), vector[count:])
    np.testing.assert_allclose(finer.errors_at([vector])[0], expected, rtol=1e-6, atol=1e-6)
    # An effect of no strength, injected, changes nothing at either.
    for own in (posterior, finer):
        present = present_model(own, vector)
        more, longer = extend(
            present.posterior, present.vector, effect("Creep"), plant_scales(PLANT, posterior.batch)
        )
        np.testing.assert_allclose(present.injected([more], [longer])[0], present.e, rtol=1e-6, atol=1e-6)


def test_a_base_fit_keeps_the_steps_it_needs(quiet):
    recordings = experiment(noise=QUIET * NOISE, seed=3, substeps=8)
    found = base_fit((PLANT,), recordings, encoder_step=QUIET * FINE)
    posterior, vector = quiet
    steps = steps_needed(posterior, vector)
    assert found.posterior.batch.substeps == steps
    at_the_truth = float(with_steps(posterior, steps).misfits([vector])[0])
    assert found.fitted.misfit < at_the_truth + 1e-4


def test_a_run_that_is_no_number_asks_for_no_steps(quiet):
    """Only what finer steps correct asks for them."""
    posterior, vector = quiet
    assert steps_needed(posterior, jnp.asarray(vector).at[0].set(jnp.nan)) == 1


def test_bristles_that_ring_faster_than_a_slow_recorder_samples_are_found():
    """30 Hz at 200 Hz, 0.9 rad a sample: more than one step a sample could follow."""
    rate, noise = 200.0, 1e-6
    rng = np.random.default_rng(5)
    friction = fj.LuGre(sigma0=2900.0, sigma1=14.5, sigma2=0.02, Fc=1.1, Fs=1.6, vs=0.08)
    truth = fj.Drive(J=0.0825, friction=friction)
    t = np.arange(1600) / rate
    inputs = {
        "stick": 0.3 * rng.standard_normal(t.size),
        "slow": 1.4 * np.sin(2.0 * np.pi * 0.3 * t),
        "slides": 2.2 * np.sin(2.0 * np.pi * 0.5 * t),
    }
    recordings = []
    for name, u in inputs.items():
        x = np.asarray(fj.simulate(truth, u, rate, substeps=32).x) + noise * rng.standard_normal(t.size)
        recordings.append(fj.Recording(name=name, sample_rate=rate, u=u, x=x, role="fit"))
    batch = make_batch(tuple(recordings), encoder_step=noise)
    assert batch.substeps == 5
    start = fj.Drive(J=0.1, friction=fj.LuGre(sigma0=1000.0, sigma1=5.0, sigma2=0.02, Fc=1.0, Fs=1.8, vs=0.1))
    found = base_fit((start,), recordings, encoder_step=noise)
    drive = found.posterior.drive_of(found.fitted.vector)
    assert found.fitted.misfit < Rule().limits.adequate
    for name in ("sigma0", "sigma1", "Fc", "Fs"):
        np.testing.assert_allclose(getattr(drive.friction, name), getattr(friction, name), rtol=0.02)
    np.testing.assert_allclose(drive.J, 0.0825, rtol=0.01)


def test_the_error_of_the_integration_is_not_significant():
    """A true model before recordings of a fifth of the noise: one step a sample leaves what the tests would take for
    missing physics; by the innovations of finer steps they take it for what it is."""
    posterior, vector = _joint(0.2)
    present = present_model(posterior, vector)
    assert present.posterior.batch.substeps == 1
    coarse = eqx.tree_at(lambda own: own.fine, present, present.e)
    scales = plant_scales(PLANT, posterior.batch)

    def smallest(seen):
        weighings = tuple(
            eqx.tree_at(
                lambda own: own.clusters,
                weighing,
                np.asarray(sum_clusters(_weighted(seen, weighing), posterior.batch.block)),
            )
            for weighing in seen.weighings
        )
        seen = eqx.tree_at(lambda own: own.weighings, seen, weighings)
        trials = [try_form(seen, [effect(name)], scales) for name in ("ElastoPlastic", "ViscoelasticDamping")]
        return min(trial.p_value for some in trials for trial in some)

    assert smallest(coarse) < 1e-3
    assert smallest(present) > 0.02


def _weighted(seen, weighing):
    """Weighted columns of the base model times the innovations that are tested."""
    columns = weighing.base.reshape(weighing.base.shape[0], *seen.e.shape)
    return columns * seen.fine[None]
