"""The fast way through text files: the same numbers as the careful one, or none."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.recordings.readers import fast, open_table

pytest.importorskip("polars")

VALUES = st.floats(allow_nan=False, allow_infinity=False, width=64)


def numbers(text, columns=(0, 1, 2), width=3, separator=",", start=0, **options):
    return fast.numbers_of(text.encode(), columns, width, separator, start, least=0, **options)


@settings(max_examples=40, derandomize=True)
@given(st.lists(st.tuples(VALUES, VALUES, VALUES), min_size=1, max_size=20), st.sampled_from(["\n", "\r\n"]))
def test_every_number_is_read_to_the_last_bit(rows, end):
    text = end.join(",".join(repr(v) for v in row) for row in rows)
    np.testing.assert_array_equal(np.transpose(numbers(text)), rows)


def test_columns_that_are_not_asked_for_may_hold_text():
    np.testing.assert_array_equal(
        numbers("t,x,note\n0,1,a\n2,3,b\n", columns=(1, 0), start=1), [[1, 3], [0, 2]]
    )


def test_decimal_commas_and_empty_fields():
    assert numbers("0,5;1;2\n1,5;3;4\n", separator=";", decimal_comma=True)[0].tolist() == [0.5, 1.5]
    np.testing.assert_array_equal(numbers("0,,2\n1,3,4\n")[1], [np.nan, 3.0])


@pytest.mark.parametrize(
    "text",
    [
        "0,1,2\n# pause\n3,4,5\n",
        "0,1,2 % first\n3,4,5\n",
        "#0,1,2\n3,4,5\n",
        '"0","1","2"\n3,4,5\n',
        "0,1,2\n3,4\n",
        "0,1,2\n3,4,5,6\n",
        "0,1,2\n3,4\n5,6,7,8\n",
        "0,1,2,\n3,4,5,\n",
        "0,1,2\nstop,4,5\n",
        "0,1,2\r3,4,5\r",
    ],
)
def test_what_needs_care_is_left_to_the_careful_reader(text):
    assert numbers(text) is None


def test_the_reader_takes_the_fast_way_for_long_files_only(tmp_path, monkeypatch):
    rows = "".join(f"{k},{k % 7},{k % 5}\n" for k in range(300))
    (tmp_path / "run.csv").write_text("t,u,x\n" + rows)
    monkeypatch.setattr(
        fast, "optional", lambda name: pytest.fail("a short file does not wait for a library")
    )
    slow = open_table(tmp_path / "run.csv").read(["t", "u", "x"])
    monkeypatch.undo()
    monkeypatch.setattr(
        "frictionjax.recordings.readers.text.numbers_of", functools.partial(fast.numbers_of, least=0)
    )
    monkeypatch.setattr("numpy.loadtxt", lambda *_, **__: pytest.fail("the fast way was not taken"))
    np.testing.assert_array_equal(open_table(tmp_path / "run.csv").read(["t", "u", "x"]), slow)
    # Without the library the file is read all the same.
    monkeypatch.undo()
    monkeypatch.setattr(fast, "optional", lambda name: None)
    np.testing.assert_array_equal(open_table(tmp_path / "run.csv").read(["t", "u", "x"]), slow)
