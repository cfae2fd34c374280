"""`frictionjax diagnose` as a process, stopped at random moments: the result is the earlier one or the new one."""

import io
import json
import os
import random
import signal
import sys
import tempfile
import time
import types
import warnings

import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis, fake_recording
from helpers_recordings import toml

from frictionjax.cli import main, program
from frictionjax.core import FrictionjaxWarning
from frictionjax.report import save, save_diagnosis

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied here by fork")

STOPS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
ENDS = {signal.SIGKILL: -signal.SIGKILL, signal.SIGTERM: 143, signal.SIGINT: 130}
"""The status with which a stopped process ends, as a shell has it; minus the signal where it cannot be caught."""
NAMES = ("run", "kept")


def _small(diagnosis):
    recordings = tuple(fake_recording(name, n=30) for name in NAMES)
    return diagnosis.__class__(**{**vars(diagnosis), "recordings": recordings})


OLD, NEW = _small(adequate_diagnosis()), _small(fake_diagnosis(n=30))
WORK = 0.05
"""Seconds of the diagnosis in place of minutes."""


@pytest.fixture
def command(tmp_path, monkeypatch):
    """The program's arguments; it reads its case, reserves the folder and saves as always, and diagnoses in no time."""

    def diagnose(case, *, known, without, progress):
        assert {recording.name for recording in case.recordings} == set(NAMES)
        progress("fitting the base model", 0.5)
        time.sleep(WORK)
        return NEW

    stub = types.ModuleType("frictionjax.api")
    vars(stub).update(diagnose=diagnose, save_diagnosis=save_diagnosis, __all__=["save_diagnosis"])
    monkeypatch.setitem(sys.modules, "frictionjax.api", stub)

    def write(diagnosis, directory):
        time.sleep(WORK)
        (directory / "report.html").write_text(diagnosis.case)

    monkeypatch.setattr(save, "write_report", write)  # drawing takes seconds
    toml(tmp_path)
    return ["diagnose", str(tmp_path / "case.toml"), "--out", str(tmp_path / "out")]


def started(arguments):
    """The number of a copy of this process that runs the program."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX, with which the copy computes nothing
        child = os.fork()
    if child:
        return child
    status = 99
    try:
        sys.stdout = sys.stderr = io.StringIO()  # what pytest keeps is a file, too
        status = main(arguments)
    except KeyboardInterrupt:  # before the program is ready for it, as at any Python program
        status = 130
    finally:
        os._exit(status)


def ended(child):
    """The status of a process, once it has ended."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def whole(folder):
    """The case of the result in a folder, whose files are all of one run."""
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    assert json.loads((folder / "comparisons.json").read_text(encoding="utf-8"))["case"] == verdict["case"]
    assert {f"fit/{path.name}" for path in (folder / "fit").iterdir()} == {
        fit["file"] for fit in verdict["fit"].values()
    }
    return verdict["case"]


@pytest.mark.parametrize("moments", [4, pytest.param(50, marks=pytest.mark.slow)])
def test_a_command_that_is_stopped_at_random_moments(tmp_path, command, moments):
    rng, out = random.Random(moments), tmp_path / "out"
    start = time.perf_counter()
    assert ended(started(command)) == 0
    length = time.perf_counter() - start
    found = []
    for moment in range(moments):
        save_diagnosis(OLD, out, report=False)
        assert whole(out) == OLD.case
        (out / "notes.txt").write_text("mine")
        stop = STOPS[moment % len(STOPS)]
        child = started(command)
        time.sleep(rng.uniform(0.0, 1.1 * length))
        os.kill(child, stop)
        status = ended(child)
        # Before the program has set its handlers a signal ends it as any other.
        assert status in (0, ENDS[stop], -stop)
        found.append((whole(out), status))
        assert (out / "notes.txt").read_text() == "mine"
        assert ended(started(command)) == 0  # what was left is no obstacle
        assert whole(out) == NEW.case
        assert (out / "notes.txt").read_text() == "mine"
        assert (out / "report.html").exists()
        assert not list(tmp_path.glob(".frictionjax*"))
    assert all(case == NEW.case for case, status in found if status == 0)
    assert {case for case, _ in found} <= {OLD.case, NEW.case}
    if moments > len(STOPS) ** 2:
        assert {OLD.case, NEW.case} == {case for case, _ in found}


def test_a_second_command_is_refused_before_it_works(tmp_path, command, monkeypatch):
    """It ends with one line; the first one is not disturbed."""
    monkeypatch.setattr(f"{__name__}.WORK", 60.0)
    first = started(command)
    while not list(tmp_path.glob(".frictionjax*")):
        time.sleep(0.01)
    try:
        assert ended(started(command)) == 2
    finally:
        os.kill(first, signal.SIGTERM)
    assert ended(first) == 143
    monkeypatch.setattr(f"{__name__}.WORK", 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FrictionjaxWarning)
        assert ended(started(command)) == 0
    assert whole(tmp_path / "out") == NEW.case


@pytest.mark.parametrize("size", [0, 200, 3000])
def test_a_full_disk_is_one_line_and_keeps_the_earlier_result(tmp_path, command, monkeypatch, size):
    """A limit on the size of files stands for the disk: writing fails in the middle of a file."""
    resource = pytest.importorskip("resource")
    save_diagnosis(OLD, tmp_path / "out", report=False)
    run = program._run

    def limited(*arguments):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        monkeypatch.setattr(tempfile, "tempdir", None)  # a folder for temporary files is looked for anew
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        return run(*arguments)

    monkeypatch.setattr(program, "_run", limited)
    assert ended(started(command)) == 2
    assert whole(tmp_path / "out") == OLD.case
    assert not list(tmp_path.glob(".frictionjax*"))
