"""How results show themselves: numbers on a screen, also inside transformations, and as HTML."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import frictionjax as fj
from frictionjax.core.display import (
    Display,
    TextGrid,
    as_html,
    as_text,
    estimates_grid,
    one_line,
    records_grid,
    signal_row,
    value_text,
)

FRICTION = fj.LuGre(sigma0=1.2345678e5, sigma1=316.2, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3)


def test_a_model_shows_its_numbers():
    assert repr(FRICTION) == "LuGre(sigma0=123457, sigma1=316.2, sigma2=0.4, Fc=1, Fs=1.5, vs=0.001)"
    creep = fj.catalogue()["creep"][0](compliance=0.02)
    text = repr(fj.Drive(2.0, FRICTION, 16.0, (creep,)))
    assert text.startswith("Drive(J=2, friction=LuGre(sigma0=123457")
    assert "motor_constant=16" in text
    assert "compliance=0.02" in text
    assert repr(fj.Plant(motor_constant=16.0)).startswith("Plant(motor_constant=16, position_unit='position'")


@pytest.mark.parametrize("transform", [jax.jit, jax.grad, lambda f: jax.vmap(f, 0)])
def test_inside_a_transformation_a_number_is_a_type(transform):
    seen = []

    def level(Fc):
        friction = fj.LuGre(1e5, 300.0, 0.4, Fc, 1.5, 1e-3)
        seen.append(repr(fj.Drive(1.0, friction)))
        return friction.Fc

    transform(level)(jnp.ones(3) if transform not in (jax.jit, jax.grad) else jnp.asarray(1.0))
    assert seen
    assert all("Fc=f64[]" in text for text in seen)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (jnp.asarray(0.25), "0.25"),
        (np.float64(2.0), "2"),
        (np.int64(3), "3"),
        (1.0 / 3.0, "0.333333"),
        (np.array([1.0, 2.5]), "[1, 2.5]"),
        (np.linspace(-1.0, 2.0, 50), "f64[50] from -1 to 2"),
        (np.full(50, np.nan), "f64[50]"),
        (np.zeros((3, 4), bool), "b8[3,4]"),
        ("N*m", "'N*m'"),
        ((1.5,), "(1.5,)"),
        (tuple(range(9)), "(0, 1, 2, 3, 4, 5, ... 9 in all)"),
        ({"Fc": 1.0}, "{'Fc': 1}"),
        (None, "None"),
    ],
)
def test_values_in_a_few_words(value, text):
    assert value_text(value) == text


def test_a_line_leaves_out_what_is_none_or_unwanted():
    assert one_line(fj.Plant(inertia=0.1), "force_unit", "hold") == (
        "Plant(position_unit='position', input_unit='input', inertia=0.1)"
    )


def test_an_estimate_is_short_for_people_and_whole_for_programs():
    estimate = fj.Estimate(1814.123456789, 1.9123456, "N*m/rad")
    assert str(estimate) == "1814.123 ± 1.9 N*m/rad"
    assert eval(repr(estimate), {"Estimate": fj.Estimate}) == estimate
    unknown = fj.Estimate(0.4, float("inf"), "1", identified=False)
    assert str(unknown) == "0.4 (not determined)"
    assert eval(repr(unknown), {"Estimate": fj.Estimate, "inf": float("inf")}) == unknown


def test_tables_align_are_cut_and_count_what_is_left():
    grid = TextGrid(("name", "value"), tuple((f"row {k}", "x" * 200) for k in range(40)))
    text = as_text(Display("Title", ("word " * 60,), (grid,)))
    assert max(map(len, text.splitlines())) <= 100
    assert text.splitlines()[-1] == "  16 more rows"
    assert "row 23" in text
    assert "row 24" not in text


def test_html_is_escaped():
    page = as_html(Display("a < b", ("c & d",), (TextGrid(("h",), (("<script>",),)),)))
    assert "<script>" not in page
    assert "a &lt; b" in page
    assert "c &amp; d" in page


def test_grids_of_estimates_records_and_signals():
    grid = estimates_grid(
        {"Fc": fj.Estimate(1.0, 0.012, "N"), "share": fj.Estimate(0.4, float("inf"), "1", False)}
    )
    assert grid.rows == (("Fc", "1", "0.012", "N"), ("share", "0.4", "not determined", ""))
    grid = records_grid([{"a": 1.0, "b": None}, {"a": 2, "c": "x"}])
    assert grid == TextGrid(("a", "b", "c"), (("1", "", ""), ("2", "", "x")))
    assert signal_row("x", np.array([1.0, np.nan, -2.0]), "m") == ("x", "-2", "1", "m")
    assert signal_row("x", np.array([np.nan]), "m") == ("x", "no number", "", "m")


def test_recordings_and_cases_fit_a_screen():
    t = np.arange(500) / 1e3
    recording = fj.recording_from_frame({"t": t, "u": np.sin(t), "x": np.cos(9.0 * t)}, name="run")
    case = fj.Case("arm", fj.Plant(16.0, position_unit="rad"), (recording,))
    assert "500 samples at 1000 Hz, 0.5 s, to fit, open loop" in repr(recording)
    assert "rad" in repr(case.recordings[0])
    assert repr(case).startswith("Case arm\n")
    for text in (repr(recording), repr(case)):
        assert len(text) < 1000
    assert "<table>" in case._repr_html_()
