"""The free vector: there and back, inside its ranges, and honest about their ends."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import ARM, PLANT, truth
from helpers_plants import FORMS, effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.estimation.constraints import Constraints
from frictionjax.estimation.objective.model import ParametricModel, physical
from frictionjax.estimation.parameters import (
    INSIDE,
    at_a_bound,
    at_an_end,
    base_layout,
    changed,
    effect_layout,
    pack,
    touching,
    unpack,
)
from frictionjax.physics import Drive, LuGre

DT = 5e-4
BASE = base_layout(PLANT, DT)
SCALES = {
    name: 1.0 + 0.1 * k
    for k, name in enumerate(
        [
            *("Fc", "sigma0", "sigma2", "vs", "zs", "stroke", "center", "Fc/stroke", "dt"),
            *("u", "1/u^2", "Fc/speed^2", "Fc/speed^3", "step"),
        ]
    )
}
"""Sizes without a meaning, each its own number, so that a mix-up shows."""


def _physical(layout, drive, vector, start):
    """Values at `vector` and their Jacobian, with ranges about `start`."""
    return physical(ParametricModel(Constraints(layout, (), ()), drive, start), vector)


def _decades(low, high):
    return st.floats(np.log(low), np.log(high)).map(np.exp)


@st.composite
def drives(draw):
    """Drives of any size whose parameters lie well inside the ranges that a fit keeps at 2 kHz."""
    J, Fc = draw(_decades(1e-6, 1e3)), draw(_decades(1e-3, 1e3))
    sigma0 = J * draw(_decades(1.0, 1000.0)) ** 2
    sigma1 = 2.0 * draw(_decades(2e-3, 1.4)) * np.sqrt(sigma0 * J)
    friction = LuGre(
        sigma0=sigma0,
        sigma1=sigma1,
        sigma2=draw(_decades(1e-6, 1e3)),
        Fc=Fc,
        Fs=Fc * (1.0 + draw(_decades(2e-3, 1.9))),
        vs=draw(_decades(1e-6, 10.0)),
    )
    return Drive(J, friction, motor_constant=draw(_decades(1e-2, 1e2)))


@settings(max_examples=30)
@given(drives(), st.booleans())
def test_a_drive_is_packed_and_unpacked(drive, known_inertia):
    layout = base_layout(drive, DT, known_inertia=known_inertia)
    vector = pack(layout, drive)
    again = unpack(layout, drive, vector, vector)
    assert truth(again) == pytest.approx(truth(drive), rel=1e-9)
    assert float(again.motor_constant) == float(drive.motor_constant)
    assert [free.label for free in layout] == list(ARM[known_inertia:])


@settings(max_examples=30)
@given(st.lists(st.floats(0.02, 0.98), min_size=7, max_size=7))
def test_a_vector_is_unpacked_and_packed(parts):
    start = pack(BASE, PLANT)
    ranges = [tuple(float(end) for end in free.range(first)) for free, first in zip(BASE, start, strict=True)]
    vector = jnp.asarray([low + part * (high - low) for part, (low, high) in zip(parts, ranges, strict=True)])
    drive = unpack(BASE, PLANT, vector, start)
    if float(drive.friction.sigma0 / drive.J) < 0.99 * (0.6 / DT) ** 2:
        np.testing.assert_allclose(pack(BASE, drive), vector, atol=1e-9)


@settings(max_examples=30)
@given(st.lists(st.floats(-1e3, 1e3), min_size=7, max_size=7))
def test_wherever_a_step_leads_the_parameters_stay_in_range(wild):
    start = pack(BASE, PLANT)
    drive = unpack(BASE, PLANT, jnp.asarray(wild), start)
    friction, first = drive.friction, truth(PLANT)
    assert all(np.isfinite(value) and value > 0.0 for value in truth(drive).values())
    slack = 1.0 + 1e-9
    assert 1e-3 / slack < float(friction.Fs / friction.Fc) - 1.0 < 2.0 * slack
    ratio = float(friction.sigma1) / (2.0 * np.sqrt(float(friction.sigma0 * drive.J)))
    assert 1e-3 / slack < ratio < 1.5 * slack
    assert float(friction.sigma0 / drive.J) < (0.6 / DT) ** 2 * slack
    for name, reach in {"J": 3.0, "Fc": 4.0, "sigma2": 100.0, "vs": 30.0}.items():
        assert 1.0 / (reach * slack) < truth(drive)[name] / first[name] < reach * slack


def _with_values(name):
    """`effect(name)` with every fitted value well inside its range and away from zero, and these values."""
    form = FORMS[name]
    values = {}
    for k, parameter in enumerate(form.strengths):
        room = min(parameter.upper, -parameter.lower if parameter.lower < 0.0 else parameter.upper, 1e-2)
        values[parameter.name] = (0.3 + 0.1 * k) * room
    return effect(name, **values), values


@pytest.mark.parametrize("name", FORMS)
def test_an_effect_is_packed_and_unpacked(name):
    added, values = _with_values(name)
    drive = PLANT.with_effects(added)
    layout = effect_layout(drive, SCALES)
    fitted = [p for p in added.strengths + added.nuisances if p.transform != "none"]
    assert [free.label for free in layout] == [p.name for p in fitted]
    vector = pack(layout, drive)
    for free, coordinate in zip(layout, vector, strict=True):
        if free.parameter.transform == "linear":
            scale = free.parameter.scale
            scale = scale if isinstance(scale, float) else SCALES[scale]
            assert float(coordinate) * scale == pytest.approx(float(getattr(added, free.label)), abs=1e-15)
    again = unpack(layout, drive, vector, vector).effects[0]
    for parameter in added.strengths + added.nuisances:
        assert float(getattr(again, parameter.name)) == pytest.approx(
            float(getattr(added, parameter.name)), rel=1e-9, abs=1e-15
        )
    assert all(float(getattr(added, key)) == value for key, value in values.items())


@pytest.mark.parametrize("name", FORMS)
def test_an_effect_stays_in_its_range(name):
    drive = PLANT.with_effects(effect(name))
    layout = effect_layout(drive, SCALES)
    start = pack(layout, drive)
    for far in (-1e6, 1e6):
        found = unpack(layout, drive, jnp.full(len(layout), far), start).effects[0]
        for free in layout:
            value = float(getattr(found, free.label))
            assert free.parameter.lower - 1e-12 <= value <= free.parameter.upper * (1.0 + 1e-9) + 1e-12


def test_effects_follow_the_base_and_each_other():
    drive = PLANT.with_effects(effect("ConstantLoad", load=0.1), effect("Delay", delay=1e-3))
    layout = base_layout(drive, DT) + effect_layout(drive, SCALES)
    assert [free.path for free in layout[7:]] == ["effects.0.load", "effects.1.delay"]
    assert [free.label for free in effect_layout(drive, SCALES, first=1)] == ["delay"]
    values, _ = _physical(layout, drive, pack(layout, drive), pack(layout, drive))
    np.testing.assert_allclose(values, [*truth(PLANT).values(), 0.1, 1e-3], rtol=1e-12)


def test_the_ends_of_a_range_are_reported():
    start = pack(BASE, PLANT)
    assert at_a_bound(BASE, start, start) == ()
    for index, free in enumerate(BASE):
        low, high = (float(end) for end in free.range(start[index]))
        for end in (low, high, high + 3.0):
            assert at_a_bound(BASE, jnp.asarray(start).at[index].set(end), start) == (free.label,)
        assert at_a_bound(BASE, jnp.asarray(start).at[index].set(high - 1e-6), start) == ()


def test_the_ends_of_a_range_are_found_inside_transformations():
    """Many vectors side by side, each beyond one end of one range."""
    start = pack(BASE, PLANT)
    for side, outward in ((0, -1e-9), (1, 1e-9)):
        ends = [
            jnp.asarray(start).at[i].set(float(free.range(start[i])[side]) + outward)
            for i, free in enumerate(BASE)
        ]
        found = jax.jit(jax.vmap(lambda vector: touching(BASE, vector, start)))(jnp.stack(ends))
        np.testing.assert_array_equal(found, np.eye(len(BASE), dtype=bool))


def test_a_value_where_a_descent_is_stopped_is_at_an_end():
    """A fit that would leave a range is put back just inside, where there still is a slope; and a user's bound."""
    start, values = pack(BASE, PLANT), np.array(list(truth(PLANT).values()))
    assert not np.any(at_an_end(BASE, start, start, values))
    for index, free in enumerate(BASE):
        low, high = (float(end) for end in free.range(start[index]))
        for end in (low + INSIDE, high - INSIDE, high + 3.0):
            found = at_an_end(BASE, jnp.asarray(start).at[index].set(end), start, values)
            assert np.flatnonzero(found).tolist() == [index]
        bounded = list(BASE)
        for bounds in ((values[index], 9e9), (0.0, values[index])):
            bounded[index] = eqx.tree_at(
                lambda f: (f.least, f.most), free, tuple(np.asarray(end) for end in bounds)
            )
            ended = jax.jit(lambda layout, *rest: at_an_end(layout, *rest))
            for found in (at_an_end, ended):
                there = found(tuple(bounded), start, start, values)
                assert np.flatnonzero(there).tolist() == [index]


def test_a_strength_that_rests_on_zero_is_at_the_end_of_its_range():
    drive = PLANT.with_effects(effect("Delay"))
    layout = effect_layout(drive, SCALES)
    assert at_a_bound(layout, jnp.zeros(1), jnp.zeros(1)) == ("delay",)


def test_a_start_at_an_end_is_moved_inside():
    """A clipped coordinate has no slope: the first step would never leave the end."""
    friction = LuGre(sigma0=2000.0, sigma1=1e-6, sigma2=0.06, Fc=0.5, Fs=0.5, vs=0.06)
    drive = Drive(0.03, friction, motor_constant=16.0)
    layout = base_layout(drive, DT)
    vector = pack(layout, drive)
    assert at_a_bound(layout, vector, vector) == ()
    _, jacobian = _physical(layout, drive, vector, vector)
    assert np.all(np.abs(np.diag(jacobian)) > 0.0)


def test_physical_jacobian_agrees_with_differences():
    start = pack(BASE, PLANT)
    _, jacobian = _physical(BASE, PLANT, start, start)
    h = 1e-5
    for index in range(len(BASE)):
        moved = [
            _physical(BASE, PLANT, jnp.asarray(start).at[index].add(s * h), start)[0] for s in (-1.0, 1.0)
        ]
        difference = (moved[1] - moved[0]) / (2.0 * h)
        np.testing.assert_allclose(jacobian[:, index], difference, rtol=1e-8, atol=1e-8)
    # A heavier machine of the same frequency and damping ratio has more stiffness and damping; at the same Fs/Fc,
    # more Coulomb friction is more static friction.
    assert jacobian[1, 0] == pytest.approx(float(PLANT.friction.sigma0))
    assert jacobian[2, 0] == pytest.approx(float(PLANT.friction.sigma1))
    assert jacobian[5, 4] == pytest.approx(float(PLANT.friction.Fs))


@pytest.fixture(scope="module")
def packed():
    """Every form packed, and unpacked elsewhere, form -> (vector, drive): from known numbers, and in one program."""
    drives = {name: PLANT.with_effects(_with_values(name)[0]) for name in FORMS}
    layouts = {name: BASE + effect_layout(drive, SCALES) for name, drive in drives.items()}
    vectors = {name: pack(layouts[name], drive) for name, drive in drives.items()}

    def every(layouts, drives, vectors):
        found = {}
        for name, layout in layouts.items():
            again = unpack(layout, drives[name], vectors[name] + 0.01, vectors[name])
            found[name] = pack(layout, drives[name]), again
        return found

    return every(layouts, drives, vectors), jax.jit(every)(layouts, drives, vectors)


@pytest.mark.parametrize("name", FORMS)
def test_known_numbers_are_packed_as_traced_ones_are(packed, name):
    """By NumPy where the numbers are known, by JAX under a transformation: one answer."""
    (vector, drive), (traced, traced_drive) = (each[name] for each in packed)
    np.testing.assert_allclose(vector, traced, rtol=1e-14, atol=1e-14)
    for ours, theirs in zip(jax.tree.leaves(drive), jax.tree.leaves(traced_drive), strict=True):
        assert isinstance(ours, jax.Array)
        assert ours.dtype == theirs.dtype
        np.testing.assert_allclose(ours, theirs, rtol=1e-14)


def test_what_has_no_logarithm_starts_at_the_end_of_its_range():
    """And without a word from NumPy: warnings are errors here."""
    still = eqx.tree_at(lambda drive: drive.friction.sigma1, PLANT, jnp.asarray(0.0))
    index = [free.label for free in BASE].index("sigma1")
    low, _ = BASE[index].range(pack(BASE, PLANT)[index])
    assert float(pack(BASE, still)[index]) == pytest.approx(float(low) + 1e-3)


def test_a_changed_vector_is_another():
    vector = jnp.arange(4.0)
    again = changed(vector, slice(1, 3), [7.0, 8.0])
    assert again.tolist() == [0.0, 7.0, 8.0, 3.0]
    assert vector.tolist() == [0.0, 1.0, 2.0, 3.0]
