"""Every format gives the same columns, says what it cannot read, and which library reads it."""

import datetime
import gzip
import json
import pickle
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files
from frictionjax.recordings.clock import on_one_clock
from frictionjax.recordings.readers import READERS, extra, open_table
from frictionjax.recordings.readers.arrays import ArrayTable

N = 400
T = np.arange(N) / 500.0
U, X = np.cos(40.0 * T), 0.01 * np.sin(31.0 * T)
COLUMNS = {"t": T, "u": U, "x": X}
TEXT = "t,u,x\n" + "".join(
    f"{t!r},{u!r},{x!r}\n" for t, u, x in zip(*(c.tolist() for c in COLUMNS.values()), strict=True)
)


def _polars(path):
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({**COLUMNS, "label": ["run"] * N})
    frame.write_parquet(path) if path.suffix == ".parquet" else frame.write_ipc(path)


def _hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values
        file["note"] = "rig 3"


def _mat73(path):
    """As MATLAB writes it: a header before the HDF5 content, rows and columns exchanged, a class for each variable."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["run/x"] = X[None, :]
        file["run/label"] = np.frombuffer("rig".encode("utf-16-le"), np.uint16)[:, None]
        file["run/label"].attrs["MATLAB_class"] = np.bytes_("char")
        file["data"] = np.stack([T, U, X])
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))


def _sheet(path):
    openpyxl = pytest.importorskip("openpyxl")
    pytest.importorskip("python_calamine")
    book = openpyxl.Workbook()
    book.active.title = "Notes"
    book.active.append(["Rig 3", 17])
    sheet = book.create_sheet("Log")
    sheet.append(["", "Logger 7"])
    sheet.append(["", *COLUMNS])
    for row in zip(*(column.tolist() for column in COLUMNS.values()), strict=True):
        sheet.append([None, *row])
    book.save(path)


def _tdms(path):
    nptdms = pytest.importorskip("nptdms")
    channels = [nptdms.ChannelObject("Log", name, values) for name, values in COLUMNS.items()]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)


def _mf4(path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(values, T, name=name) for name, values in COLUMNS.items() if name != "t"])
        file.save(path, overwrite=True)


def _zip(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("run.csv", TEXT)
        archive.writestr("__MACOSX/._run.csv", "x")


def load(path, sentence="", **options):
    """The case of a file; its warnings, all of the package, have the `sentence`."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        case = case_from_files(path, **options)
    assert all(issubclass(one.category, FrictionjaxWarning) for one in said)
    assert any(sentence in str(one.message) for one in said)
    return case


WRITE = {
    ".tsv": lambda path: path.write_text(TEXT.replace(",", "\t")),
    ".dat": lambda path: path.write_text(TEXT),
    ".log.gz": lambda path: path.write_bytes(gzip.compress(TEXT.encode())),
    ".zip": _zip,
    ".csv.zip": _zip,
    ".npz": lambda path: np.savez(path, **COLUMNS, label=np.array("rig 3")),
    ".json": lambda path: path.write_text(
        json.dumps({name: values.tolist() for name, values in COLUMNS.items()})
    ),
    ".json.gz": lambda path: path.write_bytes(
        gzip.compress(
            json.dumps([dict(zip("tux", row, strict=True)) for row in np.transpose([T, U, X])]).encode()
        )
    ),
    ".jsonl": lambda path: path.write_text(
        "\n".join(json.dumps(dict(zip("tux", row, strict=True))) for row in np.transpose([T, U, X]))
    ),
    ".parquet": _polars,
    ".feather": _polars,
    ".h5": _hdf5,
    ".mat": _mat73,
    ".xlsx": _sheet,
    ".tdms": _tdms,
    ".mf4": _mf4,
}


@pytest.mark.parametrize("suffix", WRITE)
def test_a_recording_is_the_same_in_every_format(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    WRITE[suffix](path)
    case = load(path)
    assert [r.name for r in case.recordings] == ["run", "run_last_third"]
    assert case.recordings[0].sample_rate == 500.0
    rounded = 1e-15 if suffix == ".xlsx" else 0.0  # as the library writes it
    np.testing.assert_allclose(np.concatenate([r.x for r in case.recordings]), X, rtol=rounded)
    np.testing.assert_allclose(np.concatenate([r.u for r in case.recordings]), U, rtol=rounded)


def test_every_format_is_tried_above():
    text = {reader for suffix, reader in READERS.items() if suffix in (".csv", ".zip")}
    text |= {READERS[".mcap"]}  # test_ros.py
    tried = {READERS[suffix] for suffix in WRITE if suffix in READERS}
    assert set(READERS.values()) - tried - text == set()


LIBRARIES = {
    ".parquet": "polars",
    ".h5": "h5py",
    ".xlsx": "python_calamine",
    ".tdms": "nptdms",
    ".mf4": "asammdf",
}


@pytest.mark.parametrize("suffix", LIBRARIES)
def test_without_its_library_a_format_is_refused_with_the_command(tmp_path, monkeypatch, suffix):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(extra.importlib, "import_module", absent)
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"content")
    with pytest.raises(InputError, match=rf"{LIBRARIES[suffix]}.*pip install \"frictionjax\[(files|mdf)\]\""):
        open_table(path)


CONTENTS = {
    "empty": b"",
    "text": b"1,2\n3,4\n",
    "HDF5 cut short": b"\x89HDF\r\n\x1a\n" + bytes(90),
    "zip cut short": b"PK\x03\x04" + bytes(90),
}
FORMATS = (".parquet", ".feather", ".h5", ".npz", ".json", ".xlsx", ".tdms", ".mf4", ".jsonl")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
def test_what_is_not_of_its_format_is_an_input_error(tmp_path, suffix, content):
    if suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[suffix])
    path = tmp_path / f"run{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match="run") as error:
        open_table(path)
    assert len(str(error.value).splitlines()) == 1


class Pickled:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was loaded",))


def test_no_pickle_is_ever_loaded(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        head = np.lib.format.magic(1, 0)
        description = "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117) + "\n"
        archive.writestr("x.npy", head + len(description).to_bytes(2, "little") + description.encode()
                         + pickle.dumps(np.array([Pickled()], dtype=object)))  # fmt: skip
    with pytest.raises(InputError, match="contains no array of numbers"):
        open_table(tmp_path / "run.npz")
    np.savez(tmp_path / "both.npz", t=T, x=np.array([1, None], dtype=object))
    table = open_table(tmp_path / "both.npz")
    assert not table.has("x")
    assert "the array `x` is not read" in table.absence("x")


def test_matrices_and_nested_names(tmp_path):
    np.savez(tmp_path / "run.npz", data=np.stack([T, X], axis=1), image=np.zeros((200, 300)))
    table = open_table(tmp_path / "run.npz")
    np.testing.assert_array_equal(table.read(["data[:,1]"]), [X])
    assert "name `data[:,0]`" in table.absence("data")
    assert "2 dimensions" in table.absence("image")
    (tmp_path / "run.json").write_text(
        json.dumps({"run": {"x": [1, None, 3]}, "ragged": [[1], [1, 2]], "n": "rig"})
    )
    table = open_table(tmp_path / "run.json")
    np.testing.assert_array_equal(table.read(["run.x"]), [[1.0, np.nan, 3.0]])
    assert "different lengths" in table.absence("ragged")
    (tmp_path / "split.json").write_text(json.dumps({"columns": ["t", "x"], "data": [[0, 1], [2, 3]]}))
    np.testing.assert_array_equal(open_table(tmp_path / "split.json").read(["x"]), [[1.0, 3.0]])
    (tmp_path / "split.json").write_text(json.dumps({"columns": ["t", "x"], "data": [[0, 1], [2]]}))
    with pytest.raises(InputError, match="another length"):
        open_table(tmp_path / "split.json")


def test_names_of_matlab_in_a_file_of_version_73(tmp_path):
    _mat73(tmp_path / "run.mat")
    table = open_table(tmp_path / "run.mat")
    np.testing.assert_array_equal(table.read(["run.x", "data(:,2)"]), [X, U])
    assert "holds text" in table.absence("run.label")


def test_units_and_compounds_of_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["x"] = np.rad2deg(X)
        file["x"].attrs["units"] = "deg"
        rows = np.zeros(N, dtype=[("t", float), ("u", float), ("name", "S3")])
        rows["t"], rows["u"] = T, U
        file["log"] = rows
    case = load(tmp_path / "run.h5", "x was converted from deg to rad", columns={"t": "log.t", "u": "log.u"})
    np.testing.assert_allclose(case.recordings[0].x, X[: case.recordings[0].x.size], rtol=1e-14)
    assert "holds text" in open_table(tmp_path / "run.h5").absence("log.name")


def test_dates_and_durations_of_parquet(tmp_path):
    polars = pytest.importorskip("polars")
    start = datetime.datetime(2023, 5, 4, 23, 59, 59, 800000)
    dates = [start + datetime.timedelta(milliseconds=2 * k) for k in range(N)]
    frame = polars.DataFrame({"Time": dates, "since": [date - start for date in dates], "u": U, "x": X})
    frame.write_parquet(tmp_path / "run.parquet")
    for columns in ({}, {"t": "since"}):
        case = load(tmp_path / "run.parquet", columns=columns)
        assert case.recordings[0].sample_rate == 500.0


def test_channels_with_clocks_of_their_own_are_brought_to_the_times_of_x(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    slow, fast = np.arange(100) / 100.0, np.arange(20, 1200) / 1000.0
    path = tmp_path / "run.mf4"
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(np.cos(9.0 * slow), slow, name="u", unit="mA")])
        file.append([asammdf.Signal(np.sin(5.0 * fast), fast, name="x", unit="deg")])
        file.append([asammdf.Signal(20.0 + slow, slow, name="temperature")])
        file.save(path, overwrite=True)
    case = load(path, "u has a clock of its own: it was held until the times of x")
    first = case.recordings[0]
    used = fast[fast <= slow[-1]]
    assert (first.sample_rate, sum(r.x.size for r in case.recordings)) == (1000.0, used.size)
    expected = 1e-3 * np.cos(9.0 * slow)[np.floor(used * 100.0 + 1e-6).astype(int)]
    np.testing.assert_allclose(np.concatenate([r.u for r in case.recordings]), expected, rtol=1e-12)
    np.testing.assert_allclose(
        np.concatenate([r.temperature for r in case.recordings]), 20.0 + used, rtol=1e-12
    )
    assert case.plant.position_unit == "rad"


def test_the_clock_of_a_waveform(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    own = {"wf_increment": 0.002, "wf_start_offset": 0.0}
    channels = [
        nptdms.ChannelObject("A", "x", 1e3 * X, properties=own | {"unit_string": "mm"}),
        nptdms.ChannelObject("A", "u", U, properties=own),
    ]
    with nptdms.TdmsWriter(str(tmp_path / "run.tdms")) as writer:
        writer.write_segment([*channels, nptdms.ChannelObject("B", "u", U)])
    case = load(tmp_path / "run.tdms", "x was converted from mm to m", columns={"u": "A/u"})
    assert case.recordings[0].sample_rate == 500.0
    np.testing.assert_allclose(case.recordings[0].x, X[: case.recordings[0].x.size], rtol=1e-14)


def test_a_sheet_with_other_sheets_beside_it_is_named(tmp_path):
    _sheet(tmp_path / "run.xlsx")
    with pytest.warns(
        FrictionjaxWarning, match="the sheet `Log` was read, which holds most numbers; Notes was not"
    ):
        table = open_table(tmp_path / "run.xlsx")
    assert table.place(0) == "line 3"


def test_a_zip_of_two_files_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.zip", "w") as archive:
        archive.writestr("a.csv", TEXT)
        archive.writestr("b.csv", TEXT)
    with pytest.raises(InputError, match=r"the zip file holds 2 files: a\.csv, b\.csv"):
        open_table(tmp_path / "run.zip")


class Panic(BaseException):
    """As libraries in Rust have it."""


class Halfway:
    """An object that fails once more when it goes, as what a library did not complete may do."""

    def __init__(self, error):
        sys.stdout.write("a line of the library")
        raise error

    def __del__(self):
        raise AttributeError("no header")


@pytest.mark.parametrize(
    "error", [Panic("a range"), KeyError("x"), ValueError("two\nlines"), AssertionError()]
)
def test_whatever_a_library_makes_of_a_damaged_file_is_one_line(tmp_path, capfd, error):
    with (
        pytest.raises(InputError) as said,
        extra.clean_errors(tmp_path / "run.h5", "is damaged", "Write it again"),
    ):
        Halfway(error)
    assert str(said.value).endswith(
        f"run.h5: is damaged ({type(error).__name__}: {extra.shown(error)}). Write it again."
    )
    assert len(str(said.value).splitlines()) == 1
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("error", [MemoryError(), KeyboardInterrupt(), InputError("its own sentence")])
def test_what_is_no_error_of_the_file_is_passed_on(tmp_path, error):
    with (
        pytest.raises(type(error)) as said,
        extra.clean_errors(tmp_path / "run.h5", "is damaged", "Write it again"),
    ):
        raise error
    assert said.value is error


def _clocked(clocks, samples):
    columns = {name: lambda n=n: np.zeros(n) for name, n in samples.items()}
    times = {name: lambda own=own: np.asarray(own, dtype=float) for name, own in clocks.items()}
    return ArrayTable(Path("run.mf4"), tuple(columns), columns, {}, "channel", {}, times)


@pytest.mark.parametrize(
    ("clocks", "samples", "words"),
    [
        ({"x": [], "u": []}, {"x": 0, "u": 0}, "`x` has 0 samples, and its clock 0 times"),
        ({"x": [0, 1, 2], "u": []}, {"x": 3, "u": 0}, "`u` has 0 samples"),
        ({"x": [0, 1], "u": [0, 1]}, {"x": 3, "u": 2}, "`x` has 3 samples, and its clock 2 times"),
        ({"x": [0, 1, 2], "u": [0, 2, 1]}, {"x": 3, "u": 3}, "clock of `u` does not run forward"),
        ({"x": [0, np.nan, 2], "u": [0, 1, 2]}, {"x": 3, "u": 3}, "clock of `x` does not run forward"),
    ],
)
def test_a_clock_that_does_not_fit_its_channel(clocks, samples, words):
    table = _clocked(clocks, samples)
    values = dict(zip(samples, table.read(list(samples)), strict=True))
    with pytest.raises(InputError, match=words):
        on_one_clock(values, {"x": "x", "u": "u"}, table)


def test_one_clock_for_all_is_taken_as_it_is():
    values, said = on_one_clock(
        {"x": X, "u": U}, {"x": "x", "u": "u"}, _clocked({"x": T, "u": T}, {"x": N, "u": N})
    )
    np.testing.assert_array_equal(values["t"], T)
    assert not said
