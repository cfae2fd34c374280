"""Files as loggers write them: late stamps, frames written twice, decimal commas, blocks above the header, dates."""

import numpy as np
import pytest
from helpers_recordings import HEADER
from scipy.io import savemat

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import load_case
from frictionjax.recordings.readers import open_table
from frictionjax.recordings.sampling import punctual

N = 600
T = np.arange(N) / 1000.0
U, X = np.cos(40.0 * T), np.round(np.sin(31.0 * T), 6)


def lines(t=T, u=U, x=X):
    return [f"{a:.4f},{b:.6f},{c:.6f}" for a, b, c in zip(t, u, x, strict=True)]


def load(folder, rows, *, keys="", cut=0.4, header="t,u,x"):
    """A case whose file has these `rows`, divided at `cut`; `keys` in both recordings."""
    (folder / "run.csv").write_text("\n".join([header, *rows] if header else rows) + "\n")
    part = '[[recording]]\nfile = "run.csv"\n' + keys
    text = (
        f"{HEADER}{part}\ninterval = [0.0, {cut}]\n{part}\ninterval = [{cut}, 0.599]\n" + 'role = "holdout"\n'
    )
    (folder / "case.toml").write_text(text)
    return load_case(folder / "case.toml")


def stalled(at, behind=5.1, short=0.3):
    """Stamps of a clock that stalls for so many steps at each of `at`, and catches up by short steps."""
    stamps = T.copy()
    for first in at:
        k, left = first, behind
        while left > 0.0:
            stamps[k] = T[k] + 1e-3 * left
            left, k = left - (1.0 - short), k + 1
    return stamps


@pytest.mark.parametrize("cut", [0.4, 0.203], ids=["between stalls", "within a stall"])
def test_a_clock_that_stalls_and_catches_up_lacks_no_sample(tmp_path, cut):
    with pytest.warns(FrictionjaxWarning, match="time stamps came late and none is missing"):
        case = load(tmp_path, lines(stalled([100, 200, 450])), cut=cut)
    for recording in case.recordings:
        assert recording.sample_rate == 1000.0
        assert (recording.sampling.missing, recording.sampling.gaps) == (0, ())
        assert recording.sampling.late > 0
        assert not recording.sampling.resampled
    np.testing.assert_array_equal(np.concatenate([r.x for r in case.recordings]), X[:599])


def test_what_a_clock_never_makes_up_for_is_missing(tmp_path):
    stamps = stalled([100])
    stamps[300:] += 3e-3
    with pytest.warns(FrictionjaxWarning, match="1 gap .3 samples missing"):
        case = load(tmp_path, lines(stamps))
    assert case.recordings[0].sampling.missing == 3
    assert case.recordings[0].sampling.late > 0


def test_stamps_in_time_stay_as_they_are():
    rng = np.random.default_rng(3)
    for stamps in (T, T + 1e-4 * rng.uniform(-1.0, 1.0, N), np.cumsum(rng.exponential(1e-3, N))):
        found, late = punctual(stamps)
        assert not late.any()
        assert found is stamps or np.array_equal(found, stamps)


def test_a_frame_that_was_written_twice_counts_once(tmp_path):
    rows = lines()
    for k in (50, 300, 301, 500):
        rows.insert(k, rows[k])
    with pytest.warns(FrictionjaxWarning, match="rows? repeats? the row before, time included"):
        case = load(tmp_path, rows)
    assert [r.sampling.repeated for r in case.recordings] == [3, 1]
    np.testing.assert_array_equal(np.concatenate([r.x for r in case.recordings]), X[:599])


def test_a_stamp_that_occurs_twice_with_other_values_is_named_with_all_its_digits(tmp_path):
    rows = [f"{1.7e9 + a:.3f},{b:.6f},{c:.6f}" for a, b, c in zip(T, U, X, strict=True)]
    rows[77] = f"{1.7e9 + T[76]:.3f},0.5,0.5"
    with pytest.raises(
        InputError, match=r"line 79, column `t`: time stands still \(1700000000.076 s, then 1700"
    ):
        _whole(tmp_path, rows)


def _whole(folder, rows):
    (folder / "run.csv").write_text("\n".join(["t,u,x", *rows]) + "\n")
    (folder / "case.toml").write_text(HEADER + '[[recording]]\nfile = "run.csv"\n')
    return load_case(folder / "case.toml")


@pytest.mark.parametrize("header", ["", "sample,torque,angle"])
def test_columns_may_be_given_by_their_numbers(tmp_path, header):
    case = load(tmp_path, lines(), keys="columns = {t = 1, u = 3, x = 2}", header=header)
    np.testing.assert_allclose(case.recordings[0].x, np.round(U[:400], 6))
    np.testing.assert_allclose(case.recordings[0].u, X[:400])


@pytest.mark.parametrize("number", ["0", "-1", "true", "1.5"])
def test_what_is_no_number_of_a_column_is_refused(tmp_path, number):
    with pytest.raises(InputError, match=r"key `columns.x`"):
        load(tmp_path, lines(), keys=f"columns = {{x = {number}}}")


def test_a_column_beyond_the_last_is_not_there(tmp_path):
    with pytest.raises(InputError, match="there is no column `4`"):
        load(tmp_path, lines(), keys="columns = {x = 4}")


@pytest.mark.parametrize("separator", [";", "\t", "  "])
def test_decimal_commas_are_points_where_another_sign_separates(tmp_path, separator):
    rows = [row.replace(",", separator).replace(".", ",") for row in lines()]
    with pytest.warns(FrictionjaxWarning, match="commas in numbers were read as decimal points"):
        case = load(tmp_path, rows, header=separator.join("tux"))
    np.testing.assert_array_equal(case.recordings[0].x, X[:400])


@pytest.mark.parametrize(
    "text", ["1,2,3\n4,5,6\n", "1, 2, 3\n4, 5, 6\n", "1;2;3\n4;5;6\n", "0.1;1,000;3\n0.2;2,000;4\n"]
)
def test_other_commas_are_no_decimal_points(tmp_path, text, recwarn):
    (tmp_path / "run.csv").write_text(text * 30)
    open_table(tmp_path / "run.csv")
    assert not recwarn


BLOCK = """Name;Scope project
Starttime;133280341800000000;04.05.2023

Name;Angle;Name;Torque
Comment;;Comment;
Type;REAL64;Type;INT16
SampleTime[ms];1;SampleTime[ms];1
Unit;deg;Unit;0.1 %
"""


def test_lines_of_a_scope_above_the_numbers_are_no_data(tmp_path):
    rows = [f"{a};{c};{a};{b}" for a, b, c in (row.split(",") for row in lines())]
    keys = 'columns = {t = "Name", x = "Angle", u = "Torque"}'
    with pytest.warns(FrictionjaxWarning, match="x was converted from deg to rad"):
        case = load(tmp_path, rows, keys=keys, header=BLOCK)
    np.testing.assert_allclose(case.recordings[0].x, np.deg2rad(X[:400]), rtol=1e-15)
    assert case.plant.position_unit == "rad"


def test_time_columns_that_differ_are_not_one(tmp_path):
    rows = [f"{a};{c};{float(a) + 1e-4:.4f};{b}" for a, b, c in (row.split(",") for row in lines())]
    keys = 'columns = {t = "Name", x = "Angle", u = "Torque"}'
    with pytest.raises(InputError, match="more than one column `Name`, and they differ"):
        load(tmp_path, rows, keys=keys, header=BLOCK)


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_are_seconds_since_the_first(tmp_path, zone):
    start = np.datetime64("2023-05-04T23:59:59.800000")
    stamps = [str(start + np.timedelta64(1000 * k, "us")).replace("T", " ") + zone for k in range(N)]
    rows = [f"{stamp},{u:.6f},{x:.6f}" for stamp, u, x in zip(stamps, U, X, strict=True)]
    case = load(tmp_path, rows)
    assert case.recordings[0].sample_rate == 1000.0
    np.testing.assert_array_equal(case.recordings[0].x, X[:400])


def test_a_date_that_there_is_not_is_named(tmp_path):
    rows = [
        f"2023-05-04 10:00:{0.001 * k:06.3f},{u:.6f},{x:.6f}"
        for k, (u, x) in enumerate(zip(U, X, strict=True))
    ]
    rows[200] = rows[200].replace("2023-05", "2023-13")
    with pytest.raises(
        InputError, match=r"line 202, column `t`: \"2023-13-04 10:00:00.200\" is not a number"
    ):
        load(tmp_path, rows)


def test_an_empty_cell_outside_the_interval_does_no_harm(tmp_path):
    rows = lines()
    rows[-1] = rows[-1].rsplit(",", 1)[0] + ","
    np.testing.assert_array_equal(load(tmp_path, rows).recordings[1].x, X[400:599])


MAT = """[[recording]]
file = "data.mat"
sample_rate = 100.0
columns = {u = "u_train", x = "x_train"}
[[recording]]
file = "data.mat"
role = "holdout"
sample_rate = 100.0
columns = {u = "u_test", x = "x_test"}
"""


def test_other_variables_of_one_file_are_other_recordings(tmp_path):
    content = {"u_train": U, "x_train": X, "u_test": -U[:500], "x_test": -X[:500]}
    savemat(tmp_path / "data.mat", content)
    file = tmp_path / "case.toml"
    file.write_text(HEADER + MAT)
    assert [r.x.size for r in load_case(file).recordings] == [600, 500]
    file.write_text(HEADER + MAT.replace("x_test", "x_train"))
    with pytest.raises(InputError, match="the holdout shares samples"):
        load_case(file)
