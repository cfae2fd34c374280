"""Free, fixed, tied and bounded parameters: resolved as asked, and every choice that cannot be meant is a sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import ARM, PLANT, truth
from helpers_plants import effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.core import InputError
from frictionjax.estimation.constraints import Constraints, belief_residuals, resolve
from frictionjax.estimation.parameters import pack, part_of, unpack

DT = 1e-3
LOADED = PLANT.with_effects(effect("ConstantLoad", load=0.05))
TRUE = truth(PLANT) | {"motor_constant": float(PLANT.motor_constant), "load": 0.05}


def _resolve(drive=LOADED, **choices):
    given = {"free": None, "fixed": (), "ties": {}, "bounds": {}, "priors": {}} | choices
    return resolve(drive, DT, {"Fc": 0.5}, **given)


def _labels(constraints: Constraints):
    return tuple(one.label for one in constraints.layout)


def test_everything_but_the_motor_constant_is_free():
    assert _labels(_resolve()) == (*ARM, "load")
    assert _labels(_resolve(PLANT)) == ARM


def test_free_and_fixed_are_as_asked():
    assert _labels(_resolve(free=("Fc", "Fs", "load"))) == ("Fc", "Fs", "load")
    assert _labels(_resolve(fixed=("J", "vs"))) == ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "load")
    assert _labels(_resolve(free=("motor_constant", "Fc"))) == ("Fc", "motor_constant")


def test_a_tied_parameter_is_not_free_and_follows():
    found = _resolve(ties={"Fs": ("Fc", 1.3), "sigma1": ("sigma2", 50.0)})
    assert _labels(found) == ("J", "sigma0", "sigma2", "Fc", "vs", "load")
    drive = found.tied(LOADED)
    assert float(drive.friction.Fs) == pytest.approx(1.3 * TRUE["Fc"], rel=1e-12)
    assert float(drive.friction.sigma1) == pytest.approx(50.0 * TRUE["sigma2"], rel=1e-12)
    assert float(drive.J) == TRUE["J"]


def test_a_parameter_may_follow_a_fixed_one():
    found = _resolve(fixed=("J",), ties={"sigma0": ("J", 5e4)})
    assert "J" not in _labels(found)
    assert float(found.tied(LOADED).friction.sigma0) == pytest.approx(5e4 * TRUE["J"], rel=1e-12)


def test_strengths_may_be_tied_with_any_sign():
    found = _resolve(ties={"load": ("Fc", -0.1)})
    assert float(part_of(found.tied(LOADED), "effects.0.load")) == pytest.approx(-0.1 * TRUE["Fc"], rel=1e-12)


def test_bounds_are_those_of_the_value():
    found = _resolve(bounds={"sigma2": (0.01, 0.1), "load": (-0.2, 0.2)})
    ends = {one.label: (float(one.least), float(one.most)) for one in found.layout}
    assert ends["sigma2"] == (0.01, 0.1)
    assert ends["load"] == (-0.2, 0.2)
    assert ends["J"] == (-np.inf, np.inf)


def test_coulomb_friction_stays_below_a_fixed_static_friction():
    """With and without bounds of its own."""
    for bounds, least in (({}, 0.0), ({"Fc": (0.3, 5.0)}, 0.3)):
        found = _resolve(fixed=("Fs",), bounds=bounds)
        one = next(one for one in found.layout if one.label == "Fc")
        assert float(one.least) == least
        assert float(one.most) == pytest.approx(TRUE["Fs"])


def test_priors_are_residuals_in_standard_deviations():
    found = _resolve(priors={"J": (0.03, 0.003), "Fc": (0.4, 0.05), "motor_constant": (15.0, 2.0)})
    # The true J, Fc and motor constant are 0.03, 0.5 and 16.
    np.testing.assert_allclose(belief_residuals(found.beliefs, LOADED), [0.0, 2.0, 0.5], atol=1e-12)
    assert belief_residuals((), LOADED).shape == (0,)


def test_both_inertia_and_motor_constant_with_a_prior():
    both = ("J", "motor_constant", "Fc")
    assert set(_labels(_resolve(free=both, priors={"J": (0.03, 0.003)}))) == set(both)
    assert set(_labels(_resolve(free=both, priors={"motor_constant": (16.0, 0.5)}))) == set(both)


def test_an_effect_with_a_taken_name_is_labelled_by_its_class():
    drive = PLANT.with_effects(effect("Ripple"), effect("PeriodicPositionDependence"))
    scales = {"Fc": 0.5, "stroke": 1.0, "sigma0": 2e3, "vs": 0.06, "sigma2": 0.06, "zs": 3e-4, "dt": DT}
    known = _labels(resolve(drive, DT, scales, free=None, fixed=(), ties={}, bounds={}, priors={}))
    assert len(set(known)) == len(known)


NOT_MEANT = {
    "unknown free": (
        {"free": ("Fq",)},
        r"`free`: `Fq` is not a parameter of this drive. Choose from J, sigma0",
    ),
    "unknown fixed": ({"fixed": ("mass",)}, r"`fixed`: `mass` is not a parameter"),
    "unknown tie": ({"ties": {"mass": ("J", 1.0)}}, r"`ties`: `mass` is not a parameter"),
    "unknown source": ({"ties": {"J": ("mass", 1.0)}}, r"`ties`: `mass` is not a parameter.*Choose from"),
    "unknown bound": ({"bounds": {"mass": (0.0, 1.0)}}, r"`bounds`: `mass` is not a parameter"),
    "unknown prior": ({"priors": {"mass": (0.0, 1.0)}}, r"`priors`: `mass` is not a parameter"),
    "fixed and tied": (
        {"fixed": ("Fs",), "ties": {"Fs": ("Fc", 1.2)}},
        r"`ties`: Fs would be both fixed and tied. Take it out of one",
    ),
    "chain": (
        {"ties": {"sigma1": ("sigma2", 2.0), "sigma2": ("J", 1.0)}},
        r"`ties`: sigma1 follows sigma2, which is itself tied. Tie both to one",
    ),
    "circle": ({"ties": {"Fc": ("vs", 2.0), "vs": ("Fc", 0.5)}}, r"`ties`: .* which is itself tied"),
    "own tail": ({"ties": {"J": ("J", 1.0)}}, r"`ties`: J follows J, which is itself tied"),
    "negative factor": ({"ties": {"J": ("Fc", -1.0)}}, r"`ties`: J would be -1 times Fc. Give a positive"),
    "no number": ({"ties": {"load": ("Fc", np.nan)}}, r"`ties`: load would be nan times Fc. Give a"),
    "weak static friction": (
        {"ties": {"Fs": ("Fc", 0.9)}},
        r"`ties`: Fs = 0.9 Fc contradicts Fs > Fc. Fs must exceed Fc: use a factor above 1",
    ),
    "strong Coulomb friction": (
        {"ties": {"Fc": ("Fs", 1.1)}},
        r"`ties`: Fc = 1.1 Fs contradicts Fs > Fc. Fs must exceed Fc: use a factor below 1",
    ),
    "no room": (
        {"bounds": {"J": (0.05, 0.01)}},
        r"`bounds`: J would lie between 0.05 and 0.01. Give the lower",
    ),
    "a point": ({"bounds": {"J": (0.03, 0.03)}}, r"`bounds`: J would lie between 0.03 and 0.03"),
    "bound that is no number": ({"bounds": {"J": (np.nan, 1.0)}}, r"`bounds`: J would lie between nan and 1"),
    "start outside": (
        {"bounds": {"J": (0.1, 1.0)}},
        r"`bounds`: J starts at 0.03, outside of 0.1 ... 1. Start it inside, or widen the bounds of J",
    ),
    "certainty": (
        {"priors": {"J": (0.03, 0.0)}},
        r"`priors`: J has mean 0.03 and standard deviation 0. Give both",
    ),
    "negative spread": (
        {"priors": {"J": (0.03, -1.0)}},
        r"`priors`: J has mean 0.03 and standard deviation -1",
    ),
    "no mean": ({"priors": {"J": (np.nan, 1.0)}}, r"`priors`: J has mean nan"),
    "nothing to do": (
        {"free": (), "fixed": ()},
        r"`free`: nothing is left to be found.*Free at least one",
    ),
    "free and fixed": (
        {"free": ("J", "Fc"), "fixed": ("J",)},
        r"`fixed`: J would be both free and fixed.*Take it out of one of the two",
    ),
    "bounds on what is fixed": (
        {"bounds": {"J": (1e-3, 1.0)}, "fixed": ("J",)},
        r"J would be both bounded and fixed or tied.*Take it out of one of the two",
    ),
    "all fixed": ({"fixed": (*ARM, "load")}, r"`free`: nothing is left to be found"),
    "all forces": (
        {"free": ("J", "motor_constant", "Fc")},
        r"`free`: J and motor_constant can be identified only as a ratio.*Fix one of them, or give one of them a prior",
    ),
}


@pytest.mark.parametrize("case", NOT_MEANT)
def test_what_cannot_be_meant_is_a_sentence_with_a_cure(case):
    choices, sentence = NOT_MEANT[case]
    with pytest.raises(InputError, match=sentence) as caught:
        _resolve(**choices)
    assert caught.value.cure.endswith(".")
    assert "Traceback" not in str(caught.value)


def _unpacked(constraints, vector, drive=LOADED):
    start = pack(constraints.layout, drive)
    return constraints.tied(unpack(constraints.layout, drive, vector, start))


BOUNDS = {
    "J": (0.02, 0.05),
    "sigma0": (1500.0, 2600.0),
    "Fc": (0.4, 0.55),
    "vs": (0.01, 0.2),
    "load": (0.0, 0.1),
}


@settings(max_examples=30)
@given(
    st.sets(st.sampled_from((*ARM, "load")), min_size=1),
    st.sets(st.sampled_from(sorted(BOUNDS))),
    st.integers(0, 2**31),
    st.sampled_from([0.0, 0.05, 3.0]),
)
def test_any_choice_of_parameters_goes_there_and_back(names, bounded, seed, size):
    """Fixed ones stay; free ones are inside their bounds wherever the vector is; inside, the vector comes back."""
    found = _resolve(free=tuple(sorted(names)), bounds={name: BOUNDS[name] for name in bounded})
    assert set(_labels(found)) == names
    start = pack(found.layout, LOADED)
    vector = start + size * jnp.asarray(np.random.default_rng(seed).standard_normal(len(names)))
    drive = _unpacked(found, vector)
    values = {**truth(drive), "load": float(part_of(drive, "effects.0.load"))}
    for name, value in values.items():
        assert np.isfinite(value)
        if name not in names:
            assert value == TRUE[name], name
        elif name in bounded:
            assert BOUNDS[name][0] <= value <= BOUNDS[name][1], name
    # Static friction is never below Coulomb friction, whichever of the two moves.
    assert values["Fs"] >= values["Fc"]
    again = _unpacked(found, pack(found.layout, drive))
    for name in names:
        other = {**truth(again), "load": float(part_of(again, "effects.0.load"))}[name]
        assert other == pytest.approx(values[name], rel=3e-3, abs=1e-12), name
    if size == 0.0:
        np.testing.assert_allclose(pack(found.layout, drive), start, atol=1e-12)


def test_a_value_beyond_its_bound_is_at_its_bound():
    found = _resolve(bounds=BOUNDS)
    start = pack(found.layout, LOADED)
    for sign, end in ((-1.0, 0), (1.0, 1)):
        drive = _unpacked(found, start + sign * 2.0)
        values = {**truth(drive), "load": float(part_of(drive, "effects.0.load"))}
        for name in ("J", "vs", "load"):
            assert values[name] == pytest.approx(BOUNDS[name][end], rel=1e-12), name


@settings(max_examples=20)
@given(st.integers(0, 2**31))
def test_ties_hold_wherever_the_vector_is(seed):
    found = _resolve(ties={"Fs": ("Fc", 1.25), "load": ("Fc", -0.2), "sigma1": ("sigma2", 80.0)})
    start = pack(found.layout, LOADED)
    drive = _unpacked(found, start + jnp.asarray(np.random.default_rng(seed).standard_normal(start.shape[0])))
    friction = drive.friction
    assert float(friction.Fs) == pytest.approx(1.25 * float(friction.Fc), rel=1e-12)
    assert float(friction.sigma1) == pytest.approx(80.0 * float(friction.sigma2), rel=1e-12)
    assert float(part_of(drive, "effects.0.load")) == pytest.approx(-0.2 * float(friction.Fc), rel=1e-12)


def test_choices_of_other_numbers_have_one_structure():
    """Factors, bounds and beliefs are numbers: others compile nothing anew."""

    def made(k):
        return _resolve(
            ties={"Fs": ("Fc", 1.2 + k)},
            bounds={"J": (0.01 + 0.001 * k, 1.0)},
            priors={"vs": (0.1 + k, 0.01)},
        )

    assert jax.tree.structure(made(0.0)) == jax.tree.structure(made(0.1))


def test_a_bound_on_static_friction_keeps_it_above_coulomb_friction():
    found = _resolve(bounds={"Fs": (0.55, 0.65)})
    start = pack(found.layout, LOADED)
    index = _labels(found).index("Fc")
    friction = _unpacked(found, jnp.asarray(start).at[index].add(0.5)).friction
    assert float(friction.Fs) >= float(friction.Fc)
