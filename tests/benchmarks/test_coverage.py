"""Intervals and p-values of the diagnosis against machines of another simulator."""

import numpy as np
import pytest

pytest.importorskip("numba")

from benchmarks import null_p_values
from benchmarks.coverage import errors, size_errors


@pytest.mark.slow
def test_errors_are_as_large_as_their_standard_errors_say():
    """Five machines, seven parameters each: a chi-square, of parameters that are correlated within a machine."""
    coarse, fine = (
        np.array([list(one.values()) for one in some])
        for some in zip(*map(errors, range(1400, 1405)), strict=True)
    )
    assert np.mean(fine**2) < 2.5
    assert np.mean(np.abs(fine) < 1.96) > 0.85
    assert np.mean(fine**2) < np.mean(coarse**2)


@pytest.mark.slow
def test_the_error_of_a_size_is_as_large_as_its_standard_error_says():
    """Three machines with a constant load; of an asymmetry that is viscous, too, the size does not compare."""
    found = [size_errors(seed, "constant_load") for seed in range(1400, 1403)]
    assert all(pair is not None and max(np.abs(pair)) < 4.0 for pair in found)
    drawn = [size_errors(seed, "direction_asymmetry") for seed in (1400, 1401, 1402)]
    assert None in drawn


def test_p_values_are_counted_over_tests_and_machines(monkeypatch, capsys):
    """One machine with a p-value of 2e-4 for one of two effects: 4e-4 after Bonferroni."""
    told = {
        1100: ([0.5, 2e-4], {"creep": 0.5, "delay": 2e-4}),
        1101: ([0.04, 0.9], {"creep": 0.04, "delay": 0.9}),
    }
    monkeypatch.setattr(null_p_values, "p_values", lambda seed, executor: told[seed])
    monkeypatch.setattr("sys.argv", ["null_p_values", "--machines", "2"])
    null_p_values.main()
    rows = capsys.readouterr().out.splitlines()[2:]
    assert rows == ["| 0.05 | 50.0 % | 1 of 2 |", "| 0.01 | 25.0 % | 1 of 2 |", "| 0.001 | 25.0 % | 1 of 2 |"]
