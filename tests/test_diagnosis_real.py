"""Real machines, where their recordings are beside the repository."""

from pathlib import Path

import numpy as np
import pytest

from frictionjax.diagnosis import diagnose
from frictionjax.recordings import load_case

REAL = Path(__file__).parents[2] / "shared" / "real"


def _case(name):
    file = REAL / name / "case.toml"
    if not file.is_file():
        pytest.skip(f"The recordings of {name} are not beside the repository.")
    return load_case(file)


@pytest.mark.slow
def test_the_motor_bench_has_a_second_inertia_behind_a_spring():
    """A dip near 50 Hz and a peak near 70 to 77 Hz in the response of the motor."""
    found = diagnose(_case("motor_bench"))
    assert found.missing[0].effect == "flexible_transmission"
    ratio, frequency = (found.extended[name].value for name in ("ratio", "frequency"))
    assert frequency == pytest.approx(52.0, abs=4.0)
    assert frequency / np.sqrt(1.0 - ratio) == pytest.approx(74.0, abs=4.0)
