"""How much a free force would explain, as a table."""

import pytest
from helpers_estimation import small_case

import frictionjax as fj
from benchmarks import ceiling


def test_a_case_with_nothing_missing_has_a_row_and_nothing_above_it(monkeypatch, capsys):
    monkeypatch.setattr(fj, "configure_jax", lambda: None)
    monkeypatch.setattr(fj, "load_case", lambda path: small_case(seconds=2.2))
    ceiling.main(["small.toml"])
    row = capsys.readouterr().out.splitlines()[2].split("|")
    assert row[1].strip() == "small" and row[7].strip() == "no"
    assert float(row[2]) == pytest.approx(0.0, abs=0.02)
