"""`benchmarks.base_fits`: it counts a fit that came to rest elsewhere, and prints a line for each family."""

import pytest

pytest.importorskip("numba")

from benchmarks import base_fits
from benchmarks.base_fits import Ended


def test_a_fit_that_misfits_more_than_the_one_from_the_truth_is_elsewhere():
    assert Ended(0.01, 0.0, True).found
    assert Ended(-0.3, 0.0, True).found
    assert not Ended(0.3, 0.0, False).found


def test_a_line_for_each_family(monkeypatch, capsys):
    ended = iter(
        [Ended(0.001, 0.0, True), Ended(0.5, 0.1, False), Ended(0.0, 0.0, True), Ended(0.0, 0.0, True)]
    )
    monkeypatch.setattr(base_fits, "fitted", lambda seed, family: next(ended))
    monkeypatch.setattr("sys.argv", ["base_fits", "--families", "presliding", "odd", "--machines", "2"])
    base_fits.main()
    rows = capsys.readouterr().out.splitlines()[2:]
    assert rows == ["| presliding | 1 of 2 | 1 of 2 | 0.400 |", "| odd | 2 of 2 | 2 of 2 | 0.000 |"]


@pytest.mark.slow
def test_a_machine_in_presliding_is_fitted_from_its_recordings_alone():
    ended = base_fits.fitted(910001, "presliding")
    assert ended.found
    assert ended.credible
