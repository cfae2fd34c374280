"""Every mistake of a user ends in one line that names the file, the place and the cure."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files, load_case

N = 200
RATE = 1000.0
HEADER = 'name = "bad"\n'
FIT = '[[recording]]\nfile = "run.csv"\n'
HOLDOUT = '[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'


def columns():
    """Time (s), input and position of a small motion, each of shape `(N,)`."""
    t = np.arange(N) / RATE
    return t, np.cos(40.0 * t), np.round(0.01 * np.sin(40.0 * t), 9)


def lines():
    return ["t,u,x", *(f"{t:.3f},{u:.9g},{x:.9g}" for t, u, x in zip(*columns(), strict=True))]


def write(folder: Path, name="run.csv", change=None, rows=None):
    rows = lines() if rows is None else rows
    if change:
        rows = change(rows) or rows
    (folder / name).write_text("\n".join(rows) + "\n")


def toml(folder: Path, text=HEADER + FIT + HOLDOUT, change=None, **files):
    """A case of two recordings; `change` spoils the rows of run.csv."""
    write(folder, change=change)
    write(folder, "kept.csv", rows=[lines()[0], *(row + "1" for row in lines()[1:])])
    (folder / "case.toml").write_text(text)
    return lambda: load_case(folder / "case.toml")


def spoiled(k: int, old: str | None = None, new: str = ""):
    """Rows with one field changed: the row of line `k`, `old` counted as the last field when None."""

    def change(rows):
        row = rows[k - 1]
        rows[k - 1] = row.rsplit(",", 1)[0] + "," + new if old is None else row.replace(old, new, 1)

    return lambda folder: toml(folder, change=change)


def plant(text: str):
    return lambda folder: toml(folder, HEADER + f"[plant]\n{text}\n" + FIT + HOLDOUT)


def recording(text: str, change=None):
    return lambda folder: toml(folder, HEADER + FIT + text + "\n" + HOLDOUT, change=change)


def case(text: str):
    return lambda folder: toml(folder, text)


def rows(change):
    return lambda folder: toml(folder, change=change)


def raw(name: str, data: bytes):
    """A case whose first recording is a file of these bytes."""

    def make(folder):
        call = toml(folder, HEADER + FIT.replace("run.csv", name) + HOLDOUT)
        (folder / name).write_bytes(data)
        return call

    return make


def mat(text: str = "", **content):
    """A case whose first recording is a MATLAB file."""

    def make(folder):
        call = toml(folder, HEADER + FIT.replace("run.csv", "run.mat") + text + "\n" + HOLDOUT)
        t, u, x = columns()
        savemat(folder / "run.mat", {"t": t, "u": u, "x": x} | content)
        return call

    return make


def bare(*args, **options):
    """`case_from_files` on files that are there."""

    def make(folder):
        toml(folder)
        names = [[folder / name for name in names] for names in args]
        return lambda: case_from_files(*names, **options)

    return make


def cell():
    array = np.empty((1, 2), dtype=object)
    array[0, 0], array[0, 1] = np.arange(3.0), "text"
    return array


def dropped_t(rows):
    return [row.split(",", 1)[1] for row in rows]


# Name: how to make it, and words that the message must hold.
BAD = {
    # the case file
    "case file missing": (
        lambda folder: toml(folder) and (lambda: load_case(folder / "cas.toml")),
        ["cas.toml", "does not exist", 'Did you mean "case.toml"?'],
    ),
    "case file in no folder": (
        lambda f: lambda: load_case(f / "no" / "case.toml"),
        ["There is no folder", "no"],
    ),
    "case file is a folder": (
        lambda f: toml(f) and (lambda: load_case(f)),
        ["is a folder", "Name case.toml"],
    ),
    "not TOML": (case("name = \n"), ["case.toml, line 1", "not valid TOML", "key = value"]),
    "TOML cut short": (case('name = "bad'), ["case.toml", "not valid TOML"]),
    "unquoted text": (case("name = arm\n" + FIT + HOLDOUT), ["case.toml, line 1", "quotes"]),
    "deep nesting": (case("name = " + "[" * 5000), ["case.toml", "TOML"]),
    "unknown key of the case": (
        case('nmae = "bad"\n' + FIT + HOLDOUT),
        ["key `nmae`", "unknown key", "Did you mean `name`?", "Allowed here: name, plant, recording"],
    ),
    "name of a wrong type": (
        case("name = 3\n" + FIT + HOLDOUT),
        ["key `name`", "text is needed, not a number"],
    ),
    "plant is no table": (case("plant = 3\n" + FIT + HOLDOUT), ["key `plant`", "Write [plant]"]),
    "single brackets": (case(HEADER + FIT.replace("[[", "[").replace("]]", "]")), ["[[recording]]"]),
    "no recording": (case(HEADER), ["no recording to fit", 'role = "fit"']),
    "no fit recording": (case(HEADER + HOLDOUT), ["case.toml", "no recording to fit"]),
    "no holdout recording": (
        case(HEADER + FIT),
        ["case.toml", "kept aside", "never seen", 'at least one recording with role = "holdout"'],
    ),
    # the plant
    "unknown key of the plant": (
        plant("motor_constnat = 2.0"),
        ["[plant]", "motor_constnat", "Did you mean `motor_constant`?", "encoder_step"],
    ),
    "motor constant zero": (plant("motor_constant = 0"), ["[plant], key `motor_constant`", "Leave it out"]),
    "motor constant negative": (plant("motor_constant = -2"), ["key `motor_constant`", "scale = {u = -1.0}"]),
    "motor constant nan": (plant("motor_constant = nan"), ["key `motor_constant`", "not a finite number"]),
    "motor constant huge": (plant("motor_constant = 1" + "0" * 400), ["key `motor_constant`", "finite"]),
    "motor constant in quotes": (
        plant('motor_constant = "2"'),
        ["key `motor_constant`", "not text", "quotes"],
    ),
    "motor constant true": (plant("motor_constant = true"), ["key `motor_constant`", "not true or false"]),
    "encoder step zero": (plant("encoder_step = 0.0"), ["key `encoder_step`", "Leave it out"]),
    "inertia negative": (plant("inertia = -1.0"), ["key `inertia`", "not above zero"]),
    "unit of a wrong type": (plant("force_unit = 1"), ["key `force_unit`", "text is needed"]),
    # the keys of a recording
    "unknown key of a recording": (
        recording("samplerate = 1000.0"),
        ['recording 1 ("run.csv")', "`samplerate`", "Did you mean `sample_rate`?", "interval"],
    ),
    "no file": (
        case(HEADER + '[[recording]]\nrole = "fit"\n' + HOLDOUT),
        ["recording 1, key `file`", "no file"],
    ),
    "file of a wrong type": (
        case(HEADER + "[[recording]]\nfile = 3\n"),
        ["recording 1, key `file`", "quotes"],
    ),
    "file empty": (case(HEADER + '[[recording]]\nfile = ""\n'), ["key `file`", "empty"]),
    "wrong role": (recording('role = "test"'), ["key `role`", '"test"', '"fit" or "holdout"']),
    "wrong loop": (recording('loop = "half"'), ["key `loop`", '"open" or "closed"']),
    "wrong drive": (recording('drive = "velocity"'), ["key `drive`", '"force" or "motion"']),
    "start time a date": (recording("start_time = 2024-03-01"), ["key `start_time`", "not a date or time"]),
    "sample rate zero": (recording("sample_rate = 0"), ["key `sample_rate`", "not above zero"]),
    "sample rate contradicts time": (
        recording("sample_rate = 2000.0"),
        ["run.csv", "1000 Hz", "2000 Hz", "Remove sample_rate", "scale = {t = 1e-3}"],
    ),
    "columns are no table": (recording('columns = "x"'), ["key `columns`", "columns = {x ="]),
    "unknown role of a column": (
        recording('columns = {pos = "x"}'),
        ["key `columns.pos`", "unknown key", "normal_force"],
    ),
    "column of a wrong type": (recording("columns = {x = 3}"), ["key `columns.x`", "text is needed"]),
    "column not in the file": (
        recording('columns = {x = "X"}'),
        ["run.csv", "columns.x", "no column `X`", "Did you mean `x`?", "the file has: t, u, x"],
    ),
    "u for an imposed motion": (
        recording('drive = "motion"\ncolumns = {u = "u", force = "u"}'),
        ["columns.u", "there is no input"],
    ),
    "imposed motion without force": (
        recording('drive = "motion"'),
        ["run.csv", "force", "the file has: t, u, x"],
    ),
    "scale of an unknown column": (recording("scale = {y = 2.0}"), ["key `scale.y`", "unknown key"]),
    "scale of an absent column": (recording("scale = {v = 2.0}"), ["key `scale.v`", "no column", "t, u, x"]),
    "scale zero": (recording("scale = {x = 0.0}"), ["key `scale.x`", "zero"]),
    "scale in quotes": (recording('scale = {x = "mm"}'), ["key `scale.x`", "a number is needed"]),
    "interval reversed": (recording("interval = [0.2, 0.1]"), ["key `interval`", "ends before it begins"]),
    "interval outside": (
        recording("interval = [0.0, 9.0]"),
        ["run.csv", "key `interval`", "outside", "0.199 s"],
    ),
    "interval before the file": (recording("interval = [-9.0, -8.0]"), ["key `interval`", "outside"]),
    "interval of one time": (recording("interval = [0.1]"), ["key `interval`", "two times"]),
    "interval of text": (recording('interval = ["a", "b"]'), ["key `interval`", "two times"]),
    "interval too short": (recording("interval = [0.0, 0.05]"), ["run.csv", "50 samples", "at least 100"]),
    "holdout shares samples": (
        case(HEADER + FIT + FIT + 'role = "holdout"\n'),
        ["recording 2", "shares samples", "do not overlap"],
    ),
    "intervals overlap": (
        case(HEADER + FIT + "interval = [0.0, 0.12]\n" + FIT + 'interval = [0.1, 0.2]\nrole = "holdout"\n'),
        ["recording 2", "key `interval`", "shares samples"],
    ),
    "holdout is a copy": (
        lambda folder: (
            (toml(folder) and write(folder, "kept.csv")) or (lambda: load_case(folder / "case.toml"))
        ),
        ["recording 2", '"kept"', "same positions", '"run"'],
    ),
    # the files
    "file missing": (
        case(HEADER + FIT.replace("run", "runn") + HOLDOUT),
        ["case.toml, recording 1, key `file`", "runn.csv", "does not exist", 'Did you mean "run.csv"?'],
    ),
    "file name impossible": (
        case(HEADER + FIT.replace("run", "r" * 3000) + HOLDOUT),
        ["case.toml", "recording 1", "does not exist"],
    ),
    "file is a folder": (
        case(HEADER + FIT.replace("run.csv", ".") + HOLDOUT),
        ["recording 1", "is a folder"],
    ),
    "unknown suffix": (raw("run.xlsx", b"PK"), ["run.xlsx", '".xlsx"', ".csv, .csv.gz, .txt, .txt.gz, .mat"]),
    "empty file": (raw("run.csv", b""), ["run.csv", "the file is empty"]),
    "header only": (raw("run.csv", b"t,u,x\n"), ["run.csv", "no line of numbers"]),
    "binary file": (raw("run.csv", b"\x00\x01\x02" * 50), ["run.csv", "binary"]),
    "gzip cut short": (raw("run.csv.gz", b"\x1f\x8b\x08\x00abc"), ["run.csv.gz", "gzip", "damaged"]),
    "header too short": (
        raw("run.csv", b"t,u\n" + b"0,1,2\n" * 9),
        ["run.csv, line 1", '"t,u"', "3 columns"],
    ),
    "two samples": (raw("run.csv", b"t,u,x\n0,1,2\n1,1,3\n"), ["run.csv", "2 samples", "at least 100"]),
    "text in a column": (
        spoiled(57, None, "abc"),
        ["run.csv, line 57, column `x`", '"abc" is not a number', "Correct the value"],
    ),
    "empty value": (spoiled(57, None, ""), ["run.csv, line 57, column `x`", "the value is empty"]),
    "not available": (spoiled(2, None, "N/A"), ["run.csv, line 2, column `x`", '"N/A"']),
    "decimal comma": (
        lambda f: toml(f, change=lambda rows: [row.replace(",", ";").replace(".", ",") for row in rows]),
        ["run.csv, line 2, column `t`", "decimal points, not commas", '"0.000"'],
    ),
    "line cut short": (
        rows(lambda rows: [*rows[:150], "0.149"]),
        ["run.csv, line 151", "1 value where", "3 columns"],
    ),
    "NaN": (spoiled(57, None, "nan"), ["run.csv, line 57, column `x`", "NaN", "Delete such lines"]),
    "infinite": (spoiled(57, None, "-inf"), ["run.csv, line 57, column `x`", "infinite"]),
    "NaN in the input": (
        rows(
            lambda rows: [
                row.replace(row.split(",")[1], "nan") if k > 9 else row for k, row in enumerate(rows)
            ]
        ),
        ["run.csv, line 11, column `u`", "NaN (and 190 more like it)"],
    ),
    "NaN in time": (spoiled(57, "0.055", "nan"), ["run.csv, line 57, column `t`", "NaN"]),
    "beyond measure": (spoiled(57, None, "1e200"), ["run.csv, line 57, column `x`", "beyond"]),
    "time goes backwards": (
        spoiled(57, "0.055", "0.020"),
        ["run.csv, line 57, column `t`", "goes backwards", "0.054 s, then 0.02 s"],
    ),
    "time stands still": (
        spoiled(57, "0.055", "0.054"),
        ["line 57, column `t`", "stands still", "sample_rate"],
    ),
    "time not uniform": (
        rows(
            lambda rows: [f"{1.1**k:.9g},{row.split(',', 1)[1]}" if k else row for k, row in enumerate(rows)]
        ),
        ["run.csv, column `t`", "not a uniformly sampled"],
    ),
    "no time column": (rows(dropped_t), ["run.csv", "no time column", "Add sample_rate = 2000.0"]),
    "no column x": (
        spoiled(1, "x", "position"),
        ["run.csv", "no column `x`", 'columns = {x = "..."}', "t, u, position"],
    ),
    "no header": (
        rows(lambda rows: [row + ",0" for row in rows[1:]]),
        ["run.csv", "no header was found", "1, 2, 3, 4"],
    ),
    "a name twice": (spoiled(1, "t,u,x", "t,x,x"), ["run.csv", "`x` stands over more than one column"]),
    "x constant": (
        rows(lambda rows: [row.rsplit(",", 1)[0] + ",0.5" if k else row for k, row in enumerate(rows)]),
        ["run.csv", "x is constant (0.5)", "Check the sensor"],
    ),
    "u all zero": (
        rows(
            lambda rows: [
                f"{row.split(',')[0]},0,{row.split(',')[2]}" if k else row for k, row in enumerate(rows)
            ]
        ),
        ["run.csv", "u is zero throughout", 'drive = "motion"'],
    ),
    "force constant": (
        recording(
            'drive = "motion"\ncolumns = {force = "u"}',
            lambda rows: [
                f"{row.split(',')[0]},1,{row.split(',')[2]}" if k else row for k, row in enumerate(rows)
            ],
        ),
        ["run.csv", "force is constant (1)"],
    ),
    # MATLAB files
    "different lengths": (
        mat(u=np.ones(150)),
        ["run.mat", "`u` (u) has 150 samples", "`x` (x) has 200"],
    ),
    "time of another length": (mat(t=np.arange(150.0)), ["run.mat", "`t` (t) has 150", "has 200"]),
    "no variable": (
        mat('columns = {x = "theta"}'),
        ["run.mat", "no variable `theta`", "the file has: t, u, x"],
    ),
    "cell array": (mat(x=cell()), ["run.mat", "`x` is a cell array", "cell2mat"]),
    "complex numbers": (mat(x=np.full(N, 1j)), ["run.mat", "`x` holds text or complex numbers"]),
    "matrix": (mat(x=np.ones((N, 2))), ["run.mat", "matrix of 200 by 2", "`x(:,1)`"]),
    "NaN in a vector": (
        mat(x=np.where(np.arange(N) == 41, np.nan, 1.0)),
        ["run.mat, sample 42, column `x`", "NaN"],
    ),
    "MATLAB v7.3": (
        raw("run.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n"),
        ["run.mat", "v7.3", "not read yet", "-v7"],
    ),
    "not a MATLAB file": (
        raw("run.mat", b"MATLAB 5.0 MAT-file".ljust(200, b"x")),
        ["run.mat", "is not a MATLAB"],
    ),
    "MATLAB file of text": (
        lambda folder: (
            toml(folder, HEADER + FIT.replace("run.csv", "run.mat") + HOLDOUT)
            if not savemat(folder / "run.mat", {"name": "rig"})
            else None
        ),
        ["run.mat", "no numeric vector"],
    ),
    # bare files
    "bare: no files": (bare([], ["kept.csv"]), ["no recording to fit"]),
    "bare: no holdout": (bare(["run.csv"], []), ["kept aside", "at least one file as holdout"]),
    "bare: motor constant zero": (bare(["run.csv"], ["kept.csv"], motor_constant=0.0), ["motor_constant"]),
    "bare: file missing": (bare(["rum.csv"], ["kept.csv"]), ["rum.csv", 'Did you mean "run.csv"?']),
    "bare: holdout is a fit file": (bare(["run.csv"], ["run.csv"]), ["shares samples"]),
    "bare: wrong loop": (bare(["run.csv"], ["kept.csv"], loop="shut"), ["key `loop`", '"open" or "closed"']),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_in_one_line(tmp_path, name):
    make, words = BAD[name]
    call = make(tmp_path)
    with pytest.raises(InputError) as error:
        call()
    message = str(error.value)
    assert len(message.splitlines()) == 1, message
    assert len(message) < 900, message
    assert message.endswith((".", "?")), message
    for word in words:
        assert word in message, f"{word!r} is not in: {message}"


def test_the_good_case_behind_the_bad_ones(tmp_path):
    case = toml(tmp_path)()
    assert [r.name for r in case.recordings] == ["run", "kept"]


def test_a_gap_is_filled_with_a_warning_that_names_the_file(tmp_path):
    with pytest.warns(FrictionjaxWarning, match=r"run\.csv: .* 1 gap"):
        toml(tmp_path, change=lambda rows: rows[:50] + rows[55:])()
