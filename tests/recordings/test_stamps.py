"""Dates and times of day as loggers write them."""

from datetime import datetime, timedelta

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings.readers import open_table
from frictionjax.recordings.readers.stamps import is_stamp, seconds_between

N, RATE = 300, 250.0
FORMS = {
    "ISO": "%Y-%m-%dT%H:%M:%S.%f",
    "with a blank": "%Y-%m-%d %H:%M:%S.%f",
    "German": "%d.%m.%Y %H:%M:%S.%f",
    "day first": "%d/%m/%Y %H:%M:%S.%f",
    "month first": "%m/%d/%Y %I:%M:%S.%f %p",
    "year first": "%Y/%m/%d %H:%M:%S.%f",
    "time of day": "%H:%M:%S.%f",
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "start", [datetime(2024, 3, 1, 11, 59, 59), datetime(2024, 2, 3, 23, 59, 59, 400_000)]
)
def test_each_form_counts_seconds_over_noon_and_midnight(tmp_path, form, start):
    file = tmp_path / "run.csv"
    stamps = [(start + timedelta(seconds=k / RATE)).strftime(FORMS[form]) for k in range(N)]
    file.write_text("t;x\n" + "".join(f"{one};{k}.5\n" for k, one in enumerate(stamps)))
    t, x = open_table(file).read(["t", "x"])
    np.testing.assert_allclose(t, np.arange(N) / RATE, atol=2e-6)
    np.testing.assert_array_equal(x, np.arange(N) + 0.5)


@pytest.mark.parametrize(
    ("first", "second", "seconds"),
    [
        ("2024-03-01T12:00:00+01:00", "2024-03-01T12:00:00Z", 3600.0),
        ("01.03.24 12:00:00,25", "01.03.24 12:00:01,5", 1.25),
        ("03/01/2024 12:00:00 AM", "03/01/2024 1:00:00 PM", 46_800.0),
        ("31/01/2024 23:00:00", "01/02/2024 00:00:00", 3600.0),
        ("01/31/2024 23:00:00", "02/01/2024 00:00:00", 3600.0),
        ("03/01/2024, 10:00:00", "03/02/2024, 10:00:00", 86_400.0),
        ("23:59:59.9", "0:00:00.1", 0.2),
    ],
)
def test_time_between_two_stamps(first, second, seconds):
    assert is_stamp(first) and is_stamp(second)
    assert seconds_between(first, second) == pytest.approx(seconds, abs=1e-9)


@pytest.mark.parametrize("field", ["12:00", "1.2.3", "2024-03-01", "03/01/2024", "12:00:00x", "١٢:00:00", ""])
def test_other_text_is_no_stamp(field):
    assert not is_stamp(field)


@pytest.mark.parametrize("second", ["2024-13-01T12:00:00", "32.01.2024 12:00:00", "12:00:00", "25:00:00"])
def test_what_does_not_exist_or_has_another_form_is_refused_with_its_line(tmp_path, second):
    with pytest.raises(ValueError, match="no date that exists"):
        seconds_between("2024-03-01T12:00:00", second)
    file = tmp_path / "run.csv"
    file.write_text(f"t,x\n2024-03-01T12:00:00,1\n2024-03-01T12:00:01,2\n{second},3\n")
    with pytest.raises(InputError, match=r"line 4, column `t`"):
        open_table(file).read(["t"])
