"""Fisher information by automatic derivatives: against finite differences, against scatter, and its scaling laws."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_information import PRESLIDING, RATE, SLIDING, N, plan
from helpers_plants import PLANTS, ROTARY, TABLE_I, effect

from frictionjax.core import InputError
from frictionjax.information import fisher
from frictionjax.information.fisher import fisher_information, inverse_information
from frictionjax.simulation import simulate

NAMES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")


def position(drive, logs, u, v0=0.0):
    """Positions with the logarithms of the parameters moved by `logs`, started from rest or steady sliding."""
    f, factor = drive.friction, dict(zip(NAMES, np.exp(logs), strict=True))
    friction = type(f)(**{name: getattr(f, name) * factor[name] for name in NAMES[1:]})
    moved = eqx.tree_at(lambda d: (d.J, d.friction), drive, (drive.J * factor["J"], friction))
    z0 = np.sign(v0) * moved.friction.level(v0) / friction.sigma0
    return np.asarray(simulate(moved, u, RATE, v0=v0, z0=z0).x)


def differences(drive, u, v0=0.0, step=1e-5):
    """Sensitivities of the positions by central differences, shape `(n, 7)`."""
    ends = [[position(drive, sign * step * row, u, v0) for sign in (1.0, -1.0)] for row in np.eye(7)]
    return np.stack([(up - down) / (2.0 * step) for up, down in ends], axis=1)


@pytest.mark.parametrize("plant", PLANTS)
def test_it_is_that_of_finite_differences(plant):
    drive = PLANTS[plant]
    inputs, v0, noise = plan(drive)
    found = fisher_information(drive, inputs, RATE, noise, v0=v0)
    for part, u, start in zip(found.parts, inputs, v0, strict=True):
        columns = differences(drive, u, start) / noise
        size = np.sqrt(np.diag(part))
        size = np.maximum(size, 1e-5 * np.max(size))
        np.testing.assert_allclose(
            part / np.outer(size, size), columns.T @ columns / np.outer(size, size), atol=2e-5
        )
    np.testing.assert_allclose(found.matrix, found.parts.sum(0), rtol=1e-15)


def test_the_bound_is_the_scatter_of_gauss_newton_steps():
    inputs, _, noise = plan(ROTARY)
    u, free = inputs[PRESLIDING], ("J", "sigma0", "sigma1", "Fs")
    columns = differences(ROTARY, u)[:, [NAMES.index(name) for name in free]]
    draws = 2000
    y = noise * np.random.default_rng(5).standard_normal((N, draws))
    steps = np.linalg.lstsq(columns, y, rcond=None)[0]
    bound = np.array([fisher_information(ROTARY, u, RATE, noise, free=free).std[name] for name in free])
    # The variance of m draws has the relative standard error sqrt(2 / m).
    assert np.all(np.abs(np.mean(steps**2, axis=1) / bound**2 - 1.0) < 4.0 * np.sqrt(2.0 / draws))


def test_full_fits_of_noisy_draws_scatter_as_bound():
    """Two steps of Gauss and Newton from a wrong start, with the derivatives made anew: not linear any more."""
    inputs, _, noise = plan(ROTARY)
    u, free, draws = inputs[PRESLIDING], ("J", "sigma0", "sigma1"), 24
    places = [NAMES.index(name) for name in free]
    truth, rng, ends = position(ROTARY, np.zeros(7), u), np.random.default_rng(6), []
    bound = np.array([fisher_information(ROTARY, u, RATE, noise, free=free).std[name] for name in free])
    for _ in range(draws):
        y, theta = truth + noise * rng.standard_normal(N), np.zeros(7)
        theta[places] = 0.01
        for _ in range(2):
            f, shift = position(ROTARY, theta, u), 1e-5 * np.eye(7)[places]
            columns = np.stack([(position(ROTARY, theta + row, u) - f) / 1e-5 for row in shift], axis=1)
            theta[places] += np.linalg.lstsq(columns, y - f, rcond=None)[0]
        ends.append(theta[places])
    assert np.all(np.abs(np.mean(np.square(ends), axis=0) / bound**2 - 1.0) < 4.0 * np.sqrt(2.0 / draws))


@pytest.mark.parametrize("plant", PLANTS)
def test_what_does_not_show_leaves_the_others_their_bounds(plant):
    """Sliding at a speed shows nothing of the bristle: the bounds are those of a QR with it known."""
    drive = PLANTS[plant]
    inputs, v0, noise = plan(drive)
    found = fisher_information(drive, inputs[SLIDING], RATE, noise, v0=v0[SLIDING]).std
    columns = differences(drive, inputs[SLIDING], v0[SLIDING], 1e-4)[:, [0, 3, 4]] / noise
    size = np.linalg.norm(columns, axis=0)
    bound = np.linalg.norm(np.linalg.inv(np.linalg.qr(columns / size)[1]), axis=1) / size
    np.testing.assert_allclose([found[name] for name in ("J", "sigma2", "Fc")], bound, rtol=1e-3)
    assert all(np.isinf(found[name]) for name in ("sigma0", "sigma1", "Fs", "vs"))


def test_scaling_laws():
    inputs, v0, noise = plan(TABLE_I)
    once = fisher_information(TABLE_I, inputs, RATE, noise, v0=v0)
    loud = fisher_information(TABLE_I, inputs, RATE, 2.0 * noise, v0=v0)
    twice = fisher_information(TABLE_I, inputs * 2, RATE, noise, v0=v0 * 2)
    for name in NAMES:
        assert loud.std[name] == pytest.approx(2.0 * once.std[name], rel=1e-9)
        assert twice.std[name] == pytest.approx(once.std[name] / np.sqrt(2.0), rel=1e-6)
        assert (once + once).std[name] == pytest.approx(twice.std[name], rel=1e-6)
    np.testing.assert_array_equal(once.of(1).matrix, once.parts[1])


def test_more_parameters_or_less_data_never_help():
    inputs, v0, noise = plan(ROTARY)
    whole = fisher_information(ROTARY, inputs, RATE, noise, v0=v0)
    fewer = fisher_information(ROTARY, inputs, RATE, noise, v0=v0, free=("sigma0", "J"))
    assert fewer.names == ("sigma0", "J")
    for name in fewer.names:
        assert fewer.std[name] <= whole.std[name] <= whole.of(PRESLIDING).std[name]
    np.testing.assert_allclose(fewer.matrix, whole.matrix[np.ix_([1, 0], [1, 0])], rtol=1e-9)


def test_experiments_of_other_lengths_rates_and_noises():
    inputs, _, noise = plan(ROTARY)
    plans = [inputs[0], inputs[1][:400]]
    both = fisher_information(ROTARY, plans, [RATE, 1000.0], [noise, 3.0 * noise])
    alone = fisher_information(ROTARY, plans[1], 1000.0, 3.0 * noise)
    np.testing.assert_array_equal(both.parts[1], alone.matrix)


def test_strengths_of_effects_count_in_their_own_units():
    inputs, v0, noise = plan(TABLE_I)
    drive = TABLE_I.with_effects(effect("ConstantLoad"))
    found = fisher_information(drive, inputs, RATE, noise, v0=v0)
    assert (found.names[-1], found.logs[-1], found.scale[-1]) == ("load", False, 1.0)
    # A constant load of the size of the step is a change of the input by it.
    up, down = (np.asarray(simulate(TABLE_I, inputs[0] - s, RATE).x) for s in (1e-4, -1e-4))
    expected = np.sum(((up - down) / 2e-4 / noise) ** 2)
    assert found.parts[0, -1, -1] == pytest.approx(expected, rel=1e-5)


def test_a_known_deflection_at_the_start_may_be_given():
    inputs, v0, noise = plan(TABLE_I)
    steady = fisher_information(TABLE_I, inputs[SLIDING], RATE, noise, v0=v0[SLIDING])
    given = fisher_information(TABLE_I, inputs[SLIDING], RATE, noise, v0=v0[SLIDING], z0=0.0)
    assert np.isinf(steady.std["sigma0"]) and np.isfinite(given.std["sigma0"])


def test_other_numbers_compile_nothing():
    inputs, v0, noise = plan(ROTARY)
    programs = fisher._information._cached  # the function below equinox's wrapper
    fisher_information(ROTARY, inputs, RATE, noise, v0=v0)
    before = programs._cache_size()
    other, v0, noise = plan(TABLE_I)
    fisher_information(TABLE_I, other, 1500, 3.0 * noise, v0=v0, x0=1.0)
    assert programs._cache_size() == before


def test_the_inverse_knows_what_is_lost():
    singular = np.array([[1e12, -1e6, 0.0], [-1e6, 1.0, 0.0], [0.0, 0.0, 4.0]])
    found = np.diag(inverse_information(singular))
    assert found[0] > 1e6 and found[1] > 1e6 and found[2] == pytest.approx(0.25)
    regular = np.array([[4e12, 1e6], [1e6, 2.0]])
    np.testing.assert_allclose(inverse_information(regular), np.linalg.inv(regular), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": []}, "at least one input"),
        ({"inputs": [np.full(5, np.nan)]}, "experiment 0"),
        ({"inputs": [np.ones((5, 2))]}, "shape"),
        ({"inputs": [np.zeros(N)]}, "does not move"),
        ({"noise": -1e-9}, "`noise`.*positive"),
        ({"noise": np.nan}, "`noise`.*positive"),
        ({"noise": [1.0, 1.0]}, "`noise`.*one for each"),
        ({"sample_rate": 0.0}, "`sample_rate`.*positive"),
        ({"v0": np.inf}, "`v0`.*finite"),
        ({"free": ("sigma3",)}, "sigma3.*Name some of J"),
        ({"free": ("J", "J")}, "twice"),
        ({"free": ()}, "names none"),
        ({"drive": eqx.tree_at(lambda d: d.friction.sigma2, ROTARY, jnp.asarray(0.0))}, "sigma2 = 0.0"),
        ({"drive": eqx.tree_at(lambda d: d.J, ROTARY, jnp.ones(3))}, "J = .*loop over drives"),
        ({"drive": eqx.tree_at(lambda d: d.J, ROTARY, jnp.asarray(1e-200))}, "not finite"),
    ],
)
def test_bad_input_is_a_sentence(change, words):
    given = {"drive": ROTARY, "inputs": [np.ones(N)], "sample_rate": RATE, "noise": 1e-6} | change
    with pytest.raises(InputError, match=words):
        fisher_information(**given)


def test_two_plans_of_other_drives_are_not_added():
    inputs, _, noise = plan(ROTARY)
    one, two = (fisher_information(d, inputs[:1], RATE, noise) for d in (ROTARY, TABLE_I))
    with pytest.raises(ValueError, match="same parameters"):
        one + two
