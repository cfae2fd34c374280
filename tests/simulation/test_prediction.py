"""`predict_ahead`: free runs from corrected states, each sample by the run that the definition names."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import TABLE_I, effect

from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation import observe, observer_gains, predict_ahead, simulate

observe = eqx.filter_jit(observe)

RATE, N = 2000.0, 300
DT = jnp.asarray(1.0 / RATE)
GAINS = observer_gains(100.0, DT)
ZERO = (jnp.zeros(()),) * 3
U = 1.5 * np.concatenate(
    [0.3 * np.random.default_rng(4).normal(size=N // 2), 2.0 * np.sin(0.1 * np.arange(N // 2))]
)
FORCE = jnp.asarray(U)
NOISE = 1e-7 * np.random.default_rng(6).normal(size=N)


@pytest.mark.parametrize(("horizon", "stride"), [(40, 7), (200, 5)])
def test_the_true_model_without_noise_predicts_the_truth(horizon, stride):
    truth = simulate(TABLE_I, U, RATE).x
    ahead = predict_ahead(TABLE_I, FORCE, truth, DT, GAINS, ZERO, horizon=horizon, stride=stride, substeps=2)
    np.testing.assert_allclose(ahead, truth, atol=1e-9 * float(jnp.ptp(truth)))


@pytest.mark.parametrize(("horizon", "stride"), [(10, 4), (11, 5), (1, 6), (59, 3), (60, 2), (75, 2)])
def test_each_sample_comes_from_the_run_that_it_should(horizon, stride):
    """Against `simulate`, started over and over from the states that the observer has corrected."""
    model, n = Drive(1.1, TABLE_I.friction), 60
    x = simulate(TABLE_I, U[:n], RATE).x + NOISE[:n]
    seen = observe(model, FORCE[:n], x, DT, GAINS, ZERO)
    moved, faster = GAINS.position * seen.innovation, GAINS.velocity * seen.innovation
    limit = jax.vmap(model.friction.level)(seen.v + faster) / model.friction.sigma0
    stuck = jnp.maximum(0.0, 1.0 - jnp.abs(seen.z[:, 0]) / limit)
    corrected = (seen.x + moved, seen.v + faster, seen.z[:, 0] + moved * stuck)
    expected = np.asarray(seen.x).copy()
    padded = np.concatenate([U[:n], np.zeros(n)])
    for k in range(0, n - horizon, stride):
        x0, v0, z0 = (part[k] for part in corrected)
        run = np.asarray(simulate(model, padded[k : k + n], RATE, x0=x0, v0=v0, z0=z0, substeps=1).x)
        reached = run[horizon : horizon + stride][: n - k - horizon]
        expected[k + horizon : k + horizon + reached.size] = reached
    got = predict_ahead(model, FORCE[:n], x, DT, GAINS, ZERO, horizon=horizon, stride=stride)
    np.testing.assert_allclose(got, expected, atol=1e-15)


def test_the_history_before_the_recording_reaches_the_prediction():
    drive = TABLE_I.with_effects(effect("DwellStrengthening", growth=0.1))
    truth = simulate(drive, U[:60], RATE, before=Before(rest=50.0)).x
    found = {
        rest: predict_ahead(
            drive, FORCE[:60], truth, DT, GAINS, (*ZERO, Before(rest=rest)), horizon=40, stride=20, substeps=2
        )
        for rest in (0.1, 50.0)
    }
    np.testing.assert_allclose(found[50.0], truth, atol=1e-9 * float(jnp.ptp(truth)))
    assert float(jnp.max(jnp.abs(found[0.1] - truth))) > 1e-6 * float(jnp.ptp(truth))


def test_a_wrong_model_errs_the_more_the_further_it_looks():
    truth = simulate(TABLE_I, U, RATE).x
    wrong = Drive(1.2, TABLE_I.friction)
    rms = [
        float(
            jnp.sqrt(
                jnp.mean(
                    (predict_ahead(wrong, FORCE, truth, DT, GAINS, ZERO, horizon=h, stride=5) - truth) ** 2
                )
            )
        )
        for h in (1, 10, 40)
    ]
    assert rms[0] < 0.5 * rms[1] < 0.25 * rms[2]


def test_it_knows_effects_and_runs_under_jit():
    drive = TABLE_I.with_effects(effect("MaxwellSlip", share=0.5), effect("ConstantLoad", load=0.1))
    truth = simulate(drive, U, RATE, substeps=1).x

    @jax.jit
    def ahead(force, x):
        return predict_ahead(drive, force, x, DT, GAINS, ZERO, horizon=20, stride=8)

    np.testing.assert_allclose(ahead(FORCE, truth), truth, atol=1e-9 * float(jnp.ptp(truth)))


def test_a_horizon_or_a_record_that_makes_no_sense_is_refused():
    x = jnp.zeros(N)
    for horizon, stride in ((0, 1), (5, 0), (-3, 2)):
        with pytest.raises(ValueError, match="`horizon` is"):
            predict_ahead(TABLE_I, FORCE, x, DT, GAINS, ZERO, horizon=horizon, stride=stride)
    with pytest.raises(ValueError, match=r"`force` has shape \(300,\) and `x` \(299,\)"):
        predict_ahead(TABLE_I, FORCE, x[1:], DT, GAINS, ZERO, horizon=5, stride=1)
