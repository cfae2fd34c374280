"""What a file may cost is limited before it is read, and a damaged one never ends the process."""

import dataclasses
import gzip
import os
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from helpers_recordings import (
    FIT,
    HEADER,
    HOLDOUT,
    N,
    case,
    check_message,
    columns,
    lines,
    plant,
    raw,
    toml,
    write,
)
from scipy.io import savemat

from frictionjax.core import InputError
from frictionjax.recordings import Recording, case_from_files, load_case
from frictionjax.recordings.copies import copied_from
from frictionjax.recordings.limits import reading, require_small
from frictionjax.recordings.readers import open_table
from frictionjax.recordings.readers.mat_check import Damaged, variables

HOSTILE = Path(__file__).parents[3] / "shared" / "hostile"


def element(kind, data):
    """One element of level 5; what is compressed is not filled up to eight bytes."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8 if kind != 15 else 0)


def array(name, body, kind=6, shape=(3, 1)):
    head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<2i", *shape))
    return element(14, head + element(1, name.encode()) + body)


def level_5(*parts):
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49) + b"".join(parts)


NUMBERS = element(9, struct.pack("<3d", 1, 2, 3))


def nested(depth):
    """A struct in a struct in a struct."""
    part = array("", NUMBERS)
    for _ in range(depth):
        part = array("", element(5, struct.pack("<i", 8)) + element(1, b"field\0\0\0") + part, 2, (1, 1))
    return part


DAMAGED = {
    "type of the data": level_5(array("x", element(8, bytes(24)))),
    "fewer values than dimensions": level_5(array("x", NUMBERS, shape=(300, 1))),
    "size of an element": level_5(array("x", NUMBERS)[:-8]),
    "class of the array": level_5(array("x", NUMBERS, kind=200)),
    "negative dimension": level_5(array("x", NUMBERS, shape=(-3, 1))),
    "compressed data cut short": level_5(element(15, zlib.compress(array("x", NUMBERS))[:-6])),
    "nested too deep": level_5(nested(20_000)),
    "level 4, too long": struct.pack("<5i", 0, 10**6, 10**6, 0, 2) + b"x\0",
    "not of the format": bytes(200),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_matlab_file_is_one_line(tmp_path, name):
    check_message(raw("run.mat", DAMAGED[name])(tmp_path), ["run.mat", "is not a MATLAB", "-v7"])


def test_a_sound_matlab_file_is_walked_to_its_end(tmp_path):
    """Compressed and not, of both levels, with all that a struct or a cell may hold; no name is lost."""
    cell = np.empty((2, 1), dtype=object)
    cell[:] = [[np.arange(3.0)], ["text"]]
    whole = {
        "x": np.arange(5.0),
        "s": {"u": np.arange(3), "inner": {"z": 1j}},
        "c": cell,
        "text": "abc",
        "flag": np.array([True]),
        "none": np.zeros((0, 0)),
    }
    for options in ({}, {"do_compression": True}):
        savemat(tmp_path / "run.mat", whole, **options)
        assert variables((tmp_path / "run.mat").read_bytes()) == list(whole)
    savemat(tmp_path / "old.mat", {"x": np.arange(5.0), "text": "abc"}, format="4")
    assert variables((tmp_path / "old.mat").read_bytes()) == ["x", "text"]
    assert variables(level_5(nested(20))) == []
    with pytest.raises(Damaged, match="deep"):
        variables(level_5(nested(40)))


def zip_bomb(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(3_000_000))


def mat_bomb(path):
    path.write_bytes(
        level_5(element(15, zlib.compress(array("x", element(9, bytes(3_000_000)), shape=(375_000, 1)))))
    )


def sparse(path):
    with path.open("wb") as stream:
        stream.truncate(2_000_001)


BOMBS = {
    "run.csv.gz": lambda path: path.write_bytes(gzip.compress(b"0,0,0\n" * 500_000)),
    "run.mat": mat_bomb,
    "run.zip": zip_bomb,
    "run.csv": sparse,
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_is_unpacked_is_limited(tmp_path, name):
    """In small: a few kB that unpack to 3 MB, under a limit of 2 MB, and of 4 MB."""
    path = tmp_path / name
    BOMBS[name](path)
    act = require_small if name == "run.zip" else open_table
    with reading(0.002), pytest.raises(InputError, match=r"larger than the limit of 0\.002 GB\. .*--limit"):
        act(path)
    if name != "run.csv":
        with reading(0.004):
            act(path)


@pytest.mark.parametrize("name", ["run.csv.zip", "run.npz", "run.zip"])
def test_a_zip_file_of_another_version_is_one_line(tmp_path, name):
    """Python's own zipfile raises for it as soon as it is opened."""
    zip_bomb(tmp_path / name)
    data = bytearray((tmp_path / name).read_bytes())
    directory = data.index(b"PK\x01\x02")
    data[directory + 6] = 170  # the version that is needed to unpack it
    (tmp_path / name).write_bytes(data)
    check_message(lambda: open_table(tmp_path / name), [name])


def test_the_limit_is_an_argument(tmp_path):
    load = toml(tmp_path)
    load()
    with pytest.raises(InputError, match="limit of 1e-06 GB"):
        load_case(tmp_path / "case.toml", limit=1e-6)
    with pytest.raises(InputError, match="limit of 1e-06 GB"):
        case_from_files(tmp_path / "run.csv", limit=1e-6)
    with pytest.raises(InputError, match="not above zero"):
        case_from_files(tmp_path / "run.csv", limit=0.0)
    load()


COSTLY = {
    "digits and a letter": (
        lambda folder: toml(folder, change=lambda rows: [rows[0], rows[1] + "1" * 100_000 + "x", *rows[2:]]),
        ["run.csv, line 2", "is not a number"],
    ),
    "a line of a million columns": (
        raw("run.csv", (b"1," * 1_000_000 + b"1\n") * 3),
        ["run.csv, line 1", "2000001 characters"],
    ),
    "a key of many dots": (case("a" + ".a" * 20_000 + " = 1\n"), ["case.toml, line 1", "key of more than"]),
    "a case file of megabytes": (case("#" * 2_000_000), ["case.toml", "more than a case file takes"]),
    "thousands of digits": (plant("inertia = 1" + "0" * 5000), ["case.toml", "more digits"]),
    "hexadecimal digits": (plant("inertia = 0x" + "F" * 5000), ["[plant], key `inertia`", "20000 bits"]),
    "a unit of thousands of letters": (
        plant(f'position_unit = "{"m" * 5000}"'),
        ["[plant], key `position_unit`", "5000 characters"],
    ),
    "a name of thousands of letters": (case(f'name = "{"m" * 5000}"\n'), ["key `name`", "5000 characters"]),
    "a key of thousands of letters": (case("k" * 50_000 + " = 1\n"), ["unknown key"]),
    "time steps below any clock's": (
        lambda folder: toml(
            folder, change=lambda rows: [rows[0], *(f"{k}e-310,{k % 3},{k % 7}" for k in range(150))]
        ),
        ["run.csv", "the sample rate is inf Hz", "ms"],
    ),
}


@pytest.mark.parametrize("name", COSTLY)
def test_what_would_take_long_is_one_line(tmp_path, name):
    make, words = COSTLY[name]
    check_message(make(tmp_path), words)


def outside(tmp_path, name):
    """A case in a folder of its own, whose recording to fit is `name`."""
    folder = tmp_path / "case"
    folder.mkdir()
    write(tmp_path)
    toml(folder, HEADER + FIT.replace("run.csv", name) + HOLDOUT)
    return folder / "case.toml"


@pytest.mark.parametrize("kind", ["above", "absolute", "link", "absent"])
def test_a_case_file_stays_in_its_folder(tmp_path, kind):
    """Whether there is such a file, and what is beside it, is not said either."""
    above = {"above": "../run.csv", "absolute": str(tmp_path / "run.csv"), "absent": "../rum.csv"}
    file = outside(tmp_path, above.get(kind, "link.csv"))
    if kind == "link":
        (file.parent / "link.csv").symlink_to(tmp_path / "run.csv")
    check_message(
        lambda: load_case(file),
        ["recording 1", "is outside of the folder of the case file", "--allow-outside"],
    )
    if kind == "absent":
        check_message(lambda: load_case(file, allow_outside=True), ['Did you mean "run.csv"?'])
    else:
        assert load_case(file, allow_outside=True).recordings[0].x.size == N


@pytest.mark.skipif(os.name != "posix", reason="names are text there")
def test_a_file_name_that_is_not_utf8(tmp_path):
    name = os.fsdecode(b"mo\xffves.csv")
    toml(tmp_path)
    (tmp_path / "run.csv").rename(tmp_path / name)
    found = case_from_files([tmp_path / name], [tmp_path / "kept.csv"])
    assert found.name == found.recordings[0].name == r"mo\udcffves"


def test_parts_of_one_file_are_recordings_of_their_own(tmp_path):
    write(tmp_path, rows=[lines()[0], *(f"{k / 1e3:.3f},{k % 7},{(k * k) % 1009}" for k in range(4000))])
    part = '[[recording]]\nfile = "run.csv"\nrole = "{}"\ninterval = [{}, {}]\n'
    text = "".join(part.format("holdout" if k % 2 else "fit", k / 10, (k + 1) / 10) for k in range(39))
    (tmp_path / "case.toml").write_text(text)
    found = load_case(tmp_path / "case.toml")
    assert len({recording.name for recording in found.recordings}) == 39


def recorded(x, role="fit"):
    return Recording("run", 1000.0, np.ones(x.size), x, role=role)


def test_a_copy_is_known_by_its_second_differences():
    """One of a quantised position but for a few counts, or shorter; another run of the same is none, nor is
    another constant velocity."""
    t = np.arange(4000) / 1000.0
    moves = 40.0 * np.sin(6.0 * t) * (t > 1.0)
    run, again = (np.rint(moves + np.random.default_rng(seed).normal(0.0, 0.3, t.size)) for seed in range(2))
    fitted = [recorded(again), recorded(run)]
    changed = run.copy()
    changed[[1500, 2500]] += 1.0
    for copy in (run, changed, changed[:3000]):
        assert copied_from(recorded(copy, "holdout"), fitted) is fitted[1]
    third = np.rint(moves + np.random.default_rng(2).normal(0.0, 0.3, t.size))
    assert copied_from(recorded(third, "holdout"), fitted) is None
    assert copied_from(recorded(run[::-1].copy(), "holdout"), fitted) is None
    assert copied_from(recorded(changed + 1.0, "holdout"), fitted) is None
    other_input = dataclasses.replace(recorded(changed, "holdout"), u=t)
    assert copied_from(other_input, fitted) is None
    line = np.rint(0.7 * np.arange(4000.0))
    assert copied_from(recorded(line + 7.0, "holdout"), [recorded(line)]) is None


def test_a_copy_of_one_count_is_refused(tmp_path):
    toml(tmp_path)
    t, u, x = columns()
    x = x.copy()
    x[100] += 1e-9
    rows = [f"{a:.3f},{b:.9g},{c:.12g}" for a, b, c in zip(t, u, x, strict=True)]
    write(tmp_path, "kept.csv", rows=[lines()[0], *rows])
    check_message(lambda: load_case(tmp_path / "case.toml"), ["holds the same positions", "cannot validate"])


@pytest.mark.skipif(not HOSTILE.is_dir(), reason="needs the shared inputs")
@pytest.mark.parametrize("name", ["segv/case.toml", "int/case.toml", "int/hex.toml"])
def test_the_smallest_inputs_that_once_broke_it(name):
    check_message(lambda: load_case(HOSTILE / name), [Path(name).parent.name])
