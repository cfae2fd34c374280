"""Damaged files of every reader: a few hundred here, a million with `python -m benchmarks.hostile`."""

from importlib.util import find_spec

import pytest

from benchmarks.hostile.__main__ import main
from benchmarks.hostile.run import KINDS, outcome, read, run, seeds_of, written
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


def test_a_few_hundred_damaged_files(tmp_path):
    table = run(360, 20_000, tmp_path)
    assert sum(counts.total() for counts in table.values()) == 360
    for reader, counts in table.items():
        assert counts["clean errors"], reader
        assert not [kind for kind in KINDS[2:] if counts[kind]], (reader, counts)
    assert sum(counts["accepted"] for counts in table.values()) > 10


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
