"""The newer families of simulated experiments: loops that follow, physics that adds up, effects in another form."""

import dataclasses
import itertools
from collections import Counter

import numpy as np
import pytest

pytest.importorskip("numba")

from helpers_challenge import answer, truth, verdict

from benchmarks.concealed.composition import (
    NAMED,
    SHARES,
    UnknownFamily,
    compose,
    counts,
    shows_in,
)
from benchmarks.concealed.reality import EFFECTS, RECIPES, make_case, write_case
from benchmarks.concealed.reality.cases import experiments_of
from benchmarks.concealed.reality.effects import build
from benchmarks.concealed.reality.families import RATES
from benchmarks.concealed.reality.forms import FORMS
from benchmarks.concealed.reality.kernel import simulate
from benchmarks.concealed.reality.knobs import KNOB_DTYPE, pack, rest
from benchmarks.concealed.reality.laws import coupling, place_force
from benchmarks.concealed.reality.machines import MACHINES
from benchmarks.concealed.reality.recorder import record
from benchmarks.concealed.reality.streams import stream
from benchmarks.concealed.reality.visibility import _over_noise, visibility
from benchmarks.concealed.scores import scores
from benchmarks.concealed.tables import by_family
from frictionjax.recordings import load_case

FOUR = tuple(RECIPES)


@pytest.fixture(scope="module")
def drawn():
    return {
        family: make_case(5, (), families=family, rate=RATES[family][1], stretch=0.25, substeps=4)
        for family in FOUR
    }


@pytest.mark.parametrize("family", FOUR)
def test_a_family_is_recorded_as_stated_and_its_loops_follow(drawn, family, tmp_path):
    case, rate = drawn[family], RATES[family][1]
    plans = experiments_of(5, case.machine, family, rate, 0.25)
    for one, plan in zip(case.recordings, plans, strict=True):
        counted = one["x"] / case.machine.encoder_step
        np.testing.assert_allclose(counted, np.round(counted), atol=1e-4)
        assert np.ptp(counted) > 20, one["name"]
        if plan.loop == "closed":
            error = one["x"] - plan.command
            assert np.sqrt(np.mean(error**2)) < 0.25 * np.std(plan.command), one["name"]
    read = load_case(write_case(case, tmp_path / "case"))
    assert {r.sample_rate for r in read.recordings} == {rate}
    assert sum(r.role == "holdout" for r in read.recordings) == (1 if family == "poor" else 2)
    assert sum(r.role == "fit" for r in read.recordings) >= (1 if family == "poor" else 4)


def test_durations_and_encoders_are_those_of_the_families():
    seconds = {
        family: [low for _, _, low, _, _ in recipes] + [high for _, _, _, high, _ in recipes]
        for family, recipes in RECIPES.items()
    }
    assert min(seconds["industrial"]) >= 10.0 and max(seconds["industrial"]) <= 20.0
    assert min(seconds["poor"]) >= 5.0 and max(seconds["poor"]) <= 8.0
    for seed in range(20):
        coarse, fine = (
            MACHINES[name](stream(seed, "plant"), "rotary") for name in ("industrial", "laboratory")
        )
        assert 2000 <= 2 * np.pi / coarse.encoder_step <= 10000
        assert fine.encoder_step < fine.deflection / 999
        link = MACHINES["joint"](stream(seed, "plant"), None)
        assert 0.5 <= link.gravity / link.Fc <= 20.0


def test_a_reference_begins_at_rest_and_keeps_within_the_stroke():
    for seed in range(6):
        for family in FOUR:
            rate = RATES[family][1]
            plant = MACHINES[family](stream(seed, "plant"), None)
            for one in experiments_of(seed, plant, family, rate):
                assert np.all(np.isfinite(one.command)), one.name
                assert np.ptp(one.command) > 0.0, one.name
                if one.loop == "closed":
                    speed = np.abs(np.diff(one.command)) * rate
                    assert abs(one.command[0]) < 1e-9 and speed[0] < 0.02 * plant.top_speed, one.name
                    assert np.abs(one.command).max() <= 1.05 * plant.stroke, one.name
                    assert speed.max() <= 1.02 * plant.top_speed, one.name


def test_a_joint_carries_a_weight_that_is_given_or_missing(drawn, tmp_path):
    given = load_case(write_case(drawn["joint"], tmp_path / "given")).model
    assert [effect.name for effect in given.effects] == ["gravity_pendulum"]
    plant = drawn["joint"].machine
    size = np.hypot(*(value.value for value in given.effects[0].values.values()))
    assert size == pytest.approx(plant.gravity, rel=0.06)
    hidden = make_case(5, ("gravity_pendulum",), families="joint", rate=100.0, stretch=0.1, substeps=4)
    assert load_case(write_case(hidden, tmp_path / "hidden")).model is None
    assert "gravity" not in (tmp_path / "hidden" / "case.toml").read_text()
    assert hidden.knobs["grav"][0] == hidden.machine.gravity > 0.0
    with pytest.raises(ValueError, match="rotary"):
        make_case(5, (), families="joint", kind="linear")


# Other forms


def test_every_effect_has_another_form_with_knobs_of_its_own():
    assert set(FORMS) == set(NAMED)
    plant = MACHINES["joint"](stream(1, "plant"), None)
    for name in NAMED:
        usual, truths = zip(*((EFFECTS[name](stream(k, "a"), plant, 1.0)) for k in range(12)), strict=True)
        forms = [FORMS[name](stream(k, "a"), plant, 1.0) for k in range(12)]
        for knobs, own in forms:
            assert set(knobs) <= set(KNOB_DTYPE.names), name
            assert own["form"] not in {one.get("form") for one in truths}, name
            # Another law or another relation between its numbers, not another draw of the same ones.
            assert name in ("maxwell_slip", "creep", "viscoelastic_damping", "dwell_strengthening") or any(
                set(knobs) - set(one) for one in usual
            ), name


def test_forms_are_drawn_and_recorded():
    plant = MACHINES["industrial"](stream(1, "plant"), None)

    def forms(rate):
        return Counter(
            build(("ripple",), "strong", plant, lambda name, k=k: stream(k, name), rate)[1]["ripple"].get(
                "form"
            )
            for k in range(40)
        )

    assert forms(None) == {None: 40}
    both = forms(1000.0)
    assert set(both) == {"usual", "slots"} and min(both.values()) > 10


@pytest.mark.parametrize("name", NAMED)
def test_half_the_step_leaves_the_motion(name):
    """The other form of an effect on a poor machine, whose encoder is made fine: a count that falls to the other side
    would be another noise."""
    plant = MACHINES["poor"](stream(2, "plant"), "rotary")
    knobs = pack(plant, FORMS[name](stream(2, "form"), plant, 1.0)[0])
    noise = plant.sensor_noise * plant.encoder_step
    fine = dataclasses.replace(
        plant, encoder_step=plant.encoder_step * 1e-7, sensor_noise=plant.sensor_noise * 1e7
    )
    plan = experiments_of(2, plant, "poor", 500.0, 0.2)[0]
    coarse, half = (record(plan, fine, knobs, {}, 2, substeps)[2].clean for substeps in (16, 32))
    still = record(plan, fine, pack(plant, {}), {}, 2, 16)[2].clean
    assert np.all(np.isfinite(half))
    change = np.sqrt(np.mean((coarse - half) ** 2))
    assert change < max(0.1 * np.sqrt(np.mean((coarse - still) ** 2)), 0.1 * noise)


def _swinging(changes, x, seconds=0.5, dt=1e-3):
    """States of a machine without friction, let go at `x` with its second mass, if any, in the origin: every 1 ms."""
    plant = dataclasses.replace(MACHINES["poor"](stream(3, "plant"), "rotary"), J=0.02)
    knobs = pack(plant, {"s0": 1e-6, "s1": 0.0, "s2": 0.0, "fc": 1e-9, "fs": 1e-9} | changes)
    state, none, states = rest(), np.zeros(1), []
    state["x"] = x
    gains, memory = np.array([0.0, 0.0, 1.0, 0.0, np.inf, 0.0]), np.zeros(4)
    for k in range(round(seconds / dt)):
        simulate(
            knobs, state, False, none, none, gains, memory, 1e-9, none, none, np.zeros((1, 2)), k * dt, dt, 64
        )
        states.append({name: float(state[name][0]) for name in ("x", "v", "x2", "v2")})
    return knobs, states


def _potential(force, ways):
    """Energy stored on the way to each of `ways`, from forces between them."""
    grid = np.linspace(min(ways), max(ways), 4001)
    stored = np.concatenate(
        [[0.0], np.cumsum([force(0.5 * (a + b)) * (b - a) for a, b in itertools.pairwise(grid)])]
    )
    return np.interp(ways, grid, stored)


@pytest.mark.parametrize(
    "changes",
    [
        {"spring": 2.0, "spring3": 3.0},
        {"grav": 1.0, "grav2": 0.3, "grav_x0": 0.4},
        {"spring": 2.0, "const": 0.1, "const_bend": 0.2, "const_len": 0.3},
        {"spring": 2.0, "rip_peak": 0.4, "rip_p": 0.2, "rip_f1": 1.0},
    ],
)
def test_springs_and_weights_give_back_what_they_took(changes):
    knobs, states = _swinging(changes, 0.8)

    def force(x):
        probe = rest()
        probe["x"] = x
        return place_force(knobs[0], probe[0])

    kinetic = np.array([0.01 * s["v"] ** 2 for s in states])
    whole = kinetic + _potential(force, [s["x"] for s in states])
    assert np.ptp(kinetic) > 0.2
    assert np.ptp(whole) < 2e-3 * np.ptp(kinetic)


@pytest.mark.parametrize("changes", [{"k2_hard": 0.8, "k2_len": 0.02}, {"gap": 0.01, "gap_k": 6.0}])
def test_a_coupling_makes_no_energy(changes):
    for d2, lost in ((0.0, 0.0), (0.02, 0.2)):
        common = {"m2": 0.008, "k2": 300.0, "d2": d2}
        knobs, states = _swinging(common | changes, 0.03)

        def force(stretch, knobs=knobs):
            probe = rest()
            probe["x"] = stretch
            return coupling(knobs[0], probe[0], 0.0, 0.0)

        kinetic = np.array([0.006 * s["v"] ** 2 + 0.004 * s["v2"] ** 2 for s in states])
        whole = kinetic + _potential(force, [s["x"] - s["x2"] for s in states])
        if d2 == 0.0:
            assert np.ptp(whole) < 5e-3 * np.ptp(kinetic)
        else:
            assert np.all(np.diff(whole) < 1e-3 * np.ptp(kinetic))
            assert whole[-1] < (1.0 - lost) * whole[0]


# What shows


def test_what_the_base_model_takes_up_is_not_visible():
    rng = np.random.default_rng(4)
    bases, noise = rng.standard_normal((7, 300)), rng.standard_normal(300)
    own = 5.0 * bases[2]
    assert _over_noise(("a",), noise, np.vstack([own, own + 0.02 * bases]))["a"] < 1e-6
    apart = own + 3.0 * rng.standard_normal(300)
    found = _over_noise(("a", "b"), noise, np.vstack([own, own + 0.02 * bases, apart, apart + 0.02 * bases]))
    assert found["a"] < 1e-6 and found["b"] == pytest.approx(3.0, rel=0.15)


def test_a_stronger_effect_is_more_visible():
    strong, weak = (
        visibility(4, ("direction_asymmetry",), strength, "poor", 500.0, 0.1)["direction_asymmetry"]
        for strength in ("strong", "weak")
    )
    assert strong > 3.0 * weak > 0.0


# What is drawn


def test_a_batch_of_families_has_equal_parts_and_shows_what_it_hides():
    plans = compose(120, 7, FOUR)
    assert Counter(plan.families for plan in plans) == dict.fromkeys(FOUR, 30)
    assert Counter(plan.stratum for plan in plans) == counts(120)
    for plan in plans:
        low, high = RATES[plan.families]
        assert low <= plan.rate <= high and plan.rate == round(plan.rate)
        assert all(shows_in(effect, plan.families) for effect in plan.missing), plan
    for stratum in SHARES:
        own = Counter(plan.families for plan in plans if plan.stratum == stratum)
        assert max(own.values()) - min(own[family] for family in FOUR) <= 2, stratum
    weights = [plan for plan in plans if plan.families == "joint" and "gravity_pendulum" in plan.missing]
    assert {plan.stratum for plan in weights} == {"one", "two"}
    assert (
        compose(20, 7, ("joint", "few"))
        == compose(20, 7, ("joint", "few"))
        != compose(20, 8, ("joint", "few"))
    )
    with pytest.raises(UnknownFamily, match=r"'arm'; known: default, .*joint"):
        compose(4, 1, ("joint", "arm"))


def test_scores_by_family():
    some = [
        answer("a", truth("one", "creep", families="poor"), verdict("creep")),
        answer("b", truth("one", "delay", families="poor"), verdict()),
        answer("c", truth("nothing", families="joint"), verdict("delay")),
        answer("d", truth("outside", "outside:x", families="joint"), verdict(word="unknown")),
        answer("e", truth("two", "creep", "ripple", families="joint"), verdict("creep", "ripple")),
        answer("f", truth("one", "ripple", families="joint", strength="weak"), verdict()),
    ]
    found = scores(some)
    poor, joint = found["by_family"]["poor"], found["by_family"]["joint"]

    def counted(score):
        return score["hits"], score["of"]

    assert (poor["cases"], joint["cases"]) == (2, 4)
    assert counted(poor["within_class"]) == (1, 2) and counted(poor["strong_adequate"]) == (1, 2)
    assert counted(joint["within_class"]) == (0, 0) and counted(joint["strong_adequate"]) == (0, 2)
    assert counted(joint["wrong"]) == (1, 4) and counted(joint["false_alarms"]) == (1, 1)
    assert counted(joint["outside_flagged"]) == (1, 1) and joint["two_f1"]["value"] == 1.0
    rows = by_family(found).splitlines()
    assert rows[2].startswith("| joint | 4 | no case | 25 % (5 to 70), 1 of 4 |")
    assert rows[3].startswith("| poor | 2 | 50 % (9 to 91), 1 of 2 |")
