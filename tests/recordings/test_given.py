"""What may stand for a case: paths, recordings and tables in memory, read and checked like files."""

import warnings

import numpy as np
import pytest

import frictionjax as fj
from frictionjax.recordings.frame import recording_from_frame
from frictionjax.recordings.given import case_of, whole_recording

RATE, N = 1000.0, 900
T = np.arange(N) / RATE
COLUMNS = {"t": T, "u": np.sin(7.0 * T), "x": 1e-3 * np.sin(7.0 * T - 0.3)}
PLANT = fj.Plant(motor_constant=16.0, position_unit="rad", force_unit="N*m", input_unit="V", inertia=0.1)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "run.csv"
    np.savetxt(
        path, np.column_stack(list(COLUMNS.values())), header="t,u,x", comments="", delimiter=",", fmt="%.17g"
    )
    return path


def _case(data, **plant):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fj.FrictionjaxWarning)
        return case_of(data, **plant)


def test_a_table_in_memory_is_read_like_a_file(file):
    from_file, from_memory = whole_recording(file), recording_from_frame(COLUMNS, name="run")
    for name in ("name", "sample_rate", "role", "warnings"):
        assert getattr(from_file, name) == getattr(from_memory, name)
    np.testing.assert_array_equal(from_file.x, from_memory.x)
    np.testing.assert_array_equal(from_file.u, from_memory.u)


def test_columns_scale_role_and_interval_hold_in_memory_too():
    table = {"time": 1e3 * T, "volt": COLUMNS["u"], "mrad": 1e3 * COLUMNS["x"]}
    names = {"t": "time", "u": "volt", "x": "mrad"}
    made = recording_from_frame(
        table, columns=names, scale={"t": 1e-3, "x": 1e-3}, role="holdout", interval=(0.1, 0.5), plant=PLANT
    )
    assert (made.role, made.plant, made.x.size) == ("holdout", PLANT, 400)
    np.testing.assert_allclose(made.x, COLUMNS["x"][100:500], rtol=1e-12)


@pytest.mark.parametrize("stamps", ["calendar", "durations"])
def test_times_may_be_dates_or_durations(stamps):
    times = np.round(1e6 * T).astype("timedelta64[us]")
    times = np.datetime64("2026-03-01T12:00:00") + times if stamps == "calendar" else times
    assert recording_from_frame({**COLUMNS, "t": times}).sample_rate == pytest.approx(RATE)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x": np.array(["a"] * N)}, "`x` holds <U1, not numbers"),
        ({"x": np.zeros((N, 2))}, "`x` has the shape"),
        ({"u": np.full(N, np.nan)}, "row 0, column `u`"),
    ],
)
def test_a_column_that_cannot_be_read_is_named(change, words):
    with pytest.raises(fj.InputError, match=words):
        recording_from_frame({**COLUMNS, **change})


def test_a_missing_column_is_named_with_those_that_are_there():
    with pytest.raises(fj.InputError, match=r"there is no column `x`.*t=t u=u x=FILL_IN"):
        recording_from_frame({"t": T, "u": COLUMNS["u"]})


def test_every_form_of_one_recording_gives_the_same_case(file):
    recording = recording_from_frame(COLUMNS, name="run", plant=PLANT)
    by_file = _case(file, plant=PLANT)
    assert by_file.plant == PLANT
    for data in (str(file), [file], recording, [recording], COLUMNS):
        case = _case(data, plant=PLANT)
        assert case.plant == PLANT
        assert [one.role for one in case.recordings] == ["fit", "holdout"]
        np.testing.assert_array_equal(case.fit_recordings[0].x, by_file.fit_recordings[0].x)


def test_recordings_keep_their_roles_and_what_is_known_of_their_machine():
    parts = [recording_from_frame(COLUMNS, plant=PLANT, name=role, role=role) for role in ("fit", "holdout")]
    case = _case(parts)
    assert case.plant == PLANT
    assert [one.name for one in case.holdout_recordings] == ["holdout"]


def test_a_case_file_and_a_case_are_taken_as_they_are(file, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(
        f'[plant]\nmotor_constant = 16.0\n[[recording]]\nfile = "{file.name}"\n', encoding="utf-8"
    )
    case = _case(path)
    assert case.plant.motor_constant == 16.0
    assert case_of(case) is case
    with pytest.raises(fj.InputError, match="describes its machine, and another `plant` is given"):
        _case(path, plant=PLANT)


@pytest.mark.parametrize("data", [3, [], [3], None, np.zeros(4)])
def test_what_is_no_case_is_refused_with_what_would_be(data):
    with pytest.raises(fj.InputError, match=r"`case`: .* is not a case. Give a `Case`, the path"):
        case_of(data)


def test_recordings_of_two_machines_make_no_case():
    parts = [
        recording_from_frame(COLUMNS, plant=plant, name=name)
        for plant, name in ((PLANT, "a"), (fj.Plant(motor_constant=2.0), "b"))
    ]
    with pytest.raises(fj.InputError, match="machines that are described differently"):
        case_of(parts)


def test_a_case_gives_its_plant_to_every_recording():
    recording = recording_from_frame(COLUMNS)
    assert recording.plant is None
    case = fj.Case("bench", PLANT, (recording,))
    assert [one.plant for one in case.recordings] == [PLANT]


def test_frames_of_pandas_polars_and_xarray_are_read():
    pandas = pytest.importorskip("pandas")
    xarray = pytest.importorskip("xarray")
    frame = pandas.DataFrame(COLUMNS)
    frames = [frame, frame.set_index("t"), xarray.Dataset.from_dataframe(frame.set_index("t"))]
    for one in frames:
        made = recording_from_frame(one)
        assert made.sample_rate == pytest.approx(RATE)
        np.testing.assert_array_equal(made.x, COLUMNS["x"])
