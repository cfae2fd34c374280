"""Parsers in a process of their own: what ends them ends nothing else."""

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings import case_from_files
from frictionjax.recordings.readers import apart, mf4
from frictionjax.recordings.readers.apart import ParserEnded, ask

PARSER = """
import json, os, sys, time
for line in sys.stdin:
    wanted = json.loads(line)["do"]
    if wanted == "crash":
        os.abort()
    while wanted == "hang":
        time.sleep(0.1)
    print(json.dumps({"process": os.getpid(), "words": "µ"}), flush=True)
"""
LONG = 60.0  # s: more than any machine needs to start it


@pytest.fixture
def parser(tmp_path, monkeypatch):
    """The name of a program that answers, crashes or hangs, as it is asked to."""
    name = f"parser_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(PARSER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return name


def test_one_process_answers_until_it_ends_and_then_another(parser):
    first = ask(parser, {"do": "answer"}, LONG)
    assert first["words"] == "µ" and ask(parser, {"do": "answer"}, LONG) == first
    with pytest.raises(ParserEnded, match="crashed, exit status -6"):
        ask(parser, {"do": "crash"}, LONG)
    second = ask(parser, {"do": "answer"}, LONG)
    assert second["process"] != first["process"]
    with pytest.raises(ParserEnded, match="had not ended after 1 s"):
        ask(parser, {"do": "hang"}, 1.0)
    assert ask(parser, {"do": "answer"}, LONG)["process"] not in (first["process"], second["process"])


def test_an_answer_that_was_not_waited_for_is_not_that_to_the_next_request(parser, monkeypatch):
    first = ask(parser, {"do": "answer"}, LONG)

    def interrupted(_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(apart.json, "dumps", interrupted)
        with pytest.raises(KeyboardInterrupt):
            ask(parser, {"do": "answer"}, LONG)
    assert ask(parser, {"do": "answer"}, LONG)["process"] != first["process"]


def test_a_file_whose_parser_ends_is_refused_in_one_line(tmp_path, monkeypatch):
    pytest.importorskip("asammdf")

    def ended(*_):
        raise ParserEnded("its parser crashed, exit status -11")

    monkeypatch.setattr(mf4, "ask", ended)
    path = tmp_path / "run.mf4"
    path.write_bytes(b"MDF     4.10")
    with pytest.raises(InputError, match=r"is not an MDF file that can be read \(its parser crashed"):
        case_from_files([path])


def test_a_channel_that_cannot_be_read_costs_the_others_nothing(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    t = np.arange(400) / 1000.0
    signals = [
        asammdf.Signal(values, t, name=name, encoding="utf-8" if values.dtype.kind == "S" else None)
        for name, values in (("u", np.sin(t)), ("x", np.cos(t)), ("note", np.array([b"text"] * 400)))
    ]
    with asammdf.MDF() as file:
        file.append(signals)
        path = file.save(tmp_path / "run.mf4", overwrite=True)
    table = mf4.open_mf4(path)
    assert table.names == ("u", "x", "note")
    np.testing.assert_array_equal(table.read(["x"])[0], np.cos(t))
    np.testing.assert_array_equal(table.clock("u"), t)
    with pytest.raises(InputError, match="`note` holds text"):
        table.read(["note"])
