"""Every fault of a measured file ends in one line that names the file, the line or column, and the cure."""

from importlib.util import find_spec

import numpy as np
import pytest
from helpers_recordings import (
    FIT,
    HEADER,
    HOLDOUT,
    N,
    case,
    cell,
    check_message,
    dropped_t,
    mat,
    raw,
    recording,
    rows,
    spoiled,
    toml,
)
from scipy.io import savemat

# Name: how to make it, and words that the message must hold.
BAD = {
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
    "unknown suffix": (raw("run.pdf", b"PK"), ["run.pdf", '".pdf"', ".csv, .tsv, .txt", ".xlsx", ".parquet"]),
    "zip cut short": (raw("run.zip", b"PK\x03\x04abc"), ["run.zip", "zip file is damaged"]),
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
    "empty value": (spoiled(57, None, ""), ["run.csv, line 57, column `x`", "the value is missing or NaN"]),
    "not available": (spoiled(2, None, "N/A"), ["run.csv, line 2, column `x`", '"N/A"']),
    "decimal comma": (
        rows(
            lambda rows: [
                row.replace(",", ";").replace(*((".", ",") if k == 57 else ("", "")))
                for k, row in enumerate(rows)
            ]
        ),
        ["run.csv, line 58, column `t`", "decimal points, not commas", '"0.056"'],
    ),
    "line cut short": (
        rows(lambda rows: [*rows[:150], "0.149"]),
        ["run.csv, line 151", "1 value where", "3 columns"],
    ),
    "NaN": (spoiled(57, None, "nan"), ["run.csv, line 57, column `x`", "NaN", "delete the line"]),
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
    "no time column": (
        rows(dropped_t),
        [
            "run.csv",
            "no time column",
            "Add sample_rate = 2000.0",
            'columns = {t = "FILL_IN", u = "u", x = "x"}',
        ],
    ),
    "no column x": (
        spoiled(1, "x", "thing"),
        ["run.csv", "no column `x`", 'columns = {t = "t", u = "u", x = "thing"}'],
    ),
    "no header": (
        rows(lambda rows: [row + ",0" for row in rows[1:]]),
        ["run.csv", "no header was found", "1, 2, 3, 4"],
    ),
    "a name twice": (spoiled(1, "t,u,x", "t,x,x"), ["run.csv", "more than one column `x`"]),
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
        ["run.mat", "no variable `theta`", 'columns = {t = "t", u = "u", x = "x"}'],
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
        ["run.mat", "h5py" if find_spec("h5py") is None else "is not an HDF5 file that can be read"],
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
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_reported_in_one_line(tmp_path, name):
    make, words = BAD[name]
    check_message(make(tmp_path), words)
