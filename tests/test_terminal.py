"""What a user sees while the program loads and works."""

import os
import select
import subprocess
import sys
import threading

from frictionjax.cli import terminal


def test_a_terminal_of_no_size_shows_seconds_that_pass(monkeypatch):
    """As in many containers: a bar that is as wide and high as such a terminal is none."""
    reader, writer = os.openpty()
    monkeypatch.setattr(terminal, "_SECOND", 0.01)
    with os.fdopen(writer, "w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        shown = terminal.Terminal()
        shown.starting()
        printed = b""
        while printed.count(b"loading") < 5:  # the stage stays, the bar moves
            assert select.select([reader], [], [], 60.0)[0], printed
            printed += os.read(reader, 4096)
        shown.close()
        assert not [one for one in threading.enumerate() if one is shown._moving]
    os.close(reader)


def test_parts_of_scipy_that_take_a_second_are_loaded_when_they_are_needed():
    code = """
import sys
import frictionjax.diagnosis.diagnose, frictionjax.report.page
loaded = {"scipy.signal", "scipy.stats", "diffrax", "optimistix"} & set(sys.modules)
assert not loaded, loaded
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


HEAVY = (
    "frictionjax.diagnosis.diagnose",
    "frictionjax.diagnosis.screening",
    "frictionjax.diagnosis.refitting",
    "frictionjax.diagnosis.selection",
    "frictionjax.estimation.descent",
    "frictionjax.estimation.fit",
    "frictionjax.report.page",
    "frictionjax.studies",
    "frictionjax.paper",
    "frictionjax.arm",
    "scipy.signal",
    "scipy.stats",
)
"""What `check` needs none of, and takes long to load."""


def test_check_loads_nothing_that_diagnoses(tmp_path):
    rows = (f"{k / 500.0!r},{(k % 7) - 3},{1e-3 * ((k % 50) - 25) ** 2}" for k in range(900))
    (tmp_path / "run.csv").write_text("\n".join(["t,u,x [deg]", *rows]))
    code = f"""
import sys
from frictionjax.cli import main
assert main(["check", "run.csv"]) == 0
print(sorted(set({HEAVY!r}) & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert "The noise of x is" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"
