"""A file whose suffix says nothing is read by its content; one that is not read says what it holds, and what to do."""

import bz2
import gzip
import json
import lzma
import pickle
import tarfile

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings.readers import open_table, stem

N = 300
T = np.arange(N) / 500.0
COLUMNS = {"t": T, "u": np.cos(9.0 * T), "x": 0.01 * np.sin(7.0 * T)}
ROWS = [",".join(map(repr, row)) for row in np.transpose(list(COLUMNS.values())).tolist()]
TEXT = "\n".join(["t,u,x", *ROWS]) + "\n"


def _npz(path):
    with path.open("wb") as stream:  # a path would be given the suffix
        np.savez(stream, **COLUMNS)


def _parquet(path):
    pytest.importorskip("polars").DataFrame(COLUMNS).write_parquet(path)


def _hdf5(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values


def _sheet(path):
    pytest.importorskip("python_calamine")
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (COLUMNS, *np.transpose(list(COLUMNS.values())).tolist()):
        book.active.append(list(row))
    with path.open("wb") as stream:
        book.save(stream)


READ = {
    "log.gz": lambda path: path.write_bytes(gzip.compress(TEXT.encode())),
    "log.csv.gz": lambda path: path.write_bytes(gzip.compress(TEXT.encode())),
    "log.tsv.gz": lambda path: path.write_bytes(gzip.compress(TEXT.replace(",", "\t").encode())),
    "log.out": lambda path: path.write_text(TEXT),
    "log": lambda path: path.write_text(TEXT.replace(",", " ")),
    "log.001": lambda path: path.write_text(json.dumps({k: v.tolist() for k, v in COLUMNS.items()})),
    "log.data": _npz,
    "log.bin": _hdf5,
    "log.raw": _parquet,
    "log.sheet": _sheet,
}


@pytest.mark.parametrize("name", READ)
def test_a_suffix_that_says_nothing_is_no_obstacle(tmp_path, name):
    path = tmp_path / name
    READ[name](path)
    table = open_table(path)
    assert stem(path) == "log"
    for values, column in zip(table.read(list(COLUMNS)), COLUMNS.values(), strict=True):
        np.testing.assert_allclose(values, column, rtol=1e-15)


class Loaded:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was loaded",))


def _tar(path):
    (path.parent / "inside.csv").write_text(TEXT)
    with tarfile.open(path, "w:gz") as archive:
        archive.add(path.parent / "inside.csv")


def _gzipped_hdf5(path):
    _hdf5(path)
    path.write_bytes(gzip.compress(path.read_bytes()))


REFUSED = {
    "run.pkl": (lambda path: path.write_bytes(pickle.dumps(Loaded())), "is a pickle", "to_csv"),
    "run.csv": (lambda path: path.write_bytes(pickle.dumps(Loaded())), "is a pickle", "to_csv"),
    "run.old": (
        lambda path: path.write_bytes(pickle.dumps(Loaded(), 0)),
        'suffix ".old"',
        "formats that are",
    ),
    "run.npy": (lambda path: np.save(path, T), "is a single NumPy array", "numpy.savez"),
    "run.bz2": (lambda path: path.write_bytes(bz2.compress(TEXT.encode())), "bzip2", "bunzip2 run.bz2"),
    "run.xz": (lambda path: path.write_bytes(lzma.compress(TEXT.encode())), "packed by xz", "unxz run.xz"),
    "run.tgz": (_tar, "a gzip file with a tar archive in it", "tar -xf run.tgz"),
    "run.gz": (_gzipped_hdf5, "a gzip file with an HDF5 file in it", "gunzip run.gz"),
    "run": (lambda path: path.write_bytes(b"\x89MCAP0\r\n" + bytes(50)), "a bag of ROS", "run.mcap"),
    "run.dat": (_hdf5, "is an HDF5 file, which its suffix does not say", "ends in .h5"),
    "run.txt": (_sheet, "is an Excel file, which its suffix does not say", "ends in .xlsx"),
    "run.bin": (lambda path: path.write_bytes(b"\0\1\2" * 99), "the file is binary", ".parquet"),
    "run.md": (lambda path: path.write_text("A title\nand a text\n"), "no line of numbers", ".csv"),
    "cut.gz": (lambda path: path.write_bytes(gzip.compress(TEXT.encode())[:60]), "damaged", "Pack it again"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_says_what_it_holds_and_what_to_do(tmp_path, name):
    make, problem, cure = REFUSED[name]
    make(tmp_path / name)
    with pytest.raises(InputError) as error:
        open_table(tmp_path / name)
    line = str(error.value)
    assert len(line.splitlines()) == 1 and name in line
    assert problem in line and cure in line


def test_text_that_begins_like_another_format_is_text(tmp_path):
    for first in ("PAR1", "MDF     ", "BZh", "TDSm"):
        (tmp_path / "run.out").write_text(TEXT.replace("t,u", f"{first},u", 1))
        assert open_table(tmp_path / "run.out").names[1:] == ("u", "x")
