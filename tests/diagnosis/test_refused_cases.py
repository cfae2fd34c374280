"""Cases that cannot be diagnosed are refused at once, with a cure."""

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.diagnosis import diagnose
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
