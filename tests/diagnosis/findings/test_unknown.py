"""What no effect of the catalogue explains, what the recordings cannot show, and why an effect was not named."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis
from helpers_estimation import FINE, PLANT, closed_loop, moves, open_loop, stick_noise
from helpers_plants import effect
from helpers_rule import candidate, table

from frictionjax.core import InputError, silent
from frictionjax.diagnosis.base_model.fit_base import fit_base
from frictionjax.diagnosis.evidence.judgement import Judgement
from frictionjax.diagnosis.findings import other_shape
from frictionjax.diagnosis.findings.next_experiment import plain_experiments
from frictionjax.diagnosis.findings.other_shape import other_shape_note, over_position, without_other_shapes
from frictionjax.diagnosis.findings.residual_map import (
    MAP,
    ResidualModel,
    map_is_used,
    of_alike,
    rejected_note,
    residual_model,
)
from frictionjax.diagnosis.intake.coverage import missing_needs, not_testable
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.conclusion import of_another_shape
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Decision
from frictionjax.diagnosis.selection.select import Selection
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.table import OtherDecision
from frictionjax.estimation.data.batch import make_batch
from frictionjax.physics.residual_maps import KNOTS, MAPS, PositionForceMap, PositionLevelMap
from frictionjax.recordings import Case, Plant

HEIGHTS = (0.0, 0.0, 0.05, 0.15, 0.25, 0.3, 0.3, 0.25, 0.15, 0.05, 0.0, 0.0)
BUMP = {f"h{k}": height for k, height in enumerate(HEIGHTS)} | {"middle": 0.05, "half": 0.05}
"""Friction that is up to 30 % higher over half a tenth of a radian, in the middle of the stroke."""


@pytest.mark.parametrize("form", MAPS.values(), ids=lambda form: form.__name__)
def test_a_map_is_linear_between_its_knots_and_constant_beyond(form):
    heights = {f"h{k}": float(k * k) for k in range(KNOTS)}
    made = form(**heights, middle=2.0, half=1.1)
    knots = np.linspace(0.9, 3.1, KNOTS)
    np.testing.assert_allclose(made.at(knots), np.arange(KNOTS) ** 2.0, rtol=1e-12)
    np.testing.assert_allclose(made.at(np.array([-5.0, 9.0])), [0.0, (KNOTS - 1) ** 2.0], rtol=1e-12)
    np.testing.assert_allclose(made.at(0.5 * (knots[3] + knots[4])), 12.5, rtol=1e-12)


@pytest.mark.slow
def test_a_bump_along_the_stroke_is_mapped_and_predicts_what_was_held_out():
    plant = PLANT.with_effects(PositionLevelMap(**BUMP))
    there = closed_loop("there", moves(4.0, (0.12, -0.02, 0.1, 0.0), (0.5,) * 4), seed=2, drive=plant)
    back = closed_loop("back", moves(4.0, (0.1, 0.0, 0.11, 0.01), (0.6,) * 4), seed=3, drive=plant)
    recordings = (open_loop("stick", stick_noise(2.0), seed=1, drive=plant), there, back)
    batch = make_batch(recordings, encoder_step=FINE)
    with ThreadPoolExecutor(2) as executor:
        base = fit_base((PLANT,), batch, np.array([False, False, True]), executor, silent)
        found = residual_model(base, np.ones((1, 1)), executor)
    assert found is not None and found.helps
    assert found.variable == "position (friction level)"
    gains = found.row.gains(Rule())
    assert gains.share_fit > 0.5 and gains.share_holdout > 0.3
    shape = found.model.judgement.drive.effects[-1]
    x = np.linspace(0.0, 0.1, 201)
    # What the base model may take over itself: a level that is the same everywhere.
    seen, true = np.asarray(shape.at(x)), np.asarray(PositionLevelMap(**BUMP).at(x))
    assert np.corrcoef(seen, true)[0, 1] > 0.9


def case(*recordings, unit="rad"):
    plant = Plant(motor_constant=1.0, position_unit=unit, encoder_step=FINE)
    return Case("case", plant, tuple(recordings))


def test_what_the_recordings_cannot_show_is_reported():
    stick, wide = open_loop("stick", stick_noise(2.0), seed=1), closed_loop("wide", moves(3.0), seed=2)
    lacking, _ = not_testable(case(stick), make_batch((stick,), encoder_step=FINE))
    assert "slides" in lacking["friction_lag"] and "creep" not in lacking
    assert "warmup" in lacking
    both = case(stick, wide, unit="m")
    assert set(missing_needs(both, make_batch((stick, wide), encoder_step=FINE))) >= {"angle"}
    stated, _ = not_testable(both, make_batch((stick, wide), encoder_step=FINE))
    assert "friction_lag" not in stated and "angle" in stated["gravity_pendulum"]
    assert "warmup" in stated


def test_a_form_that_cannot_be_seen_does_not_bar_the_others():
    once, twice = closed_loop("early", moves(3.0), seed=2), closed_loop("late", moves(3.0), seed=3)
    clocked = once, dataclasses.replace(twice, start_time=60.0)
    stated, forms = not_testable(case(*clocked), make_batch(clocked, encoder_step=FINE))
    assert "warmup" not in stated and forms == {"WarmupByTemperature"}
    warm = tuple(dataclasses.replace(r, temperature=20.0 + np.linspace(0.0, 5.0, r.x.size)) for r in clocked)
    _, forms = not_testable(case(*warm), make_batch(warm, encoder_step=FINE))
    assert not forms


def test_experiments_stay_below_or_go_beyond_break_away_as_their_names_say():
    made = plain_experiments(0.5, 1000.0)
    assert {u.shape for u in made.values()} == {(4000,)}
    peaks = {name: float(np.max(np.abs(u))) for name, u in made.items()}
    assert all(peak < 0.5 for name, peak in peaks.items() if "below break-away" in name or "held" in name)
    assert all(peak > 0.5 for name, peak in peaks.items() if "through" in name or "twice" in name)


def test_why_an_effect_was_or_was_not_named():
    found = fake_diagnosis()
    assert found.explain("maxwell_slip").startswith("maxwell_slip is named: p = 1e-12")
    assert "is not named: less than the noise; p = 0.3 under" in found.explain("creep")
    assert "removes 1 % of the misfit on the fitted and -2 % on the held-out" in found.explain("creep")
    assert "cannot be tested with these recordings: needs a second encoder" in found.explain("backlash")
    with pytest.raises(
        InputError, match=r"'wear' is not an effect of the catalogue.*Give one of: backlash, creep"
    ):
        found.explain("wear")


def test_an_effect_of_the_class_is_reported_with_the_experiment():
    found = fake_diagnosis()
    row = dataclasses.replace(found.candidates[0], effect="elasto_plastic")
    text = dataclasses.replace(found, candidates=(row,)).explain("elasto_plastic")
    assert "cannot distinguish it from maxwell_slip. nested triangles" in text


SPRING = effect("ReturnSpring", stiffness=1.0)


def _model(batch, misfit, *effects):
    """A model with these effects that misses fit and held-out recordings alike."""
    power = np.full(batch.block_count.shape, 2.0 * np.exp(2.0 * misfit) - 1.0)
    drive = PLANT.with_effects(*effects)
    held_out = np.array([False, True])
    judged = Judgement(drive, np.zeros(2), power, held_out, batch)
    return SimpleNamespace(posterior=SimpleNamespace(drive=drive), judgement=judged)


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("variable", "named", "left", "helps", "is_named"),
    [
        ("position", SPRING, 0.05, True, True),
        ("position", SPRING, 0.2, True, False),
        ("position", SPRING, 0.05, False, False),
        ("position", effect("QuadraticDrag", drag=1.0), 0.05, True, False),
        ("position (friction level)", SPRING, 0.05, True, False),
    ],
)
def test_a_force_of_the_position_is_named_though_its_equation_leaves_much(
    variable, named, left, helps, is_named
):
    """Where a map over the position beside it leaves little: of a spring that hardens the spring is missing."""
    recordings = closed_loop("fit", moves(2.0), seed=2), closed_loop("held out", moves(2.0), seed=3)
    batch = make_batch(recordings, encoder_step=FINE)
    base, last = _model(batch, 1.0), _model(batch, 0.4, named)
    mapped = ResidualModel(variable, _model(batch, left, named), None, helps)
    found = over_position(mapped, base, last, np.ones((1, 1)))
    row = None if found is None else found[0]
    verdict = of_another_shape(_unknown(0.4), row, Rule())
    assert (verdict.verdict == "named") == is_named
    if is_named:
        assert found[1] == ("return_spring",) and verdict.share == pytest.approx(left) and not verdict.remains


@pytest.mark.parametrize(
    ("named", "ahead", "helps", "kept"),
    [
        (("ripple",), 0.1, True, "position"),
        (("ripple",), 5.0, True, "input"),
        (("ripple",), 0.1, False, "input"),
        ((), 0.1, True, "input"),
    ],
)
def test_a_map_over_what_the_named_force_depends_on_is_kept_unless_another_is_clearly_likelier(
    named, ahead, helps, kept
):
    """The map over the input is likelier by so much in each cluster, give or take one."""
    scatter = np.tile([1.0, -1.0], 20)
    over_input = candidate((0.95, 0.95), gains_fit=tuple(10.0 + ahead + scatter), gains_held_out=(10.0,) * 9)
    over_x = candidate((0.9, 0.9), gains_fit=(10.0,) * 40, gains_held_out=(10.0,) * 9)
    maps = [ResidualModel("input", None, over_input, True), ResidualModel("position", None, over_x, helps)]
    for order in (maps, maps[::-1]):
        assert of_alike(order, named, Rule()).variable == kept


def test_without_maps_none_is_kept():
    assert of_alike([], ("ripple",), Rule()) is None


def test_what_the_equation_and_the_map_leave_is_said():
    said = other_shape_note(("return_spring",), 0.4, 0.05)
    assert said.startswith("Named by what it depends on") and "40 % of the misfit" in said and "5 %." in said


@pytest.mark.parametrize(("error", "used"), [(2.9, True), (3.0, True), (3.1, False)])
def test_a_map_with_which_held_out_errors_rise_is_not_used(error, used):
    compared = OtherDecision(MAP, {"error_without_map": 3.0, "error": error})
    assert map_is_used(compared) is used
    mapped = ResidualModel("velocity", None, candidate(), True)
    assert f"rises from 3 to {error:.3g} times the noise" in rejected_note(mapped, compared)


def _unknown(share):
    """A decision that accepted a spring, which leaves this `share`."""
    accepted = Round(table(candidate((1.0 - share,) * 2, effect="return_spring", exact=(True,))), 0)
    return Decision((accepted,), "unknown", True, share, ())


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("left", "names"), [(0.01, ("return_spring",)), (0.3, ("return_spring", "drive_deadzone"))]
)
def test_a_dead_zone_that_imitates_another_shape_of_a_spring_makes_way_for_a_map(monkeypatch, left, names):
    recordings = closed_loop("fit", moves(8.0), seed=2), closed_loop("held out", moves(8.0), seed=3)
    batch, dead = make_batch(recordings, encoder_step=FINE), effect("DriveDeadzone", width=0.01)
    base, first, both = _model(batch, 1.0), _model(batch, 0.4, SPRING), _model(batch, 0.2, SPRING, dead)
    asked = []

    def mapped(model, floor, executor, **given):
        asked.append((model, given["base"], given["variables"]))
        return ResidualModel("position", _model(batch, left, SPRING), None, True)

    monkeypatch.setattr(other_shape, "residual_model", mapped)
    rounds = [
        Round(table(candidate(effect=name), key=name), 0) for name in ("return_spring", "drive_deadzone")
    ]
    steps = [
        Step(base, [], [], [], np.ones((1, 1)), 0.0, SimpleNamespace(model=model), ())
        for model in (first, both)
    ]
    found = Selection(steps, Decision(tuple(rounds), "named", True, 0.1, ()), ())
    kept = without_other_shapes(found, None)
    assert kept.decision.names == names
    assert asked == [(first, base, ("position",))]
    assert [one.asked for one in kept.tables] == [("instead", "return_spring.0", "drive_deadzone.0")]
    accepted = [step.accepted is not None for step in kept.steps]
    if len(names) == 1:
        assert accepted == [True, False] and kept.steps[-1].dropped.startswith(
            "less likely than another shape of"
        )
        assert (kept.decision.verdict, kept.decision.share) == ("unknown", pytest.approx(0.4))
    else:
        assert accepted == [True, True] and kept.decision is found.decision


@pytest.mark.slow
def test_a_hardening_spring_is_a_spring_of_another_shape():
    places = np.linspace(-0.1, 0.1, KNOTS)
    force = {f"h{k}": float(2.5 * x + 100.0 * x**3) for k, x in enumerate(places)}
    plant = PLANT.with_effects(PositionForceMap(**force, middle=0.0, half=0.1))
    there = closed_loop("there", moves(8.0, (0.09, -0.08, 0.07, 0.0), (0.5,) * 4), seed=2, drive=plant)
    back = closed_loop("back", moves(8.0, (-0.09, 0.05, -0.07, 0.08), (0.6,) * 4), seed=3, drive=plant)
    batch = make_batch((there, back), encoder_step=FINE)
    held_out = np.array([False, True])
    with ThreadPoolExecutor(2) as executor:
        base = fit_base((PLANT,), batch, held_out, executor, silent)
        last = fit_base((PLANT.with_effects(SPRING),), batch, held_out, executor, silent)
        found = residual_model(last, np.ones((1, 1)), executor, base=base)
    assert found is not None and found.variable == "position" and found.helps
    row, names = over_position(found, base, last, np.ones((1, 1)))
    assert names == ("return_spring",)
    shape = of_another_shape(_unknown(0.5), row, Rule())
    assert shape.verdict == "named" and shape.share < 0.1
