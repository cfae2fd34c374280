"""The judgement: what a model explains, on the recordings it was fitted to and on those kept aside."""

from types import SimpleNamespace

import equinox as eqx
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, small_case

from frictionjax.diagnosis.evaluate import recording_fits, view
from frictionjax.diagnosis.judge import advantage, energy_explained, explained, judge, make_scene
from frictionjax.estimation.batch import make_batch
from frictionjax.recordings import Recording


def _misfits(fit, holdout):
    return SimpleNamespace(misfit_fit=fit, misfit_holdout=holdout)


@pytest.mark.parametrize(
    ("before", "after", "shares"),
    [
        ((0.4, 0.2), (0.1, 0.2), (0.75, 0.0)),
        ((0.4, 0.2), (0.4, 0.3), (0.0, -0.5)),
        ((0.4, 0.2), (0.0, 0.0), (1.0, 1.0)),
        ((0.0, -0.001), (0.2, 0.2), (0.0, 0.0)),
    ],
)
def test_the_explained_share_is_that_of_the_misfit(before, after, shares):
    assert explained(_misfits(*before), _misfits(*after)) == pytest.approx(shares)


def _losses(loss):
    return SimpleNamespace(loss=np.asarray(loss, float))


def test_a_lead_is_counted_in_its_own_standard_errors():
    lead = np.array([[1.0, 3.0, 2.0, 6.0], [2.0, 0.0, 4.0, 1.0]])
    ours, theirs = _losses(np.zeros((2, 4))), _losses(lead)
    rows = np.array([True, True])
    # Clusters in which both are the same (no samples, or no difference) say nothing.
    paired = lead[lead != 0.0]
    assert advantage(ours, theirs, rows) == pytest.approx(paired.sum() / (np.sqrt(7) * paired.std()))
    assert advantage(theirs, ours, rows) == -advantage(ours, theirs, rows)
    only = np.array([True, False])
    assert advantage(ours, theirs, only) == pytest.approx(lead[0].sum() / (2.0 * lead[0].std()))
    few = _losses([[1.0, 3.0, 2.0, 0.0]])
    assert advantage(_losses(np.zeros((1, 4))), few, np.array([True])) == 0.0


def test_noise_against_noise_leads_by_no_more_than_chance():
    rng = np.random.default_rng(5)
    rows = np.array([True])
    leads = [
        advantage(_losses(rng.standard_normal((1, 40))), _losses(rng.standard_normal((1, 40))), rows)
        for _ in range(400)
    ]
    # Forty clusters: nearly a standard normal deviate.
    assert abs(np.mean(leads)) < 3.0 / np.sqrt(400)
    assert 0.85 < np.std(leads) < 1.25


def _quiet(name, role, samples):
    x = 1e-6 * np.random.default_rng(samples).standard_normal(samples)
    return Recording(name, RATE, np.zeros(samples), x, role=role)


@pytest.fixture(scope="module")
def quiet_scene():
    """One recording to fit, a shorter one kept aside, of which nothing but the shape is used."""
    recordings = (_quiet("kept", "holdout", 3000), _quiet("fit", "fit", 4000))
    return make_scene(
        make_batch(recordings, encoder_step=FINE), np.array([True, False]), tuple(r.name for r in recordings)
    )


def test_energy_is_explained_above_the_floor_and_without_the_wildest_blocks(quiet_scene):
    shape = quiet_scene.batch.block_count.shape
    before = np.full(shape, 11.0)
    after = np.full(shape, 3.5)
    before[:, 10], after[:, 10] = 1e9, 1e9
    shares = energy_explained(SimpleNamespace(power=before), SimpleNamespace(power=after), quiet_scene)
    # The one block that no model mends counts as the 95 % quantile: ten floors of excess, as the others before.
    blocks = np.sum(np.asarray(quiet_scene.batch.block_count) > 0, axis=1)
    expected = [((n - 1) * 7.5) / (n * 10.0) for n in (blocks[1], blocks[0])]
    assert shares == pytest.approx(expected)


def test_without_excess_no_energy_is_explained(quiet_scene):
    floor = np.full(quiet_scene.batch.block_count.shape, 0.9)
    lower = SimpleNamespace(power=0.5 * floor)
    assert energy_explained(SimpleNamespace(power=floor), lower, quiet_scene) == (0.0, 0.0)


def test_no_observer_is_faster_than_a_tenth_of_the_sampling(quiet_scene):
    assert quiet_scene.bandwidth == 50.0
    slow = Recording("slow", 200.0, np.zeros(400), 1e-6 * np.random.default_rng(0).standard_normal(400))
    scene = make_scene(make_batch((slow,), encoder_step=FINE), np.array([False]), (slow.name,))
    assert scene.bandwidth == 20.0


@pytest.fixture(scope="module")
def small():
    """The small case with nothing missing, and its scene."""
    case = small_case()
    recordings = case.fit_recordings + case.holdout_recordings
    batch = make_batch(recordings, encoder_step=FINE)
    return recordings, make_scene(
        batch, np.array([r.role == "holdout" for r in recordings]), tuple(r.name for r in recordings)
    )


@pytest.fixture(scope="module")
def judged(small):
    """The true plant, and one with 5 % more Coulomb friction, before the same recordings."""
    wrong = eqx.tree_at(lambda d: d.friction.Fc, PLANT, 1.05 * PLANT.friction.Fc)
    return judge(PLANT, small[1]), judge(wrong, small[1])


def test_the_truth_is_judged_as_noise(judged):
    true, _ = judged
    assert true.structure < 0.01
    # A recording of 2.4 s knows its own noise to 2 %, which is 0.02 of misfit.
    assert abs(true.misfit_fit) < 0.02
    assert abs(true.misfit_holdout) < 0.04
    assert np.max(np.abs(true.deflection)) < 0.2


def test_a_wrong_model_misfits_where_it_is_wrong(judged, small):
    true, wrong = judged
    assert wrong.misfit_holdout > 0.1
    by_name = dict(zip(small[1].names, wrong.loss - true.loss, strict=True))
    # Coulomb friction shows in sliding: hardly in the stick recording, plainly in the moves.
    assert np.sum(by_name["moves"]) > 20.0 * abs(np.sum(by_name["stick"]))
    rows = np.ones(len(small[0]), bool)
    assert advantage(true, wrong, rows) > 2.5
    share_fit, share_holdout = explained(wrong, true)
    assert share_fit == pytest.approx(1.0, abs=0.15)
    assert share_holdout == pytest.approx(1.0, abs=0.15)


def test_clusters_add_up_to_the_misfit(judged, small):
    _, wrong = judged
    count = np.asarray(small[1].batch.block_count)
    for rows, misfit in ((~small[1].held_out, wrong.misfit_fit), (small[1].held_out, wrong.misfit_holdout)):
        assert wrong.loss[rows].sum() / count[rows].sum() == pytest.approx(misfit, rel=1e-9)


def test_a_model_that_runs_away_is_judged_and_not_nan(small):
    runaway = eqx.tree_at(lambda d: d.J, PLANT, 1e-9 * PLANT.J)
    judgement = judge(runaway, small[1])
    assert np.all(np.isfinite(judgement.loss))
    assert judgement.misfit_fit > 5.0


def test_views_and_errors_are_those_of_the_recordings(judged, small):
    recordings, scene = small
    true, wrong = (view(judgement, scene) for judgement in judged)
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
    others = fits[-1]
    assert others.prediction_rmse_base > 20.0 * others.prediction_rmse_extended
    # The residual force is the friction that is too much: base minus truth, against the motion.
    sliding = np.abs(np.gradient(others.x, others.t)) > 0.3
    missing = others.residual_force[sliding] * np.sign(np.gradient(others.x, others.t)[sliding])
    assert np.median(missing) == pytest.approx(0.05 * float(PLANT.friction.Fc), rel=0.1)
    # Of the true model only noise is left, where nothing sticks: at rest, force and bristle are hard to tell apart.
    ratio = np.std(others.residual_force_extended[sliding]) / others.residual_force_std[0]
    assert 0.8 < ratio < 1.25
