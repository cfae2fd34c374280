"""Readers: every way of writing columns of numbers gives the same columns."""

import gzip
import time
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from frictionjax.core import InputError
from frictionjax.recordings import case_from_files
from frictionjax.recordings.readers import READERS, open_table, stem

ROWS = [(0.0, 1.5, -2e-6), (0.5, -1.5, 3.25e-6), (1.0, 0.0, 1e3)]
T, U, X = (np.array(column) for column in zip(*ROWS, strict=True))


def body(separator=",", end="\n"):
    return "".join(separator.join(repr(v) for v in row) + end for row in ROWS)


def read(path, names=("t", "u", "x")):
    return open_table(path).read(list(names))


def check(path, names=("t", "u", "x")):
    for got, expected in zip(read(path, names), (T, U, X), strict=True):
        np.testing.assert_array_equal(got, expected)


TEXTS = {
    "comma": "t,u,x\n" + body(),
    "comma and blank": "t, u, x\n" + body(", "),
    "semicolon": "t;u;x\n" + body(";"),
    "tab": "t\tu\tx\n" + body("\t"),
    "one blank": "t u x\n" + body(" "),
    "aligned blanks": "   t    u   x\n" + "".join("  " + line + " \n" for line in body("    ").splitlines()),
    "no header": body(),
    "no header, blanks": body(" "),
    "no newline at the end": ("t,u,x\n" + body()).rstrip("\n"),
    "carriage returns": "t,u,x\r\n" + body(end="\r\n"),
    "carriage returns only": "t,u,x\r" + body(end="\r"),
    "byte order mark": "\ufefft,u,x\n" + body(),
    "comment lines": "# rig 3\n% 2024-03-01\nt,u,x\n" + body().replace("\n", "\n# pause\n", 1) + "# end\n",
    "comment after numbers": "t,u,x\n" + body().replace("\n", " # first\n", 1),
    "blank lines": "\n\nt,u,x\n\n" + body().replace("\n", "\n\n") + "  \n\n",
    "blank line of blanks": "t,u,x\n" + body().replace("\n", "\n   \n", 1),
    "quoted header": '"t","u","x"\n' + body(),
    "quoted header between blanks": '"t" "u"  "x"\n' + body(" "),
    "quoted numbers": "t,u,x\n" + "".join(f'"{t}","{u}","{x}"\n' for t, u, x in ROWS),
    "line of units": "t,u,x\ns,V,rad\n" + body(),
    "preamble": "Logger 7\nt,u,x\n" + body(),
    "separator at the end": "t,u,x,\n" + body().replace("\n", ",\n"),
    "separator at the end of the numbers only": "t,u,x\n" + body().replace("\n", ",\n"),
    "header in a comment": "# t,u,x\n" + body(),
    "header in a comment, blanks": "# t u x\n" + body(" "),
    "header with another separator": "t, u, x\n" + body(" "),
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".csv.gz", ".txt.gz"])
def test_one_table_written_in_many_ways(tmp_path, name, suffix):
    path = tmp_path / f"run{suffix}"
    data = TEXTS[name].encode()
    path.write_bytes(gzip.compress(data) if suffix.endswith(".gz") else data)
    check(path)


def test_columns_are_found_by_the_exact_header(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("Time [s]\tVoltage, measured [V]\tPosition [µm]\n" + body("\t"), encoding="utf-8")
    check(path, ("Time [s]", "Voltage, measured [V]", "Position [µm]"))
    path.write_text("Time [s]  Voltage [V]  Position [um]\n" + body("  "))
    check(path, ("Time [s]", "Voltage [V]", "Position [um]"))
    path.write_text('"Time, s","Voltage [V]","Position"\n' + body())
    check(path, ("Time, s", "Voltage [V]", "Position"))


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_other_encodings(tmp_path, encoding):
    path = tmp_path / "run.csv"
    path.write_bytes(("t,u,Position [µm]\n" + body()).encode(encoding))
    check(path, ("t", "u", "Position [µm]"))


def test_columns_without_a_header_go_by_number(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("0,1,2,3\n4,5,6,7\n")
    table = open_table(path)
    assert table.names == ("1", "2", "3", "4")
    assert not table.has("x")
    np.testing.assert_array_equal(table.read(["3", "1"]), [[2.0, 6.0], [0.0, 4.0]])


def test_two_columns_without_a_header_are_u_and_x(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("1 2\n3 4\n")
    np.testing.assert_array_equal(
        open_table(path).read(["u", "x", "2"]), [[1.0, 3.0], [2.0, 4.0], [2.0, 4.0]]
    )
    assert not open_table(path).has("t")


def test_a_remark_of_three_words_is_no_header(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("# my test data\n" + body(" "))
    check(path)


def test_text_in_a_column_that_nobody_asks_for_does_no_harm(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,label,u,x,note\n" + "".join(f"{t},run,{u},{x},\n" for t, u, x in ROWS))
    check(path)
    with pytest.raises(InputError, match="line 2, column `label`"):
        read(path, ["label"])


def test_the_place_of_a_value_counts_comments_and_blank_lines(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("# rig\nt,u,x\n\n0,1,2\n% pause\n3,4,5\n")
    table = open_table(path)
    assert [table.place(k) for k in range(2)] == ["line 4", "line 6"]


def test_mat_vectors_structs_and_matrices(tmp_path):
    path = tmp_path / "run.mat"
    content = {
        "t": T,
        "run": {"u": U[:, None], "inner": {"x": X[None, :]}},
        "data": np.stack([T, U, X, X], axis=1)[:2],
        "wide": np.stack([T, U]),
        "fs": 2000.0,
        "name": "rig 3",
        "counts": np.array([1, 2, 3], dtype=np.int16),
    }
    savemat(path, content)
    check(path, ("t", "run.u", "run.inner.x"))
    table = open_table(path)
    np.testing.assert_array_equal(table.read(["counts"]), [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(table.read(["wide(2,:)"]), [U])
    assert not table.has("fs") and "1 value" in table.absence("fs")
    assert not table.has("name")
    assert table.place(6) == "sample 7"


def test_mat_struct_arrays_and_cells(tmp_path):
    path = tmp_path / "run.mat"
    runs = np.zeros((1, 2), dtype=[("x", object)])
    runs[0, 0]["x"], runs[0, 1]["x"] = T, X
    cell = np.empty((1, 2), dtype=object)
    cell[0, 0], cell[0, 1] = T, "text"
    savemat(path, {"run": runs, "cell": cell})
    table = open_table(path)
    np.testing.assert_array_equal(table.read(["run(2).x"]), [X])
    assert "cell array" in table.absence("cell")


def test_stems_and_suffixes(tmp_path):
    assert stem(tmp_path / "run.csv.gz") == "run"
    assert stem(tmp_path / "RUN.2.CSV") == "RUN.2"
    for suffix in (".pdf", ".png", ""):
        path = tmp_path / f"run{suffix}"
        path.write_bytes(b"a text\n")
        with pytest.raises(InputError) as error:
            open_table(path)
        plain = [known for known in READERS if not known.endswith((".gz", ".zip"))]
        assert all(known in str(error.value) for known in plain)


VALUES = st.floats(min_value=-1e99, max_value=1e99, allow_nan=False, allow_infinity=False)


@settings(
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    rows=st.lists(st.tuples(VALUES, VALUES, VALUES), min_size=2, max_size=40),
    separator=st.sampled_from([",", ";", "\t", " ", ", "]),
    end=st.sampled_from(["\n", "\r\n"]),
    header=st.booleans(),
)
def test_any_numbers_survive_the_round_trip(tmp_path, rows, separator, end, header):
    path = tmp_path / "run.csv"
    lines = [separator.join("tux")] * header + [separator.join(repr(v) for v in row) for row in rows]
    path.write_bytes(end.join(lines).encode())
    np.testing.assert_array_equal(np.transpose(read(path)), rows)


@settings(
    max_examples=150,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    data=st.one_of(
        st.binary(max_size=300),
        st.text(max_size=300).map(str.encode),
        st.text(alphabet='0123456789.,;\t -+eEnaif\n\r"#%tux', max_size=300).map(str.encode),
        st.lists(
            st.sampled_from(["t,u,x", "1,2,3", "1;2;3", "0", "nan,1,2", '"', "a,b", "1e999,0,0"]),
            max_size=250,
        )
        .map("\n".join)
        .map(str.encode),
    ),
    suffix=st.sampled_from([".csv", ".txt", ".csv.gz", ".mat"]),
    packed=st.booleans(),
)
def test_garbage_is_an_input_error_or_a_recording(tmp_path, data, suffix, packed):
    path, good = tmp_path / f"run{suffix}", tmp_path / "good.csv"
    path.write_bytes(gzip.compress(data) if packed else data)
    good.write_text("t,u,x\n" + "".join(f"{k / 100},{k % 7},{k}\n" for k in range(120)))
    try:
        with warnings.catch_warnings(action="ignore"):
            case_from_files(path, good, sample_rate=None)
    except InputError as error:
        assert len(str(error).splitlines()) == 1


@pytest.mark.slow
def test_a_long_file_is_read_in_a_couple_of_seconds(tmp_path):
    path = tmp_path / "run.csv"
    row = np.char.mod("%.9g", np.random.default_rng(0).normal(size=(1000, 3)))
    path.write_text("t,u,x\n" + "".join(",".join(values) + "\n" for values in row) * 600)
    begin = time.process_time()
    read(path)
    assert time.process_time() - begin < 4.0
