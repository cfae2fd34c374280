"""Stamps without a unit: in s where a log can be that slow, else in parts of a second, or a question."""

import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files
from frictionjax.recordings.clock import SLOWEST_LOG, seconds

N = 400


def _stamps(step):
    return step * np.arange(N) + 7.0 * step


@pytest.mark.parametrize("rate", [SLOWEST_LOG, 10.0, 1000.0])
def test_a_log_that_can_be_in_s_is(rate):
    stamps = _stamps(1.0 / rate)
    read, said = seconds(stamps, "t")
    assert read is stamps and not said


@pytest.mark.parametrize(
    ("step", "unit", "rate"), [(0.5, "ms", 2000), (4.0, "ms", 250), (1000.0, "us", 1000), (2e6, "ns", 500)]
)
def test_a_slow_log_with_one_reading_is_read_so_and_says_it(step, unit, rate):
    read, said = seconds(_stamps(step), "t")
    assert 1.0 / np.median(np.diff(read)) == pytest.approx(rate)
    assert f"read as {unit}" in said and "--unit t=s" in said


@pytest.mark.parametrize(
    ("step", "options"),
    [
        (1.0, ["`--unit t=ms` for 1000 Hz", "`--sample-rate HZ` where it counts samples", "`--unit t=s`"]),
        (20.0, ["`--unit t=ms` for 50 Hz", "`--unit t=us` for 50000 Hz", "`--unit t=s`"]),
    ],
)
def test_a_slow_log_with_several_readings_is_asked_about(step, options):
    with pytest.raises(InputError) as caught:
        seconds(_stamps(step), "t", file="run.csv")
    assert str(caught.value).startswith("run.csv: `t` has no unit")
    assert all(option in str(caught.value) for option in options)
    assert ("counts samples" in str(caught.value)) == (step == 1.0)


@pytest.mark.parametrize(
    ("step", "rate", "said"), [(1.0, 2000.0, "counts samples"), (20.0, 50.0, "read as ms")]
)
def test_a_sample_rate_answers(step, rate, said):
    read, sentence = seconds(_stamps(step), "t", rate)
    assert 1.0 / np.median(np.diff(read)) == pytest.approx(rate) and said in sentence


def test_stamps_that_suit_no_unit_are_left_as_they_are():
    stamps = _stamps(1e12)
    assert seconds(stamps, "t") == (stamps, "")


def test_a_sample_rate_that_fits_no_unit_leaves_the_stamps():
    stamps = _stamps(20.0)
    assert seconds(stamps, "t", 777.0) == (stamps, "")


@pytest.mark.parametrize("given", [{"units": {"t": "ms"}}, {"sample_rate": 1000.0}])
def test_each_answer_reads_the_file(tmp_path, given):
    file = tmp_path / "run.csv"
    t = np.arange(N)
    np.savetxt(
        file,
        np.column_stack([t, np.sin(0.1 * t), np.sin(0.1 * t - 0.4)]),
        delimiter=",",
        header="t,u,x",
        comments="",
    )
    with pytest.raises(InputError, match="--unit t=ms"):
        case_from_files([file])
    with pytest.warns(FrictionjaxWarning):
        case = case_from_files([file], **given)
    assert {one.sample_rate for one in case.recordings} == {1000.0}
