"""A recording with a velocity and no position: the velocity is integrated, its noise and offset are known for what they
are."""

import dataclasses
import warnings

import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.diagnosis.intake.own_model import own_model
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.estimation.data.batch import noise_level
from frictionjax.physics import VelocityOffset
from frictionjax.recordings import Case, Plant, audit, case_from_files, load_case, recording_from_frame

RATE, N = 1000.0, 3000
T = np.arange(N) / RATE
U = np.cos(9.0 * T)
V = 2.0 * np.sin(7.0 * T)
X = 2.0 / 7.0 * (1.0 - np.cos(7.0 * T))


def read(columns, **options):
    """The recording of these columns, and what was said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        recording = recording_from_frame(columns, **options)
    assert all(issubclass(one.category, FrictionjaxWarning) for one in said)
    return recording, " ".join(recording.warnings)


def test_a_velocity_is_integrated_and_kept():
    recording, said = read({"t": T, "u": U, "v": V})
    assert recording.integrated
    np.testing.assert_array_equal(recording.v, V)
    np.testing.assert_allclose(recording.x, X, atol=3e-9)  # at the ends: the trapezoidal rule
    assert "There is no position: v was integrated." in said


def test_a_position_beside_it_stays_what_it_is():
    recording, said = read({"t": T, "u": U, "x": X, "v": V})
    assert not recording.integrated and "integrated" not in said
    np.testing.assert_array_equal(recording.x, X)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        ("v [mm/s]", 1e3, "m"),
        ("speed [rpm]", 60.0 / (2.0 * np.pi), "rad"),
        ("Omega (deg/s)", 180.0 / np.pi, "rad"),
        ("Drehzahl [rpm]", 60.0 / (2.0 * np.pi), "rad"),
    ],
)
def test_its_unit_is_that_of_the_position_a_second(tmp_path, name, factor, unit):
    table = np.column_stack([T, U, factor * V])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=f"t,u,{name}", comments="", fmt="%.12g")
    with pytest.warns(FrictionjaxWarning):
        case = case_from_files(tmp_path / "run.csv")
    said = " ".join(case.recordings[0].warnings)
    assert ("was read as v" in said) == (not name.startswith("v"))
    assert case.plant.position_unit == unit
    np.testing.assert_allclose(case.recordings[0].x, X[: case.recordings[0].x.size], atol=3e-9)
    assert all(recording.integrated for recording in case.recordings)


def test_a_case_file_names_it(tmp_path):
    for name in ("a", "b"):
        np.savetxt(
            tmp_path / f"{name}.csv",
            np.column_stack([T, U, V if name == "a" else -V]),
            delimiter=",",
            header="t,u,tacho",
            comments="",
        )
    keys = 'columns = {v = "tacho"}\nscale = {v = 2.0}\n'
    tables = [f'[[recording]]\nfile = "{name}.csv"\n{keys}' for name in ("a", "b")]
    (tmp_path / "case.toml").write_text(tables[0] + tables[1] + 'role = "holdout"\n', encoding="utf-8")
    with pytest.warns(FrictionjaxWarning, match="v was integrated"):
        case = load_case(tmp_path / "case.toml")
    np.testing.assert_allclose(case.recordings[0].x, 2.0 * X, atol=6e-9)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t": T, "u": U, "speed": V, "omega": V}, "no column `v`, and 2 columns could be it"),
        ({"t": T, "u": U, "v": V, "shaft angle": X}, "no column `x`"),
        ({"t": T, "u": U, "v": V, "gauge [mm]": X}, "no column `x`"),
        ({"t": T, "u": U, "rpm": V}, "no column `x`"),  # a unit alone is no name: it would not be converted
        ({"t": T, "u": U, "v": np.ones(N)}, "v is constant .* not the velocity"),
    ],
)
def test_what_could_be_meant_otherwise_is_refused(columns, message):
    with pytest.raises(InputError, match=message):
        recording_from_frame(columns)


def test_an_imposed_motion_needs_its_position():
    with pytest.raises(InputError, match="no column `x`"):
        recording_from_frame({"t": T, "force": U, "v": V}, drive="motion")


def test_a_simulated_position_has_nothing_to_be_compared_with():
    recording, said = read({"t": T, "u": U, "v": V, "simulated": X})
    assert recording.simulated is None
    assert "`simulated` could be compared with: it was left out" in said


@pytest.mark.parametrize("sigma", [1e-3, 3e-2])
def test_its_noise_is_that_of_the_steps_of_a_random_walk(sigma):
    noise = sigma * np.random.default_rng(2).standard_normal(N)
    recording, _ = read({"t": T, "u": U, "v": V + noise})
    # The variance of what a second of white noise adds to the integral, by both descriptions.
    assert 2.0 * noise_level(recording) ** 2 * RATE == pytest.approx(sigma**2 / RATE, rel=0.1)


def test_the_offset_of_its_sensor_is_a_part_of_the_base_model():
    first, _ = read({"t": T, "u": U, "v": V})
    second = dataclasses.replace(first, name="second", role="holdout")
    case = Case("one", Plant(), (first, second))
    assert own_model(case).effects == (VelocityOffset(),)
    notes = starting_point(case).notes
    assert any("Positions are integrated velocities" in note for note in notes)
    assert not any("As the case says" in note for note in notes)
    mixed = Case("mixed", Plant(), (first, dataclasses.replace(second, integrated=False)))
    with pytest.raises(
        InputError, match="recording gives a velocity alone, and other recordings have a position"
    ):
        own_model(mixed)


def test_the_audit_speaks_of_the_velocity():
    grid = 0.05 * np.round(V / 0.05)
    recording, _ = read({"t": T, "u": U, "v": grid})
    plant = Plant(position_unit="rad", encoder_step=1e-3)
    found = audit(recording, plant)
    assert found.encoder_step == pytest.approx(0.05)
    said = " ".join(found.sentences())
    assert "v lies on a grid of 0.05 rad/s" in said and "encoder step" not in said
    smooth, _ = read({"t": T, "u": U, "v": V})
    assert "v has no noise near the Nyquist frequency" in " ".join(audit(smooth, plant).concerns())
