"""Effects that cannot be tested with the recordings of a case, since no recording visits the regime they need."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch, noise_level
from frictionjax.physics.effects import (
    AbstractInputEffect,
    AbstractLoadEffect,
    AbstractSensorEffect,
    catalogue,
)
from frictionjax.recordings import Case
from frictionjax.recordings.regimes import find_regimes
from frictionjax.recordings.units import turn_of

_WORDS = {
    "sliding": "no recording slides",
    "presliding": "no recording dwells in presliding",
    "rest": "no recording contains a motion after a rest of {rest:g} s",
    "both directions": "no recording moves in both directions",
    "clock": "the recordings have no common clock (start_time) that covers a warm-up",
    "angle": "the unit of the position is not one of an angle",
    "temperature": "a recording lacks the temperature, or the temperature changes by less than {warmer:g} K",
}


class Coverage(NamedTuple):
    """What the fitted recordings of a case contain.

    **Attributes:** `sliding`, `presliding` (largest part of the time of a recording), `rests` (their durations, s),
    `starts` (number of different starting times), `span` (from the first start to the last end, s), `moves` (whether
    any position changes), `unit` of the position, `warmer` (range of the measured temperature, K).
    """

    sliding: float
    presliding: float
    rests: tuple[float, ...]
    starts: int
    span: float
    moves: bool
    unit: str
    warmer: float

    def meets(self, rule: Rule) -> dict[str, bool]:
        """Each need of an effect -> whether it is met, by the `rule`."""
        least = rule.testable
        return {
            "sliding": self.sliding > least.regime,
            "presliding": self.presliding > least.regime,
            "rest": any(rest > least.rest for rest in self.rests) or self.starts > 1,
            "both directions": self.moves,
            "clock": self.starts > 1 or self.span > least.warm_up,
            "angle": turn_of(self.unit) is not None,
            "temperature": self.warmer >= least.warmer,
        }


def missing_needs(case: Case, batch: AbstractBatch, *, rule: Rule = Rule()) -> dict[str, str]:
    """Each need of an effect (`About.needs`) that the fitted recordings of a `case` do not meet -> what they lack, in
    words. `batch`: all recordings, the fitted ones first; `rule`: when a need is met.
    """
    return _lacking(_coverage_of(case, batch.position_noise, batch.imposed), rule)


def _lacking(found: Coverage, rule: Rule) -> dict[str, str]:
    met, numbers = found.meets(rule), dataclasses.asdict(rule.testable)
    return {need: text.format(**numbers) for need, text in _WORDS.items() if not met[need]}


def _coverage_of(case: Case, position_noise: Float[Numbers, " r"] | None, imposed: bool) -> Coverage:
    """What the fitted recordings of the `case` contain; `position_noise` (standard deviation, position units, shape
    `(r,)`, None: found from the data) and whether the motion is `imposed`."""
    unit = case.plant.position_unit
    noises = (
        [noise_level(r) for r in case.fit_recordings]
        if position_noise is None
        else np.asarray(position_noise)
    )
    found = [
        find_regimes(r.x, r.sample_rate, float(noise), force=r.force if imposed else None, unit=unit)
        for r, noise in zip(case.fit_recordings, noises, strict=False)
    ]
    starts = {r.start_time for r in case.fit_recordings}
    span = max(r.start_time + r.duration for r in case.fit_recordings) - min(starts)
    return Coverage(
        sliding=max((float(one.sliding) for one in found), default=0.0),
        presliding=max((float(one.presliding) for one in found), default=0.0),
        rests=tuple(float(rest) for one in found for rest in one.rests),
        starts=len(starts),
        span=float(span),
        moves=any(np.ptp(r.x) > 0.0 for r in case.fit_recordings),
        unit=unit,
        warmer=_temperature_range(case),
    )


def _temperature_range(case: Case) -> float:
    """Range of the measured temperatures, K; 0 unless every recording has them."""
    if any(r.temperature is None for r in case.recordings):
        return 0.0
    return float(np.ptp(np.concatenate([np.asarray(r.temperature) for r in case.fit_recordings])))


def not_testable(
    case: Case, batch: AbstractBatch, *, rule: Rule = Rule()
) -> tuple[dict[str, str], frozenset[str]]:
    """Effects of the catalogue that cannot be tested in any form -> why, in words; and the forms of other effects that
    cannot. `case`, `batch` and `rule` as in `missing_needs`."""
    return _without(missing_needs(case, batch, rule=rule), batch.imposed)


def not_shown(case: Case, *, rule: Rule = Rule()) -> dict[str, str]:
    """Effects of the catalogue that the fitted recordings of a `case` cannot show in any form -> why, in words; found
    from the recordings alone, before anything is fitted. `rule`: when a need is met."""
    imposed = any(recording.drive == "motion" for recording in case.recordings)
    return _without(_lacking(_coverage_of(case, None, imposed), rule), imposed)[0]


def _without(lacking: dict[str, str], imposed: bool) -> tuple[dict[str, str], frozenset[str]]:
    """Effects that are not testable -> why, and forms of others that are not, from the needs that are `lacking`."""
    reasons = idle_effects() if imposed else {}
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
