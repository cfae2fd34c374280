"""Progress: a bar where a person watches, nothing elsewhere, and the caller's own wherever it is given."""

import io
import sys
import types
from concurrent.futures import ThreadPoolExecutor

import pytest

from frictionjax.cli import terminal
from frictionjax.core import progress as core_progress
from frictionjax.core import reporting, silent
from frictionjax.core.progress import Counting


class _Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("progress", [True, False])
def test_nobody_watches_a_file(monkeypatch, progress):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with reporting(progress) as report:
        assert report is silent
    assert stream.getvalue() == ""


def test_a_terminal_gets_a_bar_that_goes_away(monkeypatch):
    stream = _Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    with pytest.raises(KeyError), reporting(True) as report:
        report("settling", 0.25)
        report("refining", 0.5)
        raise KeyError
    assert "25 %" in stream.getvalue()
    assert "refining" in stream.getvalue()
    assert stream.getvalue().endswith("\r")  # the line is empty again, also after an error


def test_a_terminal_stays_silent_when_asked_to(monkeypatch):
    stream = _Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    with reporting(False) as report:
        report("settling", 0.25)
    assert stream.getvalue() == ""


def test_a_notebook_gets_a_bar(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    with reporting(True) as report:
        report("settling", 0.25)
    assert "settling" in stream.getvalue()


def test_the_callers_own_is_called():
    heard = []
    with reporting(lambda stage, fraction: heard.append((stage, fraction))) as report:
        report("settling", 0.25)
    assert heard == [("settling", 0.25)]


def test_tasks_are_counted_and_give_what_they_would():
    said = []
    with ThreadPoolExecutor(2) as threads:
        counting = Counting(
            threads, lambda stage, fraction: said.append((stage, fraction)), "refitting", 0.2, 0.6
        )
        assert list(counting.map(lambda a, b: a + b, (1, 2, 3, 4), (10, 20, 30, 40))) == [11, 22, 33, 44]
        assert [stage for stage, _ in said] == [f"refitting · {done} of 4" for done in (1, 2, 3, 4)]
        assert [fraction for _, fraction in said] == pytest.approx([0.3, 0.4, 0.5, 0.6])
        # Tasks that go on with some of these take nothing back.
        assert list(counting.map(str, (1, 2))) == ["1", "2"]
        assert said[-1] == ("refitting · 2 of 2", 0.6) and counting.submit(str, 5).result() == "5"
        with pytest.raises(ZeroDivisionError):
            list(counting.map(lambda one: 1 / one, (0,)))


def test_a_file_gets_a_line_a_stage_and_none_for_each_task(capsys):
    assert terminal.COUNT == core_progress.COUNT
    shown = terminal.Terminal()
    for done in (1, 2, 3):
        shown.progress(f"refitting{core_progress.COUNT}{done} of 3", 0.5)
    shown.progress("judging", 0.9)
    assert capsys.readouterr().err == "refitting ...\njudging ...\n"
