"""The rivals of the blind challenge on problems small enough to know the answer."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("numba")

from benchmarks.concealed.rivals.bic import criterion
from benchmarks.concealed.rivals.free_form import features, fitted_force
from benchmarks.concealed.rivals.geometry import geometry
from benchmarks.concealed.rivals.largest_r2 import by_largest_r2, r2_of
from benchmarks.concealed.rivals.sparse import by_sparse_regression, period_of, thresholded
from frictionjax.physics import LuGre

DT = 2e-3
FRICTION = LuGre(sigma0=1e4, sigma1=50.0, sigma2=0.4, Fc=1.0, Fs=1.5, vs=0.02)


def column(effect, values):
    return SimpleNamespace(effect=effect, values=np.asarray(values)[None])


def regression_ground(e, columns, base):
    """What the rivals read of a ground: innovations `e` (r, n), effect columns and base columns `(q, r n)`."""
    gram = base @ base.T
    weighing = SimpleNamespace(weight=np.ones_like(e), base=base, gram=gram, right=base @ e.ravel())
    return SimpleNamespace(present=SimpleNamespace(e=e, weighings=(weighing,)), columns=columns)


def motion_ground(missing):
    """A machine that moves to and fro and lacks the force `missing(x, v, z)`, in two fitted recordings."""
    t = np.arange(6000) * DT
    x = np.stack([np.sin(1.1 * t) + 0.3 * np.sin(3.7 * t), 0.8 * np.sin(1.7 * t + 1.0)])
    v = np.gradient(x, axis=1) / DT
    a = np.gradient(v, axis=1) / DT
    z = 1e-4 * np.tanh(v / 0.05)
    push = a + np.tanh(v / 0.05)
    motion = SimpleNamespace(x=x, v=v, z=z, a=a, u=push, push=push, spring=1e4 * z)
    noise = 0.01 * np.random.default_rng(4).standard_normal(x.shape)
    batch = SimpleNamespace(
        dt=np.full(2, DT), valid=np.ones_like(x), before=SimpleNamespace(clock=np.array([0.0, 30.0]))
    )
    return SimpleNamespace(
        present=SimpleNamespace(motion=motion, posterior=SimpleNamespace(batch=batch)),
        base_view=SimpleNamespace(force=missing(x, v, z) + noise),
        held_out=np.zeros(2, bool),
        batch=batch,
        drive=SimpleNamespace(friction=FRICTION),
        case=SimpleNamespace(plant=SimpleNamespace(position_unit="m")),
    )


def test_largest_r2_does_not_project_and_the_geometry_does():
    rng = np.random.default_rng(1)
    base = rng.standard_normal((2, 400))
    own = rng.standard_normal(400)
    # The mirage lies nearly along a base parameter, which the base fit left slightly off.
    mirage = base[0] + 0.05 * own
    e = (1.0 * base[0] + 0.4 * own).reshape(1, 400)
    ground = regression_ground(
        e, [column("mirage", mirage.reshape(1, 400)), column("truth", own.reshape(1, 400))], base
    )
    assert by_largest_r2(ground)["named"] == "mirage"
    assert r2_of(column("both", e), e, np.ones_like(e)) == pytest.approx(1.0)
    found = geometry(ground)
    assert found["names"] == ["mirage", "truth"]
    assert found["cosines"][0][1] == pytest.approx(1.0, abs=1e-6)
    quiet = regression_ground(rng.standard_normal((1, 400)), ground.columns[1:], base)
    assert by_largest_r2(quiet)["named"] is None


def test_thresholding_keeps_the_terms_that_matter():
    rng = np.random.default_rng(2)
    terms = rng.standard_normal((2000, 6))
    force = 2.0 * terms[:, 1] - 1.0 * terms[:, 4] + 0.05 * terms[:, 2] + 0.1 * rng.standard_normal(2000)
    found = thresholded(terms, force)
    assert np.flatnonzero(found).tolist() == [1, 4]
    assert found[[1, 4]] == pytest.approx([2.0, -1.0], rel=0.02)


def test_the_period_of_a_ripple_is_found():
    x = np.linspace(0.0, 1.0, 20000)
    assert period_of(np.sin(2 * np.pi * x / 0.08), x, np.ones_like(x)) == pytest.approx(0.08, rel=0.05)


@pytest.mark.parametrize(
    ("effect", "force"),
    [
        ("quadratic_drag", lambda x, v, z: -0.3 * v * np.abs(v)),
        ("return_spring", lambda x, v, z: -0.5 * x),
        ("constant_load", lambda x, v, z: 0.4 + 0.0 * x),
    ],
)
def test_sparse_regression_names_a_plain_force(effect, force):
    assert by_sparse_regression(motion_ground(force))["named"] == effect


def test_sparse_regression_is_silent_where_only_noise_is_left():
    assert by_sparse_regression(motion_ground(lambda x, v, z: 0.0 * x))["named"] is None


def test_free_form_features_are_roofs_and_alike_in_both_array_modules():
    middle, half = np.array([0.2, 0.0, 0.0]), np.array([1.0, 5.0, 1.0])
    point = (np.array([0.3, -2.0]), np.array([1.2, -9.0]), np.array([0.4, 0.1]))
    own = features(np, *point, middle, half)
    ranges = jnp.asarray(middle), jnp.asarray(half)
    other = jax.vmap(lambda x, v, z: features(jnp, x, v, z, *ranges))(*map(jnp.asarray, point))
    np.testing.assert_allclose(own, np.asarray(other), atol=1e-14)
    # On the grid of v and z the roofs add to one, and so do those of x.
    assert own[:, :85].sum(axis=1) == pytest.approx([1.0, 1.0])
    assert own[:, 85:101].sum(axis=1) == pytest.approx([1.0, 1.0])


def test_free_form_finds_a_force_of_place_and_nothing_where_nothing_is():
    ground = motion_ground(lambda x, v, z: -0.5 * np.cos(4.0 * x))
    effect, chosen = fitted_force(ground)
    assert chosen is not None
    motion = ground.present.motion
    roofs = features(
        np,
        motion.x,
        np.arcsinh(motion.v / 0.02),
        motion.spring / 1.5,
        np.asarray(effect.middle),
        np.asarray(effect.half),
    )
    wanted = 0.5 * np.cos(4.0 * motion.x)
    assert np.sqrt(np.mean((roofs @ np.asarray(effect.weights) - wanted) ** 2)) < 0.03
    quiet, none = fitted_force(motion_ground(lambda x, v, z: 0.0 * x))
    assert none is None or np.max(np.abs(np.asarray(quiet.weights))) < 0.02


def test_bic_charges_log_n_for_a_parameter():
    batch = SimpleNamespace(block_count=np.full((1, 10), 100.0))
    short, long = (
        SimpleNamespace(fitted=(np.ones(1),), batch=batch, layout=(None,) * count) for count in (7, 9)
    )
    fitted = SimpleNamespace(misfit=0.25)
    assert criterion(short, fitted) == pytest.approx(500.0 + 7 * np.log(1000.0))
    assert criterion(long, fitted) - criterion(short, fitted) == pytest.approx(2 * np.log(1000.0))
