"""Damaged files of every reader: two thousand here, any number with `python -m benchmarks.hostile`."""

import sys
from collections import Counter
from importlib.util import find_spec

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.hostile.__main__ import main
from benchmarks.hostile.run import KINDS, finished, outcome, read, run, seeds_of, written
from benchmarks.hostile.seeds import damaged, seeds, seeds_of_extras
from frictionjax.recordings.readers import READERS


@pytest.mark.filterwarnings("ignore::frictionjax.FrictionjaxWarning")
@pytest.mark.parametrize("reader", seeds())
def test_what_is_damaged_was_sound(reader, tmp_path):
    written(reader, 0, tmp_path)  # with what a case needs beside it
    for name, data in seeds_of(reader):
        (tmp_path / name).write_bytes(data)
        assert read(tmp_path / name) == "accepted", name


def test_every_reader_has_its_damaged_files():
    names = [name for some in (seeds(), seeds_of_extras()) for files in some.values() for name, _ in files]
    suffixes = [suffix for suffix in READERS if any(name.endswith(suffix) for name in names)]
    extras = {".mf4": "asammdf", ".mcap": "rosbags"}
    readers = set(READERS.values()) - {
        READERS[one] for one, name in extras.items() if find_spec(name) is None
    }
    assert {READERS[suffix] for suffix in suffixes} == readers


@pytest.mark.filterwarnings("ignore::frictionjax.FrictionjaxWarning")
def test_what_is_damaged_of_the_extras_was_sound(tmp_path):
    for files in seeds_of_extras().values():
        for name, data in files:
            (tmp_path / name).write_bytes(data)
            assert read(tmp_path / name) == "accepted", name


def test_damaged_files_of_every_reader(tmp_path):
    table = run(1800, 20_000, tmp_path)
    assert sum(counts.total() for counts in table.values()) == 1800
    for reader, counts in table.items():
        assert counts["clean errors"], reader
        assert not [kind for kind in KINDS[2:] if counts[kind]], (reader, counts)
    assert sum(counts["accepted"] for counts in table.values()) > 50


@pytest.mark.filterwarnings("ignore")
def test_damaged_files_of_the_extras(tmp_path):
    """In this process: to begin a new one takes longer than to read these."""
    readers = list(seeds_of_extras())
    found = {reader: Counter(outcome(reader, 20_000 + k, tmp_path) for k in range(34)) for reader in readers}
    for reader, counts in found.items():
        assert counts["clean errors"], reader
        assert not counts["faults"], (reader, counts)


NAMES = sorted(
    {name for some in (seeds(), seeds_of_extras()) for files in some.values() for name, _ in files}
)
STARTS = (
    b"",
    b"t,u,x\n",
    b"\xff\xfe",
    b"PK\x03\x04",
    b"\x1f\x8b\x08",
    b"\x89HDF\r\n\x1a\n",
    b"PAR1",
    b"[",
    b"TDSm",
    b"MDF ",
)


@pytest.mark.filterwarnings("ignore")
@settings(
    max_examples=150,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    name=st.sampled_from(NAMES),
    start=st.sampled_from(STARTS),
    rest=st.one_of(st.binary(max_size=300), st.text(max_size=300).map(str.encode)),
)
def test_any_content_under_any_name_is_read_or_refused(tmp_path, name, start, rest):
    (tmp_path / name).write_bytes(start + rest)
    assert read(tmp_path / name) in KINDS[:2]


def test_a_run_that_was_stopped_goes_on_where_it_was(tmp_path, monkeypatch):
    """Parts that are in the file of rows are not read again, and count."""
    rows = tmp_path / "rows.jsonl"
    monkeypatch.setattr("benchmarks.hostile.run.seeds", lambda: {"gzip": seeds_of("gzip")})
    monkeypatch.setattr("benchmarks.hostile.run._AT_ONCE", 4)
    first = run(10, 7, tmp_path, rows=rows)
    parts = finished(rows)
    assert [(low, high) for _, low, high in parts] == [(7, 11), (11, 15), (15, 17)]
    assert sum(parts.values(), Counter()) == first["gzip"]
    rows.write_text("".join(rows.read_text().splitlines(keepends=True)[:2]))
    monkeypatch.setattr("benchmarks.hostile.run.outcome", lambda *_: "accepted")
    again = run(10, 7, tmp_path, rows=rows)["gzip"]
    assert again == parts["gzip", 7, 11] + parts["gzip", 11, 15] + Counter(accepted=2)


def test_without_atheris_the_command_is_said(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "atheris", None)
    assert main(["--atheris", "gzip"]) == 2
    assert "python -m pip install atheris" in capsys.readouterr().err


def test_an_input_is_known_by_its_number():
    ((_, data),) = seeds_of("gzip")
    assert damaged(data, 7) == damaged(data, 7)
    assert len({damaged(data, seed) for seed in range(50)}) > 40


@pytest.mark.parametrize("kind", KINDS[2:])
def test_what_goes_wrong_is_counted_and_kept(tmp_path, monkeypatch, capsys, kind):
    """One input of each reader is answered as no input should be."""

    def badly(reader, number, scratch):
        if number != 2:
            return outcome(reader, number, scratch)
        if kind == "deaths":
            run.__globals__["os"].abort()
        while kind == "hangs":
            pass
        return "faults"

    monkeypatch.setattr("benchmarks.hostile.run.outcome", badly)
    monkeypatch.setattr("benchmarks.hostile.run.seeds", lambda: {"gzip": seeds_of("gzip")})
    options = ["--inputs", "4", "--seconds", "0.5", "--keep", str(tmp_path / "kept")]
    assert main(options) == 1
    assert "1 of 4 inputs were neither read" in capsys.readouterr().out
    assert [path.name for path in (tmp_path / "kept").iterdir()] == [f"{kind} gzip 2"]
