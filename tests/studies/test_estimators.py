"""The comparison of estimators: each does what theory says of it, judged by the scatter of its own draws."""

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax import InputError, compare_estimators, estimate_frf, fit_sk
from frictionjax.studies import estimator_draws as stage
from frictionjax.studies.level_sweep import table_one
from frictionjax.studies.lugre_fit import Records, equations, positions, theta_of

DRAWS = 40
SK, ML, BREAKAWAY, JOINT = range(4)
QUIET, LOUD = range(2)


@pytest.fixture(scope="module")
def found():
    return compare_estimators(draws=DRAWS, levels=(1e-4, 1e-1), seed=1)


def test_every_draw_arrives(found):
    assert np.mean(found.converged) > 0.97


def test_least_squares_in_the_time_domain_is_unbiased_and_reaches_its_bound(found):
    z = found.bias[BREAKAWAY:, QUIET] / (found.std[BREAKAWAY:, QUIET] / np.sqrt(DRAWS))
    assert np.max(np.abs(z)) < 4.0
    # The standard deviation of n draws is itself known to 1 / sqrt(2 n).
    ratio = found.std[BREAKAWAY:] / found.bound[BREAKAWAY:]
    assert np.max(np.abs(ratio - 1.0)) < 4.0 / np.sqrt(2.0 * DRAWS)
    assert np.min(found.coverage[BREAKAWAY:]) > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / DRAWS)


def test_more_data_never_raise_the_bound(found):
    assert np.all(found.bound[JOINT] < found.bound[BREAKAWAY])
    assert found.bound[JOINT, QUIET, 2] < 0.7 * found.bound[BREAKAWAY, QUIET, 2]


def test_the_response_shows_a_softer_bristle_however_little_noise_there_is(found):
    for e in (SK, ML):
        error = found.std[e, QUIET, 1] / np.sqrt(DRAWS)
        assert found.bias[e, QUIET, 1] < -0.015 * 1e5 < -10.0 * error
        assert found.coverage[e, QUIET, 1] < 0.2
        assert np.all(found.std[e, QUIET, :3] > 5.0 * found.bound[e, QUIET, :3])


def test_noise_biases_sanathanan_koerner_and_not_maximum_likelihood(found):
    stderr = found.std[ML, LOUD, 0] / np.sqrt(DRAWS)
    assert abs(found.bias[ML, LOUD, 0]) < 4.0 * stderr
    assert found.bias[SK, LOUD, 0] < -0.3


def test_the_rows_hold_what_each_estimator_gives(found):
    rows = found.rows
    assert len(rows) == 2 * 2 * 3 + 2 * 2 * 7
    assert {row["parameter"] for row in rows if row["estimator"] == "sk"} == {"J", "sigma0", "sigma1+sigma2"}
    assert all(v is None or isinstance(v, str | bool) or np.isfinite(v) for row in rows for v in row.values())
    vs = next(row for row in rows if row["estimator"] == "joint" and row["parameter"] == "vs")
    assert vs["unit"] == "m/s" and vs["truth"] == pytest.approx(1e-3) and vs["identified"] is True
    assert vs["ratio"] == pytest.approx(vs["std"] / vs["crlb"])
    assert set(found.seconds) == {"sk", "frf_ml", "breakaway", "joint"}


def test_the_sentences_say_what_the_numbers_are(found):
    response, breakaway, joint = found.sentences
    assert "prefer maximum likelihood" in response
    assert f"sigma0 comes out {-100 * found.bias[ML, QUIET, 1] / 1e5:.2g} % too low" in response
    assert "100 % of the draws converge" in breakaway
    gain = np.mean(found.std[BREAKAWAY, :, 2] / found.std[JOINT, :, 2])
    assert f"falls by a factor of {gain:.2f} for sigma1 + sigma2" in joint
    assert all(sentence.endswith(".") and " nan" not in sentence for sentence in found.sentences)


def test_fits_of_many_responses_are_those_of_one(found):
    keys = jnp.tile(jax.random.split(jax.random.key(1), DRAWS), 2)
    sigma = jnp.repeat(jnp.asarray(found.noise), DRAWS)
    lanes = stage.draw(theta_of(table_one()), jnp.asarray(0.1) * 1.5, keys, sigma)
    for level in (QUIET, LOUD):
        u, x = lanes["fast_u"][level * DRAWS], lanes["fast_x"][level * DRAWS]
        frf = estimate_frf(u, x, stage.NOISE_RATE, segment=stage.SEGMENT)
        one = fit_sk(frf, (stage.BAND.low, stage.BAND.high))
        estimates = (one.J, one.stiffness, one.damping)
        np.testing.assert_allclose(found.estimates[ML, level, 0, :3], [e.value for e in estimates], rtol=1e-4)
        np.testing.assert_allclose(found.stderr[ML, level, 0, :3], [e.stderr for e in estimates], rtol=1e-3)


def test_normal_equations_agree_with_finite_differences():
    theta, dt = theta_of(table_one()), jnp.asarray(1.0 / stage.RAMP_RATE)
    u = stage.break_away(jnp.asarray(1.5))
    x = positions(theta, u, dt)
    shifts = 1e-5 * jnp.concatenate([jnp.eye(7), -jnp.eye(7)])
    runs = jax.jit(jax.vmap(lambda shift: positions(theta + shift, u, dt)))(shifts)
    columns = (runs[:7] - runs[7:]) / 2e-5
    miss = 1e-6 * jnp.sin(0.37 * jnp.arange(float(x.size)))
    records = Records(u[None], (x + miss)[None], dt)
    cost, normal, gradient = equations(theta[None], records, jnp.full(1, 2.0), jnp.zeros(()))
    size = np.sqrt(np.diag(np.asarray(columns @ columns.T)))
    assert float(cost[0]) == pytest.approx(float(miss @ miss) / 4.0, rel=1e-6)
    # The cheap derivatives are within 0.2 % of the exact ones in each column.
    np.testing.assert_allclose(
        normal[0] * 4.0 / np.outer(size, size), columns @ columns.T / jnp.outer(size, size), atol=4e-3
    )
    np.testing.assert_allclose(
        gradient[0] * 4.0 / size, columns @ miss / size, atol=4e-3 * float(jnp.linalg.norm(miss))
    )


@pytest.mark.parametrize("threads", [0, 2])
def test_parts_come_back_in_order_whoever_works(threads):
    reported, widths = [], []

    def double(lanes):
        widths.append(lanes.size)
        return 2 * lanes

    pool = ThreadPoolExecutor(threads) if threads else None
    out, seconds = stage.in_parts(double, jnp.arange(7), 3, pool, reported.append)
    if pool:
        pool.shutdown()
    np.testing.assert_array_equal(out, 2 * np.arange(7))
    assert widths == [3, 3, 3] and reported == pytest.approx([1 / 3, 2 / 3, 1.0]) and seconds > 0.0


@pytest.mark.parametrize("bad", [{"draws": 1}, {"levels": (0.0,)}, {"levels": ()}, {"excitation": -0.1}])
def test_bad_settings_get_a_sentence(bad):
    with pytest.raises(InputError, match=r"Give two draws or more, one positive level or more"):
        compare_estimators(**bad)
