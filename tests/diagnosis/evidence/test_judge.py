"""The judgement: what a model explains, on the recordings it was fitted to and on the held-out ones."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, small_case

from frictionjax.diagnosis.evidence.judgement import (
    Judgement,
    Scene,
    energy_explained,
    explained,
    judge,
)
from frictionjax.diagnosis.evidence.noise_floor import colour
from frictionjax.diagnosis.evidence.recording_fits import recording_fits
from frictionjax.diagnosis.evidence.views import View, held_out_error, view
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import paired_lead
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import Ending, RobustFit
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.parameters import pack
from frictionjax.recordings import Recording

NOISE = np.ones((1, 1))
"""The floor that nothing but noise leaves."""


def _quiet(name, role, samples):
    x = 1e-6 * np.random.default_rng(samples).standard_normal(samples)
    return Recording(name, RATE, np.zeros(samples), x, role=role)


@pytest.fixture(scope="module")
def quiet():
    """A recording held out and a longer one to fit, of which nothing but the shape is used."""
    return make_batch((_quiet("kept", "holdout", 3000), _quiet("fit", "fit", 4000)), encoder_step=FINE)


def test_the_held_out_error_is_that_of_the_recordings_held_out_in_units_of_their_noise(quiet):
    """What is wrong in a fitted recording, or before the scoring begins, is not in it; an overflow is infinite."""
    scene = Scene(quiet, np.array([True, False]), np.full(2, 50.0), ("kept", "fit"))
    x, valid, noise = (np.asarray(part) for part in (quiet.x, quiet.valid, quiet.noise))
    ahead = x + 2.0 * noise[:, None] * np.where(valid > 0, 1.0, 1e6)
    ahead[1] += 1.0
    seen = View(ahead, ahead, x, x, x, x)
    assert held_out_error(seen, scene) == pytest.approx(2.0, rel=1e-6)
    ahead[0, int(np.flatnonzero(valid[0])[5])] = np.nan
    assert held_out_error(seen, scene) == float("inf")


def _judged(batch, power, held_out=(True, False)):
    return Judgement(PLANT, jnp.zeros(9), power, np.array(held_out), batch)


def _powers(batch, fit, holdout):
    """Block powers whose misfits are these."""
    return np.ones(batch.block_count.shape) * (2.0 * np.exp(2.0 * np.array([[holdout], [fit]])) - 1.0)


def test_within_is_reported_for_fitted_and_held_out_recordings(quiet):
    for misfits, stated in (
        ((0.0, 0.0), (True, True)),
        ((0.0, 0.1), (True, False)),
        ((0.1, 0.0), (False, True)),
    ):
        judgement = _judged(quiet, _powers(quiet, *misfits))
        assert judgement.within(NOISE, 0.01) == stated
    # Chance adds three standard errors.
    error = _judged(quiet, _powers(quiet, 0.0, 0.0)).misfit_errors()[0]
    for more, stated in ((2.9, True), (3.1, False)):
        assert _judged(quiet, _powers(quiet, 0.01 + more * error, 0.0)).within(NOISE, 0.01) == (stated, True)


def test_what_raises_all_of_a_recording_by_little_is_the_colour_of_its_noise(quiet):
    """Not what acts in a tenth of the blocks, nor all of what triples their power; and a quieter one stays."""
    shape = quiet.block_count.shape
    level, posterior = 1.4 * np.ones(shape), robust_posterior(PLANT, quiet, np.array([True, False]))[0]
    raised = 1.3 * level
    raised[0] *= 1.2
    np.testing.assert_allclose(colour(raised, level, posterior), [[1.56], [1.3]])
    scored = np.flatnonzero(np.asarray(quiet.block_count)[0] > 0)
    raised[0, scored[::10]] *= 10.0
    np.testing.assert_allclose(colour(raised, level, posterior), [[1.56], [1.3]])
    np.testing.assert_allclose(colour(3.0 * level, level, posterior), 2.0 * np.ones((2, 1)))
    np.testing.assert_allclose(colour(0.5 * level, level, posterior), np.ones((2, 1)))


@pytest.mark.parametrize("floor", [1.0, 1.4])
@pytest.mark.parametrize(
    ("before", "after", "shares"),
    [
        ((0.4, 0.2), (0.1, 0.2), (0.75, 0.0)),
        ((0.4, 0.2), (0.4, 0.3), (0.0, -0.5)),
        ((0.4, 0.2), (0.0, 0.0), (1.0, 1.0)),
        ((0.0, -0.001), (0.2, 0.2), (0.0, 0.0)),
        # What the recordings held out hardly show is counted against what is adequate, 0.01, and no less.
        ((0.2, 0.001), (0.02, 0.003), (0.9, 0.7)),
        ((0.2, -0.001), (0.02, 0.0), (0.9, 1.0)),
        ((0.008, 0.001), (0.004, 0.003), (0.5, -2.0)),
    ],
)
def test_the_explained_share_is_that_of_the_misfit_above_the_floor(quiet, before, after, shares, floor):
    ground = floor * np.ones(quiet.block_count.shape)
    judged = [_judged(quiet, floor * _powers(quiet, *misfits)) for misfits in (before, after)]
    assert judged[0].misfits(ground) == pytest.approx(before, abs=1e-9)
    assert explained(*judged, ground) == pytest.approx(shares, abs=1e-9)


def _lead(better, other, rows, floor):
    """By how many standard errors a judgement leads the `other` on these `rows`."""
    return paired_lead((other.clusters(floor) - better.clusters(floor))[rows]).in_errors(Rule())


def _with_losses(batch, lead):
    """A judgement whose loss in cluster k of recording r is `lead[r, k]`, in its first block."""
    power = np.ones(batch.block_count.shape)
    count = np.asarray(batch.block_count)
    for row, losses in enumerate(np.asarray(lead, float)):
        for cluster, loss in enumerate(losses):
            power[row, 10 * cluster + 5] = 2.0 * np.exp(2.0 * loss / count[row, 10 * cluster + 5]) - 1.0
    return _judged(batch, power)


def test_a_lead_is_counted_in_its_own_standard_errors(quiet):
    lead = np.array([[1.0, 3.0, 2.0], [2.0, 0.0, 4.0]])
    ours, theirs = _with_losses(quiet, np.zeros((2, 3))), _with_losses(quiet, lead)
    np.testing.assert_allclose(theirs.clusters(NOISE)[:, :3], lead, atol=1e-9)
    rows = np.array([True, True])
    # Clusters in which both are the same (no samples, or no difference) say nothing.
    paired = lead[lead != 0.0]
    expected = paired.sum() / (np.sqrt(5) * paired.std())
    assert _lead(ours, theirs, rows, NOISE) == pytest.approx(expected)
    assert _lead(theirs, ours, rows, NOISE) == -_lead(ours, theirs, rows, NOISE)
    # Three clusters are too few to know their scatter.
    assert _lead(ours, theirs, np.array([True, False]), NOISE) == 0.0


def test_noise_against_noise_leads_by_no_more_than_chance():
    batch = make_batch((_quiet("long", "fit", 40000),), encoder_step=FINE)
    rng = np.random.default_rng(5)
    rows = np.array([True])
    leads = [
        _lead(
            *(
                _judged(batch, 1.0 + 0.1 * rng.standard_normal(batch.block_count.shape), (False,))
                for _ in "ab"
            ),
            rows,
            NOISE,
        )
        for _ in range(400)
    ]
    # Forty clusters: nearly a standard normal deviate.
    assert abs(np.mean(leads)) < 3.0 / np.sqrt(400)
    assert 0.85 < np.std(leads) < 1.25


def test_energy_is_explained_above_the_floor_and_without_the_wildest_blocks(quiet):
    shape = quiet.block_count.shape
    before, after = np.full(shape, 11.0), np.full(shape, 3.5)
    before[:, 10], after[:, 10] = 1e9, 1e9
    shares = energy_explained(_judged(quiet, before), _judged(quiet, after), NOISE)
    # The one block that no model mends counts as the 95 % quantile: ten floors of excess, as the others before.
    blocks = np.sum(np.asarray(quiet.block_count) > 0, axis=1)
    expected = [((n - 1) * 7.5) / (n * 10.0) for n in (blocks[1], blocks[0])]
    assert shares == pytest.approx(expected)


def test_without_excess_no_energy_is_explained(quiet):
    floor = np.full(quiet.block_count.shape, 0.9)
    assert energy_explained(_judged(quiet, floor), _judged(quiet, 0.5 * floor), NOISE) == (0.0, 0.0)


@pytest.fixture(scope="module")
def small():
    """The small case with nothing missing before the slow observer."""
    case = small_case()
    recordings = case.fit_recordings + case.holdout_recordings
    batch = make_batch(recordings, encoder_step=FINE)
    posterior, _ = robust_posterior(PLANT, batch, np.array([r.role == "holdout" for r in recordings]))
    return recordings, posterior.at_bandwidth(SLOW_BANDWIDTH)


def _judge(posterior, drive):
    """`drive` before the recordings of `posterior`, nothing fitted."""
    vector = jnp.concatenate([pack(posterior.layout, drive), jnp.zeros(posterior.fitted[0].size)])
    return judge(posterior, RobustFit(vector, posterior.near(vector), 0.0, Ending.AT_REST))


@pytest.fixture(scope="module")
def judged(small):
    """The true plant, and one with 5 % more Coulomb friction, before the same recordings."""
    wrong = eqx.tree_at(lambda d: d.friction.Fc, PLANT, 1.05 * PLANT.friction.Fc)
    return _judge(small[1], PLANT), _judge(small[1], wrong)


def test_the_truth_is_judged_as_noise(judged):
    true, _ = judged
    fit, holdout = true.misfits(NOISE)
    # A recording of 2.4 s knows its own noise to 2 %, which is 0.02 of misfit.
    assert abs(fit) < 0.02
    assert abs(holdout) < 0.04
    np.testing.assert_array_equal(true.deflection, np.zeros(5))


def test_a_wrong_model_misfits_where_it_is_wrong(judged, small):
    true, wrong = judged
    assert wrong.misfits(NOISE)[1] > 0.1
    names = [recording.name for recording in small[0]]
    lost = dict(zip(names, wrong.clusters(NOISE) - true.clusters(NOISE), strict=True))
    # Coulomb friction shows in sliding: hardly in the stick recording, plainly in the moves.
    assert np.sum(lost["moves"]) > 20.0 * abs(np.sum(lost["stick"]))
    rows = np.ones(len(names), bool)
    assert _lead(true, wrong, rows, NOISE) > 2.5
    share_fit, share_holdout = explained(wrong, true, NOISE)
    assert share_fit == pytest.approx(1.0, abs=0.15)
    assert share_holdout == pytest.approx(1.0, abs=0.15)


def test_clusters_add_up_to_the_misfit(judged):
    _, wrong = judged
    count, loss = np.asarray(wrong.batch.block_count), wrong.clusters(NOISE)
    for rows, misfit in zip((~wrong.held_out, wrong.held_out), wrong.misfits(NOISE), strict=True):
        assert loss[rows].sum() / count[rows].sum() == pytest.approx(misfit, rel=1e-9)
    np.testing.assert_allclose(loss.sum(), losses_of(wrong.power, wrong.batch).sum(), rtol=1e-9)


def test_a_model_that_runs_away_is_judged_and_not_nan(small):
    lost = _judge(small[1], eqx.tree_at(lambda d: d.J, PLANT, jnp.nan))
    assert np.all(np.isfinite(lost.clusters(NOISE)))
    assert min(lost.misfits(NOISE)) > 5.0


def test_views_and_errors_are_those_of_the_recordings(judged, small):
    recordings, posterior = small
    held_out = np.asarray(posterior.fitted[0]) == 0.0
    scene = Scene(posterior.batch, held_out, np.full(held_out.size, 50.0), tuple(r.name for r in recordings))
    true, wrong = (view(judgement, scene, far=True) for judgement in judged)
    fits = recording_fits(recordings, scene, wrong, true, PLANT)
    assert [fit.name for fit in fits] == [r.name for r in recordings]
    for fit, recording in zip(fits, recordings, strict=True):
        n = recording.x.size
        for column in (fit.free_base, fit.predicted_extended, fit.residual_force, fit.residual_force_std):
            assert column.shape == (n,)
        for errors, model in (
            (fit.free_run_rmse_base, fit.free_base),
            (fit.free_run_rmse_extended, fit.free_extended),
        ):
            assert errors == pytest.approx(np.sqrt(np.mean((model - recording.x) ** 2)))
        # The true model predicts a tenth of a second ahead to a few times the noise.
        assert fit.prediction_rmse_extended < 20.0 * fit.noise_floor
        # One sample, 0.1 s and 1 s ahead, and the whole recording, as far as it is twice as long.
        seconds = [horizon.seconds for horizon in fit.horizons]
        own = [
            one for one in (1.0 / recording.sample_rate, 0.1, 1.0) if 2.0 * one <= n / recording.sample_rate
        ]
        assert seconds == pytest.approx([*own, recording.t[-1] - recording.t[0]])
        step, tenth, whole = fit.horizons[0], fit.horizons[1], fit.horizons[-1]
        assert tenth.base == fit.prediction_rmse_base and whole.extended == fit.free_run_rmse_extended
        moved = recording.x[round(0.1 * recording.sample_rate) :]
        moved = moved - recording.x[: moved.size]
        assert tenth.standstill == pytest.approx(np.sqrt(np.mean(moved**2)))
        # One sample ahead the true model is off by the noise of that sample, and by little more.
        assert 0.8 * fit.noise_floor < step.extended < 2.0 * fit.noise_floor
        assert step.extended < tenth.standstill or fit.noise_floor > tenth.standstill
    others = fits[-1]
    # The base model has 5 % too much Coulomb friction, which acts where the machine slides, and in part around it; the
    # extended one is the truth.
    moving = np.mean(np.abs(np.gradient(others.x, others.t)) > 0.05)
    assert others.unmeasured_base.of_coulomb == pytest.approx(0.05 * np.sqrt(moving), rel=0.25)
    assert others.unmeasured_base.of_coulomb > 5.0 * others.unmeasured_extended.of_coulomb
    assert others.unmeasured_base.force == pytest.approx(
        others.unmeasured_base.of_coulomb * float(PLANT.friction.Fc), rel=1e-9
    )
    assert others.prediction_rmse_base > 20.0 * others.prediction_rmse_extended
    # The residual force is the friction that is too much: base minus truth, against the motion.
    sliding = np.abs(np.gradient(others.x, others.t)) > 0.3
    missing = others.residual_force[sliding] * np.sign(np.gradient(others.x, others.t)[sliding])
    assert np.median(missing) == pytest.approx(0.05 * float(PLANT.friction.Fc), rel=0.1)
    # Of the true model only noise is left, where nothing sticks: at rest, force and bristle are hard to tell apart.
    ratio = np.std(others.residual_force_extended[sliding]) / others.residual_force_std[0]
    assert 0.8 < ratio < 1.25
