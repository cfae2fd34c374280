"""Intervals of the diagnosis against machines of another simulator."""

import numpy as np
import pytest

pytest.importorskip("numba")

from benchmarks.coverage import errors


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
