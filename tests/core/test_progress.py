"""Progress: a bar where a person watches, nothing elsewhere, and the caller's own wherever it is given."""

import io
import sys
import types

import pytest

from frictionjax.core import reporting, silent


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
