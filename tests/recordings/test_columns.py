"""Which column is which, in which unit: by the case, the header, or names that people use; and what is said of it."""

import warnings

import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files

N = 600
T = np.arange(N) / 1000.0
U, X = np.cos(40.0 * T), 0.01 * np.sin(31.0 * T)


def write(folder, header, columns=(T, U, X), name="run.csv", units=""):
    rows = [",".join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    (folder / name).write_text("\n".join([header, *([units] if units else []), *rows]) + "\n")
    return folder / name


def load(files, holdout=(), **options):
    """The case of bare files, and the warnings that came with it but that of the held-out third."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        case = case_from_files(files, holdout, **options)
    assert all(issubclass(one.category, FrictionjaxWarning) for one in said)
    return case, [str(one.message).split(": ", 1)[1] for one in said if "last third" not in str(one.message)]


def whole(case, channel="x"):
    return np.concatenate([getattr(recording, channel) for recording in case.recordings])


def test_names_that_people_use_are_found_and_said(tmp_path):
    case, said = load(write(tmp_path, "Time,Motor_Current,ActualPosition"))
    np.testing.assert_allclose(whole(case), X, rtol=1e-11)
    np.testing.assert_allclose(whole(case, "u"), U, rtol=1e-11)
    (sentence,) = said
    assert sentence == "`Time` was read as t, `Motor_Current` as u, `ActualPosition` as x."
    assert sentence in case.recordings[0].warnings


def test_the_names_of_the_roles_are_not_worth_a_word(tmp_path):
    assert load(write(tmp_path, "t,u,x"))[1] == []


def test_units_in_headers_are_converted_to_si(tmp_path):
    file = write(tmp_path, "Time (ms),Motor_Current [mA],x [deg]", (1e3 * T, 1e3 * U, np.rad2deg(X)))
    case, said = load(file)
    assert case.recordings[0].sample_rate == 1000.0
    np.testing.assert_allclose(whole(case), X, rtol=1e-10)
    np.testing.assert_allclose(whole(case, "u"), U, rtol=1e-10)
    assert (case.plant.position_unit, case.plant.input_unit) == ("rad", "A")
    assert "t was converted from ms to s, u from mA to A, x from deg to rad." in said


def test_a_line_of_units_counts_like_a_unit_in_the_header(tmp_path):
    case, _ = load(write(tmp_path, "t,u,x", (1e3 * T, U, 1e3 * X), units="ms,V,mm"))
    np.testing.assert_allclose(whole(case), X, rtol=1e-11)
    assert (case.recordings[0].sample_rate, case.plant.position_unit) == (1000.0, "m")


def test_a_unit_of_the_case_is_kept(tmp_path):
    file = write(tmp_path, "t,u,x [rad]")
    case, said = load(file, position_unit="deg")
    np.testing.assert_allclose(whole(case), np.rad2deg(X), rtol=1e-11)
    assert said == ["x was converted from rad to deg."]


def test_a_unit_that_the_case_gives_and_a_factor_that_it_gives(tmp_path):
    file = write(tmp_path, "t,u,x", (T, U, X))
    np.testing.assert_allclose(
        whole(load(file, units={"x": "turn/4096"})[0]), X * 2 * np.pi / 4096, rtol=1e-11
    )
    file = write(tmp_path, "t,u,x [deg]")
    case, said = load(file, scale={"x": 2.0})  # the factor is to the units of the case
    np.testing.assert_allclose(whole(case), 2.0 * X, rtol=1e-11)
    assert (case.plant.position_unit, said) == ("position", [])


def test_counts_are_kept_and_a_case_that_wants_more_is_warned(tmp_path):
    file = write(tmp_path, "t,u,x [counts]")
    assert load(file)[0].plant.position_unit == "counts"
    case, said = load(file, position_unit="rad")
    np.testing.assert_allclose(whole(case), X, rtol=1e-11)
    assert said == ["x is in counts and the case has rad: it was not converted."]


def test_two_columns_that_could_be_meant_are_listed(tmp_path):
    file = write(tmp_path, "t,Current,Voltage,x", (T, U, U, X))
    with pytest.raises(
        InputError,
        match=r"could be it: Current, Voltage\. .*t=t u=Current x=x; other columns: Voltage",
    ):
        load(file)
    assert load(file, columns={"u": "Voltage"})[1] == []


def test_a_torque_is_the_input_or_the_force(tmp_path):
    file = write(tmp_path, "t,torque,x")
    assert load(file)[1] == ["`torque` was read as u."]
    assert load(file, drive="motion")[1] == ["`torque` was read as force."]


def test_a_column_of_another_quantity_is_not_taken(tmp_path):
    with pytest.raises(InputError, match="there is no column `x`"):
        load(write(tmp_path, "t,u,position [V]"))
    with pytest.raises(InputError, match=r"`speed \[rpm\]` is in rpm, an angular speed, and is to be x"):
        load(write(tmp_path, "t,u,speed [rpm]"), columns={"x": "speed [rpm]"})
    with pytest.raises(InputError, match=r"in mm, a length, and the case has x in rad, an angle"):
        load(write(tmp_path, "t,u,x [mm]"), position_unit="rad")


def test_a_time_column_is_not_guessed_where_the_sample_rate_is_given(tmp_path):
    case, said = load(write(tmp_path, "time,u,x", (np.arange(N) * 7.0, U, X)), sample_rate=500.0)
    assert (case.recordings[0].sample_rate, said) == (500.0, [])


def test_a_unit_may_be_left_out_of_a_name(tmp_path):
    case, _ = load(write(tmp_path, "t,u,Joint (deg)"), columns={"x": "Joint"})
    np.testing.assert_allclose(whole(case), np.deg2rad(X), rtol=1e-11)


def test_units_in_some_files_only_are_refused(tmp_path):
    first = write(tmp_path, "t,u,x [deg]")
    second = write(tmp_path, "t,u,x", (T, U, -X), name="kept.csv")
    with pytest.raises(InputError, match=r'" gives no unit for x, and other files'):
        load(first, second)
    case, _ = load(first, second, position_unit="rad")
    np.testing.assert_allclose(case.recordings[1].x, -X, rtol=1e-11)


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_counts_since_1970_are_recognised(tmp_path, unit, size):
    stamps = np.round(1.7e9 * size) + np.round(T * size)
    rows = [f"{int(t)},{u:.12g},{x:.12g}" for t, u, x in zip(stamps, U, X, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(["t,u,x", *rows]))
    case, said = load(tmp_path / "run.csv")
    assert case.recordings[0].sample_rate == pytest.approx(1000.0, rel=1e-6)
    assert f"`t` was read as {unit} since 1970." in said


def test_an_uptime_of_the_size_of_a_date_is_none(tmp_path):
    file = write(tmp_path, "t,u,x", (1.5e12 + 1e4 * np.arange(N), U, X))
    with pytest.raises(InputError, match=r"sample rate would be 0\.0001 Hz.*--unit t=us"):
        load(file)


def test_a_header_whose_unit_cannot_be_is_not_believed(tmp_path):
    case, said = load(write(tmp_path, "Zeit [ms],u,x"))
    assert case.recordings[0].sample_rate == 1000.0
    assert "`Zeit [ms]` is too fine for ms: it was read as s." in said
    # One that can be is, however fast.
    fast, _ = load(write(tmp_path, "Zeit [ms],u,x", (20.0 * T, U, X)))
    assert fast.recordings[0].sample_rate == pytest.approx(5e4)
    given, _ = load(write(tmp_path, "t,u,x"), units={"t": "ms"})
    assert given.recordings[0].sample_rate == pytest.approx(1e6)


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"x": "parsec"}, r"key `units.x`: \"parsec\" is not a unit that is known.*turn/4096"),
        ({"t": "mm"}, r"key `units.t`: \"mm\" is a length, and t is not"),
        ({"v": "rad/s"}, r"key `units.v`: the recording has no column for `v`"),
    ],
)
def test_a_wrong_unit_of_the_case(tmp_path, units, words):
    with pytest.raises(InputError, match=words):
        load(write(tmp_path, "t,u,x"), units=units)


def test_intervals_and_starting_times_for_each_file(tmp_path):
    file = write(tmp_path, "t,u,x")
    case, _ = load(file, file, interval=[(0.0, 0.4), (0.4, 0.599)], start_time=5.0)
    assert [r.x.size for r in case.recordings] == [400, 199]
    assert [r.start_time for r in case.recordings] == [5.0, 5.4]
    with pytest.raises(InputError, match=r"`start_time` has 3 values for 2 files"):
        load(file, file, interval=[(0.0, 0.4), (0.4, 0.599)], start_time=[0.0, 1.0, 2.0])
    case, _ = load(file, interval=(0.0, 0.5))
    assert whole(case).size == 500
