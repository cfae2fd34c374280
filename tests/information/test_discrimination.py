"""Telling two effects apart: against a nonlinear refit by other means, and the pair that no sliding data split."""

import equinox as eqx
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from helpers_information import PRESLIDING, RATE, SLIDING, N, plan
from helpers_plants import ROTARY, effect
from scipy.optimize import least_squares
from scipy.stats import norm

from frictionjax.core import InputError
from frictionjax.information import rank_for_discrimination, refitting
from frictionjax.simulation import simulate

INPUTS, V0, NOISE = plan(ROTARY)
LOAD, ASYMMETRY = effect("ConstantLoad", load=0.015), effect("DirectionAsymmetry", coulomb=0.05)
SWING = 1.3 * 0.62 / 16.0 * np.sin(2.0 * np.pi * 4.0 * np.arange(N) / RATE)
"""Sliding to and fro: 1.3 times the static friction at 4 Hz."""


def by_name(found):
    return {one.name: one for one in found.entries}


def test_sliding_does_not_split_load_and_asymmetry_but_with_presliding_it_does():
    """To one side only, a load is a larger Coulomb friction; to and fro, it needs presliding data as well."""
    given = {
        "one way": INPUTS[SLIDING],
        "to and fro": SWING,
        "presliding": INPUTS[PRESLIDING],
        "both": [INPUTS[PRESLIDING], SWING],
    }
    v0 = [V0[SLIDING], 0.0, 0.0, 0.0, 0.0]
    # A sensor at which the sliding data alone do not decide.
    found = rank_for_discrimination(ROTARY, LOAD, ASYMMETRY, given, RATE, 800.0 * NOISE, v0=v0)
    entries = by_name(found)
    assert found.best.name == "both" and found.models == ("constant_load", "direction_asymmetry")
    assert entries["one way"].d_prime < 0.05 and entries["presliding"].d_prime < 0.2
    assert entries["to and fro"].probability < 0.5 < 0.9 < entries["both"].probability
    assert entries["both"].d_prime > 2.0 * np.hypot(
        entries["to and fro"].d_prime, entries["presliding"].d_prime
    )


@pytest.mark.parametrize("true", ["load", "asymmetry"])
def test_d_prime_is_what_a_nonlinear_refit_leaves(true):
    """Differences in place of derivatives, a trust region in place of damped steps, another stop."""
    u, free, noise = INPUTS[PRESLIDING], ("J", "sigma0", "sigma1"), 30.0 * NOISE
    truth, rival = (LOAD, ASYMMETRY) if true == "load" else (ASYMMETRY, LOAD)
    strength = rival.strengths[0].name
    scale = 0.5 if strength == "load" else 1.0  # as the catalogue has it: Fc, or 1
    x = np.asarray(simulate(ROTARY.with_effects(truth), u, RATE).x)

    def residual(q):
        f, (J, sigma0, sigma1) = ROTARY.friction, np.exp(q[:3])
        friction = eqx.tree_at(lambda f: (f.sigma0, f.sigma1), f, (f.sigma0 * sigma0, f.sigma1 * sigma1))
        moved = effect(type(rival).__name__, **{strength: scale * q[3]})
        machine = eqx.tree_at(lambda d: (d.J, d.friction), ROTARY, (ROTARY.J * J, friction))
        return (x - np.asarray(simulate(machine.with_effects(moved), u, RATE).x)) / noise

    done = least_squares(lambda q: np.append(residual(q), q / 3.0), np.zeros(4), x_scale=1e-2, xtol=1e-12)
    expected = np.linalg.norm(residual(done.x))
    found = rank_for_discrimination(
        ROTARY, LOAD, ASYMMETRY, {"noise": u}, RATE, noise, free=free, refit_steps=30
    ).best
    refitted = found.first_true if true == "load" else found.second_true
    # The refit may stop 2 % of the square before its end.
    assert refitted == pytest.approx(expected, rel=0.02, abs=0.02)


def test_the_linear_projection_is_that_of_finite_differences():
    u, strength = INPUTS[PRESLIDING], 1e-5  # so weak that both models are linear
    truth = effect("ConstantLoad", load=strength)

    def x(factor=None, place=None, load=0.0):
        machine = ROTARY if place is None else eqx.tree_at(place, ROTARY, place(ROTARY) * factor)
        return (
            np.asarray(simulate(machine.with_effects(effect("ConstantLoad", load=load)), u, RATE).x) / NOISE
        )

    places = (
        lambda d: d.J,
        lambda d: d.friction.sigma0,
        lambda d: d.friction.sigma1,
        lambda d: d.friction.Fs,
    )
    columns = np.stack([(x(np.exp(1e-5), p) - x(np.exp(-1e-5), p)) / 2e-5 for p in places], axis=1)
    rows = np.concatenate([columns, np.eye(4) / 3.0])
    difference = x(load=strength) - x()
    step = np.linalg.lstsq(rows, np.append(difference, np.zeros(4)), rcond=None)[0]
    expected = np.linalg.norm(difference - columns @ step)
    given = {"free": ("J", "sigma0", "sigma1", "Fs"), "refit_steps": 0}
    found = rank_for_discrimination(ROTARY, truth, None, {"noise": u}, RATE, NOISE, **given).best
    assert found.d_prime == found.one_step == pytest.approx(expected, rel=1e-3)
    assert found.second_true == np.inf and "by the linear projection" in found.sentence
    assert found.probability == pytest.approx(
        norm.cdf(expected - 1.96) + norm.cdf(-expected - 1.96), abs=1e-4
    )
    refitted = rank_for_discrimination(
        ROTARY, truth, None, {"noise": u}, RATE, NOISE, free=given["free"]
    ).best
    assert refitted.converged and refitted.d_prime == pytest.approx(expected, rel=1e-2)


def test_the_test_rejects_the_wrong_model_as_often_as_it_says():
    """Noise on the true model's positions: the projection on what is left of the difference is the two-sided test."""
    u, weak = INPUTS[PRESLIDING], effect("ConstantLoad", load=1e-5)
    free = ("J", "sigma0", "sigma1")
    found = rank_for_discrimination(
        ROTARY, weak, None, {"noise": u}, RATE, NOISE, free=free, refit_steps=0
    ).best
    assert 1.0 < found.d_prime < 4.0
    base, truth = (np.asarray(simulate(d, u, RATE).x) / NOISE for d in (ROTARY, ROTARY.with_effects(weak)))
    moved = [
        eqx.tree_at(place, ROTARY, place(ROTARY) * (1.0 + 1e-5))
        for place in (lambda d: d.J, lambda d: d.friction.sigma0, lambda d: d.friction.sigma1)
    ]
    columns = np.stack([(np.asarray(simulate(d, u, RATE).x) / NOISE - base) / 1e-5 for d in moved], axis=1)
    project = np.linalg.qr(columns)[0]
    draws = 4000
    noise = np.random.default_rng(11).standard_normal((N, draws))

    def left(y):
        return y - project @ (project.T @ y)

    direction = left(truth - base)
    score = left((truth - base)[:, None] + noise).T @ direction / np.linalg.norm(direction)
    rate = np.mean(np.abs(score) > norm.ppf(0.975))
    assert abs(rate - found.probability) < 4.0 * np.sqrt(0.25 / draws)


def test_forms_of_one_effect_limits_and_progress():
    reported = []
    given = {"presliding": INPUTS[PRESLIDING], "swing": SWING, "sliding": INPUTS[SLIDING]}
    viscous = effect("ViscousAsymmetry", viscous=0.2)
    found = rank_for_discrimination(
        *(ROTARY, ASYMMETRY, viscous, given, RATE, 100.0 * NOISE),
        limits={"v": 1.0, "x": 0.05},
        v0=[0.0, 0.0, V0[SLIDING]],
        refit_steps=2,
        progress=lambda *what: reported.append(what),
    )
    assert found.models == (
        "direction_asymmetry (DirectionAsymmetry)",
        "direction_asymmetry (ViscousAsymmetry)",
    )
    assert [one.name for one in found.rejected] == ["sliding"] and "velocity reaches" in found.rejected[
        0
    ].sentence
    assert found.best.name == "swing" and len(found.entries) == 2
    assert [round(fraction, 2) for _, fraction in reported] == [0.33, 0.67, 1.0]
    assert all(one.d_prime == min(one.first_true, one.second_true) for one in found.entries)


def test_other_numbers_compile_nothing():
    rank_for_discrimination(ROTARY, LOAD, ASYMMETRY, {"swing": SWING}, RATE, NOISE, refit_steps=1)
    before = refitting._run._cached._cache_size()
    other = eqx.tree_at(lambda d: d.J, ROTARY, jnp.asarray(0.05))
    strong = effect("ConstantLoad", load=0.1)
    rank_for_discrimination(other, strong, ASYMMETRY, {"a": 0.5 * SWING}, 1500.0, 3.0 * NOISE, refit_steps=1)
    assert refitting._run._cached._cache_size() == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"candidates": {}}, "at least one name"),
        ({"candidates": {"short": np.ones(1)}}, "'short'.*n at least 2"),
        ({"candidates": {"gap": np.full(N, np.nan)}}, "'gap'.*not finite"),
        ({"second": effect("ConstantLoad", load=0.3)}, "both are constant_load.*two effects"),
        ({"first": None, "second": None}, "both are base model"),
        ({"second": effect("ConstantLoad")}, "no strength is the base model.*Give load"),
        ({"second": effect("ConstantLoad", load=np.nan)}, "not finite"),
        ({"second": "load"}, "`second`.*catalogue"),
        ({"free": ("sigma3",)}, "neither model has sigma3.*Name some of J"),
        ({"free": ("J", "J")}, "one twice"),
        ({"refit_steps": -1}, "`refit_steps`.*0 or more"),
        ({"noise": np.nan}, "`noise`.*positive"),
        ({"limits": {"y": 1.0}}, "`limits`"),
        ({"limits": {"u": 1e-9}}, "swing is not allowed.*wider limit"),
        ({"drive": eqx.tree_at(lambda d: d.J, ROTARY, jnp.asarray(1e-200))}, "'swing' overflows"),
        ({"drive": eqx.tree_at(lambda d: d.J, ROTARY, jnp.asarray(-1.0))}, "J = -1.0"),
    ],
)
def test_bad_input_is_a_sentence(change, words, monkeypatch):
    # Some of it is of a wrong type, also for a run in which types are checked.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    given = {
        "drive": ROTARY,
        "first": LOAD,
        "second": ASYMMETRY,
        "candidates": {"swing": SWING},
        "noise": NOISE,
    }
    with pytest.raises(InputError, match=words):
        rank_for_discrimination(sample_rate=RATE, **(given | change))
