"""The column of what a simulation gives: its name, its unit, and what is said where it cannot be one."""

import warnings

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings import Plant, case_from_files, load_case, recording_from_frame

N = 600
T = np.arange(N) / 1000.0
U, X = np.cos(40.0 * T), 0.01 * np.sin(31.0 * T)
SIM = X + 1e-3 * np.cos(31.0 * T)


def write(folder, header, columns, name="run.csv"):
    rows = [",".join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    (folder / name).write_text("\n".join([header, *rows]) + "\n")
    return folder / name


def load(file, **options):
    """The case of a file, and what is said when it is read, but of the held-out third."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        case = case_from_files(file, **options)
    return case, [str(one.message).split(": ", 1)[1] for one in said if "last third" not in str(one.message)]


def whole(case, channel):
    return np.concatenate([getattr(recording, channel) for recording in case.recordings])


def test_the_column_is_read_kept_and_shown(tmp_path):
    case, said = load(write(tmp_path, "t,u,x,simulated", (T, U, X, SIM)))
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    assert said == [] and [one.simulated.size for one in case.recordings] == [400, 200]
    assert "simulated" in repr(case.recordings[0])
    assert load(write(tmp_path, "t,u,x", (T, U, X)))[0].recordings[0].simulated is None


@pytest.mark.parametrize("name", ["sim", "x_sim", "Model", "Simulated_Position", "x_simulated"])
def test_names_that_people_use_are_found_and_said(tmp_path, name):
    case, said = load(write(tmp_path, f"t,u,x,{name}", (T, U, X, SIM)))
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    assert said == [f"`{name}` was read as simulated."] and said[0] in case.recordings[0].warnings


def test_its_unit_is_converted_to_that_of_the_position(tmp_path):
    case, said = load(
        write(tmp_path, "t,u,x,simulated [deg]", (T, U, X, np.rad2deg(SIM))), position_unit="rad"
    )
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    assert said == ["simulated was converted from deg to rad."]
    case, said = load(write(tmp_path, "t,u,x [mm],x_sim [m]", (T, U, 1e3 * X, SIM)))
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    assert case.plant.position_unit == "m"


def test_without_a_unit_it_counts_as_the_position_does(tmp_path):
    case, _ = load(write(tmp_path, "t,u,x [deg],simulated", (T, U, np.rad2deg(X), np.rad2deg(SIM))))
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    file = write(tmp_path, "t,u,x,simulated", (T, U, 1e3 * X, 1e3 * SIM))
    np.testing.assert_allclose(whole(load(file, scale={"x": 1e-3})[0], "simulated"), SIM, rtol=1e-10)
    own = load(file, scale={"x": 1e-3, "simulated": 2e-3})[0]
    np.testing.assert_allclose(whole(own, "simulated"), 2.0 * SIM, rtol=1e-10)


def test_a_unit_of_another_quantity_is_refused_and_one_that_cannot_be_compared_is_said(tmp_path):
    file = write(tmp_path, "t,u,x [rad],simulated [mm]", (T, U, X, SIM))
    with pytest.raises(
        InputError, match=r"`simulated \[mm\]` is in mm, a length, and the case has simulated in rad"
    ):
        load(file)
    _, said = load(write(tmp_path, "t,u,x,simulated [deg]", (T, U, X, SIM)))
    assert said == ["simulated is in deg and the case has position: it was not converted."]


def test_where_the_motion_is_imposed_it_is_the_force(tmp_path):
    file = write(tmp_path, "t,x [rad],force [N*m],force_sim [mN*m]", (T, X, U, 1e3 * SIM))
    case, said = load(file, drive="motion")
    np.testing.assert_allclose(whole(case, "simulated"), SIM, rtol=1e-10)
    assert "`force_sim [mN*m]` was read as simulated." in said
    assert load(file, columns={"u": "force [N*m]"})[0].recordings[0].simulated is None


def test_a_column_that_may_be_something_else_is_left_out_and_said(tmp_path):
    """Found by its name alone: a number of a model, or holes; of two, none."""
    _, said = load(write(tmp_path, "t,u,x,model", (T, U, X, np.full(N, 3.0))))
    assert said == []
    case, _ = load(write(tmp_path, "t,u,x,model", (T, U, X, np.full(N, 3.0))))
    assert any(
        "`model` never changes: it was not read as simulated." in one for one in case.recordings[0].warnings
    )
    holes = np.where(np.arange(N) % 7, SIM, np.nan)
    case, _ = load(write(tmp_path, "t,u,x,sim", (T, U, X, holes)))
    assert case.recordings[0].simulated is None
    assert any("values that are missing or no numbers" in one for one in case.recordings[0].warnings)
    case, said = load(write(tmp_path, "t,u,x,sim,model", (T, U, X, SIM, SIM)))
    assert said == ["2 columns could be simulated, and none was read: sim, model."]


def test_a_column_that_is_named_must_be_numbers_of_the_same_length(tmp_path):
    holes = np.where(np.arange(N) == 17, np.nan, SIM)
    with pytest.raises(InputError, match="line 19, column `simulated`: the value is missing or NaN"):
        load(write(tmp_path, "t,u,x,simulated", (T, U, X, holes)))
    short = {"t": T, "u": U, "x": X, "simulated": SIM[:-3]}
    found = recording_from_frame(short)
    assert found.simulated is None
    assert "`simulated` has 597 samples and x has 600: it was left out." in found.warnings
    with pytest.raises(InputError, match=r"`simulated` \(simulated\) has 597 samples, `x` \(x\) has 600"):
        recording_from_frame(short, columns={"simulated": "simulated"})


def test_it_is_cut_and_resampled_with_the_recording(tmp_path):
    stamps = T + 2e-4 * np.random.default_rng(3).uniform(-1.0, 1.0, N)
    frame = {
        "t": stamps,
        "u": U,
        "x": 0.01 * np.sin(31.0 * stamps),
        "simulated": 0.02 * np.sin(31.0 * stamps),
    }
    with pytest.warns(match="onto a uniform grid"):
        found = recording_from_frame(frame, interval=(0.1, 0.4), plant=Plant(position_unit="rad"))
    np.testing.assert_allclose(found.simulated, 2.0 * found.x, rtol=1e-9)
    assert found.simulated.size == found.x.size < 310
    assert found.to_dataframe().columns.tolist() == ["u", "x", "simulated"]


def test_a_simulated_angle_that_wraps_is_unwrapped():
    ramp = np.linspace(0.0, 12.0, N)
    wrapped = np.mod(ramp, 2.0 * np.pi)
    frame = {"t": T, "u": U, "x": wrapped, "simulated": wrapped}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = recording_from_frame(frame, plant=Plant(position_unit="rad"))
    assert len(said) == 2
    np.testing.assert_allclose(found.simulated, ramp, atol=1e-9)
    assert "The simulated position jumps by full turns: it was unwrapped." in found.warnings


def test_a_case_file_names_the_column(tmp_path):
    rows = (T, U, X, SIM)
    for name in ("run.csv", "kept.csv"):
        write(
            tmp_path,
            "t,u,x,plant model v3",
            (*rows[:2], *(np.roll(one, len(name)) for one in rows[2:])),
            name=name,
        )
    (tmp_path / "case.toml").write_text(
        '[[recording]]\nfile = "run.csv"\ncolumns = {simulated = "plant model v3"}\n'
        '[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'
    )
    first, kept = load_case(tmp_path / "case.toml").recordings
    np.testing.assert_allclose(first.simulated, np.roll(SIM, 7), rtol=1e-10)
    assert kept.simulated is None
