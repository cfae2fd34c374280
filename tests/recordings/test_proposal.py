"""Columns that are not recognised: the error has one complete option to copy, with a guess for each role."""

import re
import shlex
import warnings

import numpy as np
import pytest

from frictionjax.cli.commands import program
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files, load_case

N = 400
T = np.arange(N) / 500.0
VALUES = (T, np.cos(9.0 * T), 0.01 * np.sin(7.0 * T), np.sin(T))


def load(folder, header, **options):
    """The case of a file with this header, columns between semicolons."""
    width = header.count(";") + 1
    rows = (";".join(f"{value:.9g}" for value in row) for row in zip(*VALUES[:width], strict=True))
    (folder / "run.csv").write_text("\n".join([header, *rows]) + "\n")
    with warnings.catch_warnings(action="ignore", category=FrictionjaxWarning):
        return case_from_files(folder / "run.csv", **options)


def said(folder, header, **options):
    """The option in the error, and what follows it."""
    with pytest.raises(InputError) as error:
        load(folder, header, **options)
    found = re.search(r"--columns .*?(?=[,;] |\.$)", str(error.value))
    assert found is not None, error.value
    return found[0], str(error.value)[found.end() :].strip(",;. ")


@pytest.mark.parametrize(
    ("header", "option", "rest"),
    [
        # by the whole name, by what is left, by a word of the name, by the unit
        ("Zeit;Strom;Kanal 3", '--columns t=Zeit u=Strom x="Kanal 3"', ""),
        (
            "Time;motor current filt;joint angle raw;target angle",
            '--columns t=Time u="motor current filt" x="joint angle raw"',
            "other columns: target angle",
        ),
        (
            "tick [ms];M1 [mA];enc [deg];M2",
            '--columns t="tick [ms]" u="M1 [mA]" x="enc [deg]"',
            "other columns: M2",
        ),
        # names that a shell would change go by their number
        ("Zeit;motor current $1;pos raw;M2", '--columns t=Zeit u=2 x="pos raw"', "other columns: M2"),
        ("Zeit;A;B", "--columns t=Zeit u=FILL_IN x=FILL_IN", "with one of these for FILL_IN: A, B"),
        (
            "A;B;C;D",
            "--columns t=FILL_IN u=FILL_IN x=FILL_IN",
            "with one of these for FILL_IN: A, B, C, D",
        ),
    ],
)
def test_the_error_has_one_option_for_all_roles(tmp_path, header, option, rest):
    assert said(tmp_path, header) == (option, rest)


def test_the_option_can_be_copied(tmp_path):
    header = "Zeit;motor current filt [A];enc 7 [deg];M2"
    option, _ = said(tmp_path, header)
    _, bound, _ = program().parse_args(["check", "run.csv", *shlex.split(option)])
    columns = dict(bound.arguments["source"].columns)
    assert columns == {"t": "Zeit", "u": "motor current filt [A]", "x": "enc 7 [deg]"}
    case = load(tmp_path, header, columns=columns)
    np.testing.assert_allclose(case.recordings[0].u, VALUES[1][: case.recordings[0].u.size], rtol=1e-8)


def test_what_is_given_stays_and_what_is_not_needed_is_left_out(tmp_path):
    option, rest = said(tmp_path, "A;B;C", columns={"x": "C"}, sample_rate=500.0)
    assert (option, rest) == ("--columns u=FILL_IN x=C", "with one of these for FILL_IN: A, B")
    option, _ = said(tmp_path, "A [s];B;x", drive="motion")
    assert option == '--columns t="A [s]" x=x force=B'


def test_a_case_file_gets_a_line_of_its_own_language(tmp_path):
    with pytest.raises(InputError):
        load(tmp_path, "Zeit;Strom;A;B")
    (tmp_path / "case.toml").write_text('[[recording]]\nfile = "run.csv"\n')
    with pytest.raises(
        InputError, match=r'columns = \{t = "Zeit", u = "Strom", x = "FILL_IN"\}, with one of'
    ):
        load_case(tmp_path / "case.toml")
