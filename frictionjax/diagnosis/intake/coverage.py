"""Effects that cannot be tested with the recordings of a case, since no recording visits the regime they need."""

import numpy as np

from frictionjax.estimation.data.batch import AbstractBatch, noise_level
from frictionjax.physics.effects import (
    AbstractInputEffect,
    AbstractLoadEffect,
    AbstractSensorEffect,
    catalogue,
)
from frictionjax.recordings import Case
from frictionjax.recordings.regimes import find_regimes

_LEAST = 0.002  # part of the time in a regime from which on it counts as visited
_REST = 0.3  # s: rests from which the growth of friction at rest can be identified
_WORDS = {
    "sliding": "no recording slides",
    "presliding": "no recording dwells in presliding",
    "rest": "no recording contains a motion after a rest of 0.3 s",
    "both directions": "no recording moves in both directions",
    "clock": "the recordings have no common clock (start_time) that covers a warm-up",
    "angle": "the position is not an angle in radians",
    "temperature": "a recording lacks the temperature, or the temperature changes by less than 1 K",
}


def missing_needs(case: Case, batch: AbstractBatch) -> dict[str, str]:
    """Each need of an effect (`About.needs`) that the fitted recordings of a `case` do not meet -> what they lack, in
    words. `batch`: all recordings, the fitted ones first.
    """
    noises = batch.position_noise
    noises = [noise_level(r) for r in case.fit_recordings] if noises is None else np.asarray(noises)
    found = [
        find_regimes(r.x, r.sample_rate, float(noise), force=r.force if batch.imposed else None)
        for r, noise in zip(case.fit_recordings, noises, strict=False)
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
        "temperature": _temperature_range(case) >= 1.0,
    }
    return {need: text for need, text in _WORDS.items() if not met[need]}


def _temperature_range(case: Case) -> float:
    """Range of the measured temperatures, K; 0 unless every recording has them."""
    if any(r.temperature is None for r in case.recordings):
        return 0.0
    return float(np.ptp(np.concatenate([np.asarray(r.temperature) for r in case.fit_recordings])))


def not_testable(case: Case, batch: AbstractBatch) -> tuple[dict[str, str], frozenset[str]]:
    """Effects of the catalogue that cannot be tested in any form -> why, in words; and the forms of other effects that
    cannot. `case` and `batch` as in `missing_needs`."""
    lacking = missing_needs(case, batch)
    reasons = idle_effects() if batch.imposed else {}
    barred: set[str] = set()
    for name, forms in catalogue().items():
        why = {form.__name__: [lacking[n] for n in form.about.needs if n in lacking] for form in forms}
        if all(why.values()):
            reasons.setdefault(name, next(iter(why.values()))[0])
        else:
            barred |= {form for form, reason in why.items() if reason}
    return reasons, frozenset(barred)


_IDLE = {
    AbstractInputEffect: "the motion is imposed: no input acts on it",
    AbstractLoadEffect: "the motion is imposed: no inertia acts, nor a load behind a spring or a gap",
    AbstractSensorEffect: "the imposed motion is taken as measured",
}


def idle_effects() -> dict[str, str]:
    """Each effect that cannot act on the friction force of an imposed motion, in any form -> why, in words."""
    reasons = {}
    for name, forms in catalogue().items():
        why = [text for slot, text in _IDLE.items() if all(issubclass(form, slot) for form in forms)]
        if all("motor force" in form.about.needs for form in forms):
            why.append("the motion is imposed: no motor force is measured")
        if why:
            reasons[name] = why[0]
    return reasons
