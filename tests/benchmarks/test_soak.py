"""Cases of many structures in one process: each is simulated, and the programs that are held stay few."""

import pytest

from benchmarks import soak
from benchmarks.soak import drive_with, main, structures
from frictionjax.core import programs
from frictionjax.core.programs import forget_programs


def test_structures_differ_and_are_known_by_their_seed():
    found = structures(50, 0)
    assert len({str([type(one) for one in drive_with(names).effects]) for names in found}) > 40
    assert found == structures(50, 0)
    assert found != structures(50, 1)


@pytest.mark.slow
def test_the_programs_of_many_structures_stay_few(monkeypatch, capsys):
    monkeypatch.setattr(programs, "_MOST_STRUCTURES", 1)
    monkeypatch.setattr(soak, "SAMPLES", 50)
    monkeypatch.setattr(soak.fj, "configure_jax", lambda: None)
    forget_programs()
    assert main(["--cases", "2"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[0] for row in rows] == ["cases", "1", "2"]
    assert [row[1] for row in rows[1:]] == ["1", "1"]
