"""What these recordings cannot show: effects that need a regime which no recording visits."""

import numpy as np

from frictionjax.estimation.batch import Batch
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Case
from frictionjax.recordings.regimes import find_regimes

_LEAST = 0.002  # part of the time that a regime must take to count as visited
_REST = 0.3  # s: rests that tell how friction grows at rest
_WORDS = {
    "sliding": "no recording slides",
    "presliding": "no recording dwells in presliding",
    "rest": "no recording goes on after a rest of 0.3 s",
    "both directions": "no recording moves in both directions",
    "clock": "the recordings share no clock (start_time) that covers a warm-up",
    "angle": "the position is no angle in radians",
}


def missing_needs(case: Case, batch: Batch) -> dict[str, str]:
    """Need of an effect (`About.needs`) that the fitted recordings of `case` do not meet -> what they lack, in words.

    `batch` holds the recordings, the fitted ones first.
    """
    found = [
        find_regimes(r.x, r.sample_rate, float(noise))
        for r, noise in zip(case.fit_recordings, np.asarray(batch.noise), strict=False)
    ]
    starts = {r.start_time for r in case.fit_recordings}
    span = max(r.start_time + r.duration for r in case.fit_recordings) - min(starts)
    met = {
        "sliding": any(one.sliding > _LEAST for one in found),
        "presliding": any(one.presliding > _LEAST for one in found),
        "rest": any(rest > _REST for one in found for rest in one.rests) or len(starts) > 1,
        "both directions": any(np.ptp(r.x) > 0.0 for r in case.fit_recordings),
        "clock": len(starts) > 1 or span > 10.0,
        "angle": case.plant.position_unit.strip().lower() in ("rad", "radian", "radians"),
    }
    return {need: text for need, text in _WORDS.items() if not met[need]}


def not_testable(case: Case, batch: Batch) -> dict[str, str]:
    """Effect of the catalogue that the recordings cannot show -> why, in words; arguments as in `missing_needs`."""
    lacking = missing_needs(case, batch)
    reasons = {}
    for name, forms in catalogue().items():
        why = [lacking[need] for form in forms for need in form.about.needs if need in lacking]
        if why:
            reasons[name] = why[0]
    return reasons
