"""Cases that cannot be diagnosed are refused at once, with a cure."""

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.diagnosis import Effort, diagnose
from frictionjax.diagnosis.intake.starting_point import check
from frictionjax.recordings import Case, Plant, Recording


def _case(*recordings):
    return Case("bench", Plant(), recordings)


def _recording(name, **more):
    return Recording(name, 1000.0, *([np.zeros(300)] * 2), **more)


def test_a_recording_too_short_to_be_scored_is_refused_with_a_cure():
    short = Recording("b", 1000.0, np.zeros(150), np.zeros(150))
    with pytest.raises(InputError, match=r"bench, recording b: 150 samples are too few.*at least 200"):
        diagnose(_case(_recording("a"), short, _recording("c", role="holdout")))


@pytest.mark.parametrize("roles", [("fit", "fit"), ("holdout", "holdout"), ()])
def test_a_case_without_both_roles_is_refused(roles):
    case = _case(*(_recording(f"r{k}", role=role) for k, role in enumerate(roles)))
    with pytest.raises(InputError, match=r'at least one held-out recording.*role = "holdout"'):
        diagnose(case)


def test_a_case_whose_runs_would_take_for_ever_is_refused_with_a_cure():
    """Time in ms that is read as s: a thousand integration steps a sample."""
    moves = np.arange(4000) % 7.0
    slow = (Recording(f"r{k}", 1.0, moves, moves, role=role) for k, role in enumerate(("fit", "holdout")))
    case = _case(*slow)
    with pytest.raises(InputError, match=r"at 1 Hz, takes 8e\+06 integration steps.*in ms.*longest_run"):
        diagnose(case)
    check(case, effort=Effort(longest_run=8_000_000))


def test_two_recordings_of_one_name_are_refused():
    case = _case(*(_recording("run", role=role) for role in ("fit", "holdout")))
    with pytest.raises(InputError, match="two recordings have the name run"):
        diagnose(case)
