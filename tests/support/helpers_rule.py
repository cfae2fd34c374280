"""One decision or more for each number of the rule, by hand-made comparisons: on either side of the number.

`PROBES`: name of the number -> decisions, each a function of the rule and what it says by the rule of today. Where the
number changes by a half, one of its decisions changes.
"""

import dataclasses
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from frictionjax.diagnosis.base_model.credibility import Credibility, energy_and_lead
from frictionjax.diagnosis.evidence.input_needed import INPUT, input_is_needed
from frictionjax.diagnosis.evidence.judgement import energy_explained
from frictionjax.diagnosis.evidence.noise_floor import (
    Answer,
    beyond_chance,
    capped,
    colour,
    force_noise,
    gap_force,
    is_predictable,
)
from frictionjax.diagnosis.findings.residual_map import helps
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.intake.checks import is_motion
from frictionjax.diagnosis.intake.coverage import Coverage
from frictionjax.diagnosis.mismatch_map.axes import MapAxis
from frictionjax.diagnosis.mismatch_map.conditions import (
    is_a_part,
    is_condition,
    is_only,
    more_power,
    parts_within,
)
from frictionjax.diagnosis.mismatch_map.where_words import lead_of, stands_out, where_words
from frictionjax.diagnosis.recording_fit import Unmeasured
from frictionjax.diagnosis.refitting.refitted import ease_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import acceptable, choose, only_complete
from frictionjax.diagnosis.selection.candidate_table import excused_floor, may_excuse
from frictionjax.diagnosis.selection.conclusion import is_above
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.verdict_rule import adequate, verdict_of
from frictionjax.diagnosis.table import ComparisonTable, Improvement, Lead, ModelComparison, OtherDecision
from frictionjax.diagnosis.verdict import MismatchBin, Unexplained, Within

Probe = tuple[Callable[[Rule], Any], Any]


def answer(probe: Callable[[Rule], Any], rule: Rule) -> Any:
    """What a `probe` says by the `rule`; an error in words, for a rule that makes no sense."""
    try:
        return probe(rule)
    except ValueError as error:
        return str(error)


def row(
    shares=(0.9, 0.9), *, before=(0.4, 0.4), energies=(0.0, 0.0), leads=(9.0, 9.0), **more
) -> ModelComparison:
    """A candidate that explains these `shares` of the misfits `before`, on fitted and on held-out recordings."""
    after = tuple(misfit * (1.0 - share) for misfit, share in zip(before, shares, strict=True))
    fit, held = (Lead(lead, 1.0, 100) for lead in leads)
    known = {"before": (), "after": ("Form",), "effect": "effect", "form": "Form", "exact": (False,)}
    known |= {"misfit_errors": (0.0, 0.0), "energies": energies, "fit": fit, "held_out": held}
    return ModelComparison(misfits_before=before, misfits_after=after, **(known | more))


def candidate(
    shares=(0.0, 0.0), *, before=(0.4, 0.4), leads=(3.0, 3.0), p_value=1e-6, **more
) -> ModelComparison:
    """The same by shares as a rule counts them: of a misfit that is adequate, where the other set's is not, against
    what would be adequate."""
    adequate = Rule().limits.adequate
    whole = tuple(max(misfit, adequate if max(before) > adequate else 0.0) for misfit in before)
    after = row(shares, before=whole).misfits_after
    made = row(shares, before=before, leads=leads, **({"effect": "effect 0", "p_value": p_value} | more))
    return dataclasses.replace(made, misfits_after=after)


def table(*rows: ModelComparison, misfits=(0.4, 0.4), lead=9.0, **more) -> ComparisonTable:
    """The `rows` as candidates beside a base model that leaves these `misfits`; each leads those after it by so many
    standard errors, `lead`."""
    known = {"key": "t0", "asked": ("candidates", "0"), "before": (), "misfit_errors": (0.0, 0.0)}
    pairs = [(one, other) for one in range(len(rows)) for other in range(one + 1, len(rows))]
    between = tuple((one, other, Lead(lead, 1.0, 100)) for one, other in pairs)
    return ComparisonTable(
        **(known | {"misfits": misfits, "chaotic": False, "rows": rows, "between": between} | more)
    )


def _accepts(**more):
    own = row(**more)
    return lambda rule: acceptable(own, rule)[0]


def _rivals(lead):
    both = row(effect="one"), row((0.8, 0.8), effect="other")
    return lambda rule: choose(table(*both, lead=lead), rule).rivals


def _verdict(left, *exact):
    # Far from the noise: what is left is significant whatever its share.
    whole = row((1.0 - left, 1.0 - left), before=(2.0, 2.0), exact=exact)
    return lambda rule: verdict_of([Round(table(whole), 0)], whole, rule=rule)[0]


def _remains(left):
    whole = row((1.0 - left / 0.4, 1.0 - left / 0.4))
    return lambda rule: verdict_of([Round(table(whole), 0)], whole, rule=rule)[1][0]


def _meets(need, **more):
    nothing = Coverage(0.0, 0.0, (), 1, 0.0, False, "m", 0.0)
    return lambda rule: nothing._replace(**more).meets(rule)[need]


def _powers(*values):
    """The energy that a model explains in blocks of these powers with no model and with it."""
    none, fitted = (np.array([numbers], float) for numbers in zip(*values, strict=True))
    return lambda rule: round(energy_and_lead(none, fitted, np.ones_like(none), rule)[0], 6)


def _lead_of_clusters(count):
    none = 3.0 + np.arange(10.0 * count)[None, :] % 7.0
    return lambda rule: energy_and_lead(none, np.ones_like(none), np.ones_like(none), rule)[1] > 0.0


def _bin(axis, label, share, excess, count=1000, p_value=0.001):
    return MismatchBin(axis, label, share, excess, 1.0, count, p_value)


REGIMES = (_bin("regime", "sliding", 0.9, 12.0), _bin("regime", "stick", 0.1, 1.3))


def _sharp(share, count):
    """Whether a bin of the position that holds this share of the excess in so many of 1000 samples leads."""
    bins = (
        *REGIMES,
        _bin("position", "here", share, 9.0, count),
        _bin("position", "there", 0.1, 1.1, 1000 - count),
    )
    return lambda rule: next((one.axis for one in lead_of(bins, rule=rule)), "")


def _regimes(*excesses):
    return tuple(_bin("regime", f"regime {k}", 1.0 / 3.0, excess) for k, excess in enumerate(excesses))


def _condition(share, excess, elsewhere):
    part = Within("time", "early", "early", "sliding", share, 0.3, excess, elsewhere, 1e-9)
    return lambda rule: is_condition(part, 1, rule)


def _force(gain, asked):
    """The unmeasured force that blocks of this `gain` ask for, each the square of its own."""
    gain, asked = np.array([gain], float), np.array([asked], float)
    ones = np.ones((1, *gain.shape))
    found = Answer(gain, ones[0], ones, gain[None], 0.0 * ones)
    posterior = SimpleNamespace(batch=SimpleNamespace(block_count=np.ones_like(gain)), fitted=(np.ones(1),))
    return lambda rule: round(force_noise(1.0 + gain * asked**2, found, posterior, rule=rule), 7)


def _energy(rule):
    before = np.where(np.arange(100) < 4, 1000.0, np.where(np.arange(100) < 50, 11.0, 1.0)) * np.ones((2, 1))
    after = np.where(before > 100.0, 1000.0, 1.0)
    batch = SimpleNamespace(block_count=np.ones_like(before))
    held = np.array([False, True])
    models = (SimpleNamespace(power=power, held_out=held, batch=batch) for power in (before, after))
    return tuple(round(share, 6) for share in energy_explained(*models, np.ones((2, 1)), rule=rule))


def _excused(rule):
    power = np.full((1, 4), 20.0)

    def misfits(floor):
        return (float(np.mean(0.5 * np.log((power / floor + 1.0) / 2.0))),) * 2

    before = SimpleNamespace(power=power, misfits=misfits)
    return float(excused_floor(before, np.ones((1, 4)), power, rule=rule)[0, 0])


def _colour(rule):
    posterior = SimpleNamespace(batch=SimpleNamespace(block_count=np.ones((1, 5))))
    return float(colour(np.full((1, 5), 9.0), np.ones((1, 5)), posterior, rule=rule)[0, 0])


@functools.cache
def _places():
    """Power that is high in one half of each of three axes alone, one inside the other; 64 clusters of 64 samples."""
    rng, sample = np.random.default_rng(3), np.arange(4096)
    cluster = sample // 64
    halves = [(cluster >> bit) % 2 for bit in range(3)]
    power = np.where(halves[0] * halves[1] * halves[2] > 0, 40.0, 1.0)
    power = power + np.where(halves[0] * halves[1] > 0, 6.0, 0.0) + np.where(halves[0] > 0, 1.5, 0.0)
    power = (power * (0.8 + 0.4 * rng.random(4096)))[None, :]
    axes = tuple(
        MapAxis(name, ("low", "high"), ("low", "high"), half[None, :])
        for name, half in zip(("time", "input", "position"), halves, strict=True)
    )
    regime = MapAxis("regime", ("all",), ("all",), np.zeros((1, 4096), int))
    scene = SimpleNamespace(batch=SimpleNamespace(valid=np.ones((1, 4096)), block=64 // 10))
    return (*axes, regime), power, scene


def _parts(rule):
    axes, power, scene = _places()
    return len(parts_within((_bin("regime", "all", 1.0, 5.0),), axes, power, scene, rule=rule))


def _clusters(count):
    cluster = np.repeat(np.arange(2 * count), 10)
    here, level = cluster % 2 == 0, 1.0 + 0.1 * (cluster % 3)
    return lambda rule: more_power(np.where(here, 5.0, 1.0) * level, here, cluster, rule) is not None


def _beside(candidate):
    """Which row is accepted of a table with one `candidate` for a second name."""
    own = table(candidate, asked=("candidates", "1", "t0.0"))
    return lambda rule: choose(own, rule).accepted


def _waves(count, beside):
    return _accepts(waves=((count, beside),))


_BLOCKS = (20, 40, 140)  # that answer much to a force, a little, and hardly


_ERROR_OF_GROWTH = np.sqrt(2.0 / (4 * 5 * 100))  # of four simulations, five blocks of 100 samples each


def _grown(growth: float, rule: Rule) -> bool:
    return beyond_chance(np.array([[growth]]), np.array([[100.0]]), rule).item() != 1.0


def _needs_input(without: float, rule: Rule) -> bool:
    return input_is_needed(OtherDecision(INPUT, {"error": 1.0, "error_without_input": without}), rule)


def _noise_is_stated(part: float) -> Callable[[Rule], bool]:
    """Whether the sentence of `adequate` states an unmeasured force of this `part` of the applied one."""
    force = Unmeasured(0.1, 0.5, part)
    return lambda rule: (
        "unmeasured force"
        in summary_sentence("adequate", (), Unexplained(False, 0.0, ""), "", (), force, "N*m", rule=rule)
    )


PROBES: dict[str, list[Probe]] = {
    "floor.quantile": [(_force(np.ones(101), np.linspace(1e-3, 3e-3, 101)), 0.0018)],
    "floor.answering": [
        (_force(np.repeat((1.0, 0.12, 0.07), _BLOCKS), np.repeat((1e-3, 2e-3, 4e-3), _BLOCKS)), 0.002)
    ],
    "floor.largest_force": [(_force(np.ones(9), np.ones(9)), 0.005)],
    "floor.colour": [(_colour, 2.0)],
    "floor.chance": [
        (lambda rule: _grown(1.0 + 3.5 * _ERROR_OF_GROWTH, rule), False),
        (lambda rule: _grown(1.0 + 4.5 * _ERROR_OF_GROWTH, rule), True),
    ],
    "floor.cap": [(lambda rule: float(capped(np.array([[1.0, 1.0, 1.0, 100.0]]), rule).max()), 20.0)],
    "floor.unpredictable": [
        (lambda rule: is_predictable(np.array([[0.7, 1.2]]), rule).tolist(), [[True, False]])
    ],
    "floor.gap_force": [(lambda rule: gap_force(1e-4, rule), 5e-4)],
    "floor.excuse_share": [
        (lambda rule: may_excuse((0.4, 0.9), rule), False),
        (lambda rule: may_excuse((0.5, 0.9), rule), True),
    ],
    "floor.excused_part": [(_excused, 2.5)],
    "floor.ease": [(lambda rule: ease_of(np.array([1000.0]), rule), 10.0)],
    "floor.energy_quantile": [(_energy, (0.92, 0.92))],
    "accept.lead": [(_accepts(leads=(2.0, 2.0)), False), (_accepts(leads=(2.5, 2.5)), True)],
    "accept.lead_each": [(_accepts(leads=(9.0, 0.8)), False), (_accepts(leads=(9.0, 1.2)), True)],
    "accept.least_share": [(_beside(row((0.9, 0.25))), None), (_beside(row((0.35, 0.9))), 0)],
    "accept.enough_share": [
        (lambda rule: only_complete(Round(table(row((0.7, 0.9))), 0), rule).accepted, None),
        (lambda rule: only_complete(Round(table(row((0.9, 0.9))), 0), rule).accepted, 0),
    ],
    "accept.waves": [(_waves(0.8, False), False), (_waves(1.2, False), True)],
    "accept.waves_beside": [(_waves(1.6, True), False), (_waves(2.5, True), True)],
    "accept.least_clusters": [
        (lambda rule: Lead(9.0, 1.0, 3).in_errors(rule), 0.0),
        (lambda rule: Lead(9.0, 1.0, 5).in_errors(rule), 9.0),
    ],
    "rivals.lead": [(_rivals(2.0), ("other",)), (_rivals(3.0), ())],
    "limits.adequate": [
        (lambda rule: adequate((0.007, 0.007), (0.0, 0.0), rule), True),
        (lambda rule: adequate((0.007, 0.012), (0.0, 0.0), rule), False),
    ],
    "limits.sure": [
        (lambda rule: adequate((0.012, 0.012), (1e-3, 1e-3), rule), True),
        (lambda rule: adequate((0.012, 0.014), (1e-3, 1e-3), rule), False),
    ],
    "limits.remains": [(_remains(0.015), False), (_remains(0.025), True)],
    "limits.one_exact": [(_verdict(0.07, True), "named"), (_verdict(0.12, True), "unknown")],
    "limits.several_exact": [(_verdict(0.03, True, True), "named"), (_verdict(0.05, True, True), "unknown")],
    "limits.one": [(_verdict(0.2, False), "named"), (_verdict(0.4, False), "unknown")],
    "limits.several": [(_verdict(0.07, True, False), "named"), (_verdict(0.12, True, False), "unknown")],
    "limits.unmeasured": [(_noise_is_stated(0.012), False), (_noise_is_stated(0.025), True)],
    "credible.energy": [
        (lambda rule: Credibility(0.4, 0.0, ()).is_credible(rule=rule), False),
        (lambda rule: Credibility(0.6, 0.0, ()).is_credible(rule=rule), True),
    ],
    "credible.lead": [
        (lambda rule: Credibility(0.0, 2.0, ()).is_credible(rule=rule), False),
        (lambda rule: Credibility(0.0, 4.0, ()).is_credible(rule=rule), True),
    ],
    "credible.loud": [
        (_powers((1.5, 1.5), (10.0, 1.0)), 1.0),
        (_powers((2.5, 2.5), (10.0, 1.0)), 0.857143),
    ],
    "credible.least_clusters": [(_lead_of_clusters(3), False), (_lead_of_clusters(5), True)],
    "credible.driven": [
        (lambda rule: _needs_input(1.08, rule), False),
        (lambda rule: _needs_input(1.12, rule), True),
    ],
    "testable.regime": [
        (_meets("sliding", sliding=0.0015), False),
        (_meets("presliding", presliding=0.0025), True),
    ],
    "testable.rest": [(_meets("rest", rests=(0.1, 0.2)), False), (_meets("rest", rests=(0.1, 0.4)), True)],
    "testable.warm_up": [(_meets("clock", span=7.0), False), (_meets("clock", span=12.0), True)],
    "testable.warmer": [
        (_meets("temperature", warmer=0.7), False),
        (_meets("temperature", warmer=1.2), True),
    ],
    "testable.still": [
        (lambda rule: is_motion(1.1, 0.0, rule), False),
        (lambda rule: is_motion(1.3, 0.0, rule), True),
    ],
    "testable.drift": [
        (lambda rule: is_motion(0.0, 1.9, rule), False),
        (lambda rule: is_motion(0.0, 2.1, rule), True),
    ],
    "residual.lead": [
        (lambda rule: helps(Improvement(0.0, 0.5, 0.0, 0.0, 0.0, 1.0, True), rule), False),
        (lambda rule: helps(Improvement(0.0, 0.5, 0.0, 0.0, 0.0, 2.0, True), rule), True),
    ],
    "residual.share": [
        (lambda rule: helps(Improvement(0.0, 0.07, 0.0, 0.0, 0.0, 9.0, True), rule), False),
        (lambda rule: helps(Improvement(0.0, 0.12, 0.0, 0.0, 0.0, 9.0, True), rule), True),
    ],
    "ceiling.lead": [
        (lambda rule: is_above(row(leads=(9.0, 2.9)), rule), False),
        (lambda rule: is_above(row(leads=(9.0, 3.1)), rule), True),
    ],
    "place.significant": [
        (lambda rule: stands_out(_bin("regime", "stick", 1.0, 9.0, p_value=0.06), rule=rule), False),
        (lambda rule: stands_out(_bin("regime", "stick", 1.0, 9.0, p_value=0.04), rule=rule), True),
    ],
    "place.least_excess": [
        (lambda rule: stands_out(_bin("regime", "stick", 1.0, 0.9), rule=rule), False),
        (lambda rule: stands_out(_bin("regime", "stick", 1.0, 1.5), rule=rule), True),
    ],
    "place.sharp": [(_sharp(0.5, 50), "regime"), (_sharp(0.7, 50), "position")],
    "place.sharp_over_length": [(_sharp(0.8, 450), "regime"), (_sharp(0.8, 300), "position")],
    "place.everywhere": [
        (lambda rule: where_words(_regimes(2.0, 4.0, 4.0), rule=rule).startswith("every"), True),
        (lambda rule: where_words(_regimes(2.0, 8.0, 8.0), rule=rule).startswith("every"), False),
    ],
    "place.beside": [
        (lambda rule: len(lead_of(_regimes(np.e**1.0, np.e**2.0), rule=rule)), 1),
        (lambda rule: len(lead_of(_regimes(np.e**1.8, np.e**2.0), rule=rule)), 2),
    ],
    "place.part_share": [(_condition(0.7, 50.0, 2.0), False), (_condition(0.9, 50.0, 2.0), True)],
    "place.part_contrast": [(_condition(0.9, 3.0, 2.0), False), (_condition(0.9, 5.0, 2.0), True)],
    "place.largest_part": [
        (lambda rule: is_a_part(1750, 2000, rule), False),
        (lambda rule: is_a_part(1400, 2000, rule), True),
    ],
    "place.most_parts": [(_parts, 2)],
    "place.least_samples": [
        (lambda rule: is_a_part(150, 1000, rule), False),
        (lambda rule: is_a_part(250, 1000, rule), True),
    ],
    "place.least_clusters": [(_clusters(2), False), (_clusters(3), True)],
    "place.only_share": [
        (lambda rule: is_only(0.8, 50.0, 1.0, rule), False),
        (lambda rule: is_only(0.95, 50.0, 1.0, rule), True),
    ],
    "place.only_rest": [
        (lambda rule: is_only(0.99, 11.0, 2.2, rule), False),
        (lambda rule: is_only(0.99, 11.0, 1.7, rule), True),
    ],
}
