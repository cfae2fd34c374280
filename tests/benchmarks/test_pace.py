"""How fast recordings are observed, as a table."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import small_case

from benchmarks.pace import rows


def _coarse(case, step):
    plant = dataclasses.replace(case.plant, encoder_step=step)
    recordings = tuple(
        dataclasses.replace(one, x=np.round(one.x / step) * step)
        for one in case.recordings
        if np.ptp(one.x) > 100 * step
    )
    return dataclasses.replace(case, plant=plant, recordings=recordings)


def test_a_fine_sensor_is_observed_at_the_usual_bandwidth_and_a_coarse_one_slower():
    case = small_case()
    fine, coarse = rows(case), rows(_coarse(case, 1e-4))
    assert [row[0] for row in fine] == [one.name for one in case.recordings]
    assert {row[3] for row in fine} == {50.0}
    assert all(row[1] == pytest.approx(1e-4 / np.sqrt(12.0), rel=0.5) for row in coarse)
    assert all(row[2] <= row[3] < 50.0 for row in coarse)
