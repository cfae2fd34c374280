"""A run that is killed, asked to end or interrupted at any of its steps leaves the earlier result or the new one."""

import json
import multiprocessing
import os
import signal
import sys
import warnings

import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis, fake_recording

from frictionjax.cli.program import _terminable
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.report import replace, save, save_diagnosis
from frictionjax.report.claim import claimed

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied here by fork")

STEPS = {"os.rename", "os.link", "os.mkdir", "os.remove", "os.rmdir", "frictionjax.exchange"}
MINE = {"notes.txt": "mine", "fit/mine.csv": "a,b\n1,2\n"}
"""Files of the user beside a result."""


def _small(diagnosis, names):
    recordings = tuple(fake_recording(name, n=30) for name in names)
    return diagnosis.__class__(**{**vars(diagnosis), "recordings": recordings})


OLD = _small(adequate_diagnosis(), ("only", "both"))
NEW = _small(fake_diagnosis(n=30), ("both", "other"))


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    def write(diagnosis, directory):
        (directory / "report.html").write_text(diagnosis.case)

    monkeypatch.setattr(save, "write_report", write)


def in_a_copy(act):
    """The exit status of a copy of this process that does `act`; negative: the signal that ended it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of JAX, with which the copy computes nothing
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        status = 99
        try:
            act()
            status = 0
        except KeyboardInterrupt:
            status = 3
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def stopping(step, number):
    """Save the new result, but at step `number` send this process the signal `step`."""
    count = [0]

    def act(folder):
        def hook(event, args):
            if event in STEPS:
                count[0] += 1
                if count[0] == number:
                    os.kill(os.getpid(), step)

        sys.addaudithook(hook)
        # A shell that runs tests in the background has Ctrl-C ignored, and its processes inherit that.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with _terminable():
            save_diagnosis(NEW, folder)

    return act


def whole(folder):
    """The case of the result in a folder, whose files are all of one run; None without one."""
    if not (folder / "verdict.json").exists():
        return None
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    assert json.loads((folder / "comparisons.json").read_text())["case"] == verdict["case"]
    fits = {f"fit/{path.name}" for path in (folder / "fit").iterdir()} - set(MINE)
    assert fits == {fit["file"] for fit in verdict["fit"].values()}
    if (folder / "report.html").exists():
        assert (folder / "report.html").read_text() == verdict["case"]
    return verdict["case"]


def prepared(folder, kind):
    """An output folder: new, with an earlier result, or with a folder of the user beside it, which stays in place."""
    if kind == "new":
        return folder / "deep" / "out"
    out = folder / "out"
    save_diagnosis(OLD, out)
    for name, text in MINE.items():
        (out / name).write_text(text)
    if kind == "with a folder":
        (out / "mine").mkdir()
    return out


@pytest.mark.parametrize(
    ("kind", "stop"),
    [
        *(("new", stop) for stop in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)),
        *(("earlier", stop) for stop in (signal.SIGKILL, signal.SIGTERM)),
        ("with a folder", signal.SIGKILL),
    ],
)
def test_a_process_that_is_stopped_at_any_step(tmp_path, kind, stop):
    found = set()
    for number in range(1, 200):
        folder = tmp_path / str(number)
        folder.mkdir()
        out = prepared(folder, kind)
        status = in_a_copy(lambda: stopping(stop, number)(out))  # noqa: B023
        left = whole(out)
        assert left is not None or kind != "earlier"
        found.add(left)
        if stop == signal.SIGKILL and status:
            assert status == -signal.SIGKILL
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FrictionjaxWarning)
                with claimed(out):  # the next run
                    after = whole(out)
                    assert after in (left, "arm-2024-03")
                    assert after is not None or kind == "new"
        else:
            assert status in (0, 3)
        if kind != "new":
            assert {name: (out / name).read_text() for name in MINE} == MINE
        assert not list(folder.rglob(".frictionjax*"))
        if not status:
            break
    assert number > 12
    assert {"arm-2024-03", None if kind == "new" else "bench"} <= found


def test_the_folder_is_exchanged_as_a_whole_or_stays(tmp_path):
    """One with a folder of the user in it, from whose inside somebody may look, remains the folder that it is."""
    kept = prepared(tmp_path / "kept", "with a folder")
    before = kept.stat().st_ino
    save_diagnosis(NEW, kept)
    assert kept.stat().st_ino == before
    if replace.exchange(*_two(tmp_path)):
        swapped = prepared(tmp_path / "swapped", "earlier")
        before = swapped.stat().st_ino
        save_diagnosis(NEW, swapped)
        assert swapped.stat().st_ino != before


def _two(folder):
    for name in ("one", "other"):
        (folder / name).mkdir()
    return folder / "one", folder / "other"


def test_the_working_directory_stays_in_place(tmp_path, monkeypatch):
    out = prepared(tmp_path, "earlier")
    monkeypatch.chdir(out)
    before = out.stat().st_ino
    save_diagnosis(NEW, ".")
    assert out.stat().st_ino == before
    assert whole(out) == "arm-2024-03"


@pytest.mark.parametrize("kind", ["new", "with a folder"])
def test_a_failure_while_moving_puts_the_earlier_result_back(tmp_path, monkeypatch, kind):
    out = prepared(tmp_path, kind)
    before = whole(out)
    rename = type(tmp_path).rename

    def failing(self, target):
        if (self.parent.name == "new" and self.name == "verdict.json") or self.name == "new":
            raise OSError(28, "No space left on device", str(self))
        return rename(self, target)

    monkeypatch.setattr(type(tmp_path), "rename", failing)
    with pytest.raises(InputError, match="No space left on device"):
        save_diagnosis(NEW, out)
    assert whole(out) == before
    assert not list(tmp_path.rglob(".frictionjax*"))


def test_a_second_writer_is_refused_before_its_work(tmp_path):
    out = tmp_path / "deep" / "out"
    ready, leave = multiprocessing.Event(), multiprocessing.Event()

    def first():
        with save.reserved(out):
            ready.set()
            leave.wait()

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX, with which the copy computes nothing
        other = multiprocessing.get_context("fork").Process(target=first)
        other.start()
    ready.wait()
    with pytest.raises(InputError, match="another run is writing into this directory"), save.reserved(out):
        raise AssertionError("two writers")
    with pytest.raises(InputError, match="another run"):
        save_diagnosis(NEW, out)
    leave.set()
    other.join()
    assert not list(tmp_path.iterdir())
    save_diagnosis(NEW, out)
    assert whole(out) == "arm-2024-03"


def test_a_claim_may_be_taken_again_by_its_owner(tmp_path):
    with save.reserved(tmp_path / "out"):
        save_diagnosis(NEW, tmp_path / "out")
    assert whole(tmp_path / "out") == "arm-2024-03"


def test_a_full_disk_leaves_the_earlier_result_and_a_copy_elsewhere(tmp_path, monkeypatch):
    out = prepared(tmp_path, "earlier")

    def full(recording, file):
        raise OSError(28, "No space left on device", str(file))

    with monkeypatch.context() as patch:
        patch.setattr(save, "write_fit_csv", full)
        with pytest.raises(InputError, match="No space left on device"):
            save_diagnosis(NEW, out)
    assert whole(out) == "bench"
    assert not list(tmp_path.rglob(".frictionjax*"))
    monkeypatch.setattr(save.tempfile, "tempdir", str(tmp_path))
    assert whole(save.rescue_diagnosis(NEW)) == "arm-2024-03"
