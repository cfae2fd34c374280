"""The field's own pictures draw the friction that there is, and the residual force where an effect acts."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from helpers_diagnosis import PLANT, fake_diagnosis, fake_recording

from frictionjax.core import Estimate
from frictionjax.diagnosis.verdict import MissingEffect
from frictionjax.physics.effects import catalogue
from frictionjax.physics.effects.base import Along
from frictionjax.report.friction import VARIABLES, over_displacement, over_velocity, where_it_acts
from frictionjax.report.motion import motions_of

RATE, J, FC, SIGMA0 = 1000.0, 0.026, 0.5, 2000.0
BASE = {name: Estimate(value, 0.01, "1") for name, value in {"J": J, "Fs": 0.6, "sigma0": SIGMA0}.items()}


def _case(x, u, lacks, **how):
    """A case of one recording in motion `x` by the input `u`, whose base model lacks a force of `lacks`."""
    recording = replace(
        fake_recording(n=x.size, sample_rate=RATE),
        x=x, u=u, residual_force=lacks, residual_force_extended=0.0 * lacks, **how,
    )  # fmt: skip
    return replace(fake_diagnosis(n=10), base=BASE, recordings=(recording,), plant=PLANT)


def _sliding(seconds=8.0):
    """A sine of 1 rad with friction of FC that is 0.1 higher forward; the base model knows FC alone."""
    t = np.arange(round(seconds * RATE)) / RATE
    w = 2.0 * np.pi * 0.5
    x, v, a = np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)
    friction = np.where(v > 0.0, FC + 0.1, -FC)
    return x, v, (J * a + friction) / PLANT.motor_constant, np.where(v > 0.0, -0.1, 0.0)


def test_friction_over_velocity_is_that_of_the_machine():
    x, _, u, lacks = _sliding()
    found = _case(x, u, lacks)
    forward, backward = over_velocity(found, motions_of(found), True).panels
    assert (forward.note, backward.note, forward.unit) == ("forward", "backward", "mN·m")
    for panel, level, base in ((forward, 1e3 * (FC + 0.1), 1e3 * FC), (backward, 1e3 * FC, 1e3 * FC)):
        drawn = {one.colour: one.y[np.isfinite(one.y)] for one in panel.series}
        middle = slice(2, -2)
        np.testing.assert_allclose(drawn["measured"][middle], level, rtol=0.02)
        np.testing.assert_allclose(drawn["base"][middle], base, rtol=0.02)
        np.testing.assert_allclose(drawn["extended"], drawn["measured"])


def test_where_nothing_slides_there_is_no_curve():
    x, _, u, lacks = _sliding()
    still = _case(1e-5 * x, u, lacks)
    assert over_velocity(still, motions_of(still), True) is None
    assert "these recordings do not slide" in _page(still)
    assert over_displacement(still, motions_of(still), True) is not None


def test_loops_are_drawn_where_the_extended_model_improves_them():
    x, _, u, _ = _sliding()
    stroke = 1e-3 * x  # below ten deflections at break-away
    later = np.arange(x.size) > x.size // 2
    found = _case(stroke, u, np.where(later, 0.05, 0.0))
    chart = over_displacement(found, motions_of(found), True)
    (panel,) = chart.panels
    begin, end = (float(word) for word in panel.note.split(", ")[1].removesuffix(" s").split(" to "))
    assert end > begin > 2.0
    drawn = {one.colour: one for one in panel.series}
    np.testing.assert_allclose(drawn["extended"].y, drawn["measured"].y)
    assert np.max(drawn["base"].y - drawn["measured"].y) == pytest.approx(50.0)
    assert chart.unit == "mrad" and chart.path


def test_recordings_without_presliding_have_no_loops():
    found = _case(*_sliding()[::2], _sliding()[3])
    assert over_displacement(found, motions_of(found), True) is None
    assert "no recording turns back twice within presliding" in _page(found)


def test_a_ripple_is_drawn_within_its_period():
    x, _, u, _ = _sliding()
    period, height = 0.2, 0.03
    found = _case(x, u, height * np.sin(2.0 * np.pi * x / period))
    named = MissingEffect("ripple", ("ripple",), 0.9, 1e-9, {"period": Estimate(period, 1e-3, "rad")}, "")
    found = replace(found, missing=(named,))
    chart = where_it_acts("ripple", found, motions_of(found), True)
    assert chart.name == "position within one period"
    for panel in chart.panels:
        base, extended = panel.series
        shown = np.isfinite(base.x)
        angle = 2.0 * np.pi * base.x[shown] / (1e3 * period if chart.unit == "mrad" else period)
        np.testing.assert_allclose(base.y[shown], 1e3 * height * np.sin(angle), atol=3.0)
        np.testing.assert_array_equal(extended.y[shown], 0.0)


def test_a_line_of_one_frequency_is_a_peak_of_the_spectrum():
    x, _, u, _ = _sliding()
    t = np.arange(x.size) / RATE
    found = _case(x, u, 0.01 * np.sin(2.0 * np.pi * 50.0 * t))
    chart = where_it_acts("mains_pickup", found, motions_of(found), True)
    base = chart.panels[0].series[0]
    peak = float(base.x[np.nanargmax(base.y)])
    assert chart.unit == "Hz" and peak == pytest.approx(50.0, rel=0.06)


@pytest.mark.parametrize("effect", sorted(catalogue()))
def test_every_effect_of_the_catalogue_has_its_picture(effect):
    """On a recording that visits everything: motion, reversals, rests, and an input that changes."""
    x, _, u, lacks = _sliding(4.0)
    rest = np.full(500, x[-1])
    x, u, lacks = np.r_[x, rest, x], np.r_[u, 0.0 * rest, u], np.r_[lacks, 0.0 * rest, lacks]
    found = _case(x, u, lacks + 0.01)
    chart = where_it_acts(effect, found, motions_of(found), True)
    assert {panel.unit.split("/")[0] for panel in chart.panels} <= {"mN·m", "N·m", "µN·m"}
    for panel in chart.panels:
        assert [one.colour for one in panel.series] == ["base", "extended"]
        assert np.isfinite(panel.series[0].y).any()


def test_every_variable_of_the_catalogue_can_be_drawn():
    assert set(get_args(Along)) == {*VARIABLES, "frequency"}
    assert where_it_acts("no_such_effect", fake_diagnosis(n=10), (), True) is None


def _page(diagnosis):
    from frictionjax.report.sections.friction import FrictionSection

    return str(FrictionSection().body(diagnosis))
