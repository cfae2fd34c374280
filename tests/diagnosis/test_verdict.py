"""The verdict: when a candidate may be named, what is said of it, and in which words."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers_diagnosis import fake_recording
from helpers_plants import TABLE_I
from helpers_rule import candidate, table

from frictionjax.core import Estimate
from frictionjax.diagnosis.findings.candidates import candidates
from frictionjax.diagnosis.findings.missing import missing_effects
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.findings.unexplained import unexplained_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.confidence import BIAS, WEIGHTS, Evidence, evidence_of
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Decision
from frictionjax.diagnosis.selection.verdict_rule import most_left, verdict_of
from frictionjax.diagnosis.table import Lead, ModelComparison
from frictionjax.diagnosis.verdict import MismatchBin, MissingEffect, Unexplained
from frictionjax.estimation.parameters import effect_layout
from frictionjax.physics import catalogue

BINS = (
    MismatchBin("regime", "stick", 0.2, 2.0, 1.05, 5000),
    MismatchBin("regime", "sliding", 0.8, 30.0, 1.2, 9000),
)
RULE = Rule()
LEAST_SHARE = RULE.accept.least_share


def _verdict(before, *after, one_law=False, **more):
    """The verdict on rounds each of which accepts a model with the next misfits, and the last nothing; what is accepted
    has `one_law`, or not."""
    if not after:
        return verdict_of([Round(table(misfits=before), None, **more)], None)
    whole = ModelComparison(
        before=(),
        after=("Form",) * len(after),
        effect="",
        form="",
        exact=(one_law,) * len(after),
        misfits_before=before,
        misfits_after=after[-1],
        misfit_errors=(0.0, 0.0),
        energies=(0.95, 0.96),
        fit=Lead(9.0, 1.0, 100),
        held_out=Lead(9.0, 1.0, 100),
    )
    return verdict_of([Round(table(candidate()), 0)], whole)


def _decision(verdict, left):
    return Decision((), verdict, *left, ())


def test_a_base_model_at_the_noise_is_adequate():
    assert _verdict((0.004, 0.004)) == ("adequate", (False, 0.0))
    assert unexplained_of(_decision("adequate", (False, 0.0)), BINS, None) == Unexplained(False, 0.0, "")


def test_what_explains_nearly_all_is_named():
    verdict, left = _verdict((0.4, 0.3), (0.004, 0.006))
    assert verdict == "named"
    assert left == (False, pytest.approx(0.02))
    assert unexplained_of(_decision(verdict, left), BINS, None).where == ""


def test_what_explains_most_is_named_and_the_rest_is_reported():
    verdict, left = _verdict((0.4, 0.3), (0.04, 0.06))
    assert verdict == "named"
    assert left == (True, pytest.approx(0.2))
    assert unexplained_of(_decision(verdict, left), BINS, None).where == "sliding"


@pytest.mark.parametrize(("left", "verdict"), [(0.075, "named"), (0.105, "unknown")])
def test_what_explains_two_thirds_is_no_name(left, verdict):
    """On the held-out recordings: 75 % of their misfit, or 65 %."""
    found, rest = _verdict((0.4, 0.3), (0.02, left))
    assert found == verdict
    assert rest == (True, pytest.approx(left / 0.3))


@pytest.mark.parametrize(("left", "verdict"), [(0.027, "named"), (0.033, "unknown")])
def test_where_there_is_one_law_a_tenth_is_something_else(left, verdict):
    """A delay is a delay: what it leaves is not its form."""
    found, rest = _verdict((0.4, 0.3), (0.02, left), one_law=True)
    assert found == verdict
    assert rest == (True, pytest.approx(left / 0.3))


@pytest.mark.parametrize(("one_law", "left"), [(False, 0.3), (True, 0.12)])
def test_two_effects_must_leave_less_than_one(one_law, left):
    """They have more ways to stand in for another."""
    for beyond, verdict in ((0.99, "named"), (1.01, "unknown")):
        found = _verdict((4.0, 3.0), (2.0, 1.4), (0.0, beyond * left), one_law=one_law)
        assert found[0] == verdict


@pytest.mark.parametrize(("left", "verdict"), [(0.019, "named"), (0.021, "unknown")])
def test_what_leaves_nothing_significant_is_named_whatever_the_share(left, verdict):
    """A weak delay: a quarter of what little was missing is within twice what is adequate."""
    found, rest = _verdict((0.08, 0.07), (0.01, left), one_law=True)
    assert found == verdict
    assert rest == (verdict == "unknown", pytest.approx(left / 0.07))


def test_one_of_many_laws_among_several_allows_for_its_form():
    """A delay beside a creep."""
    delay, creep = (catalogue()[name][0].about.one_law for name in ("delay", "creep"))
    assert most_left([delay]) < most_left([creep])
    assert most_left([delay, creep]) == most_left([creep, creep]) > most_left([delay, delay])


def test_two_effects_explain_together():
    verdict, left = _verdict((0.4, 0.3), (0.2, 0.14), (0.004, 0.004))
    assert verdict == "named"
    assert left == (False, pytest.approx(0.004 / 0.3))


@pytest.mark.parametrize("holdout", [0.25, 0.31])
def test_what_fails_on_held_out_recordings_is_not_named(holdout):
    verdict, left = _verdict((0.4, 0.3), (0.01, holdout))
    assert verdict == "unknown"
    assert left == (True, pytest.approx(min(holdout / 0.3, 1.0)))


def test_nothing_accepted_is_unknown():
    verdict, left = _verdict((0.4, 0.3))
    assert verdict == "unknown"
    assert unexplained_of(_decision(verdict, left), BINS, None) == Unexplained(True, 1.0, "sliding")


def test_a_parameter_that_was_left_open_is_no_missing_physics():
    """The fitted recordings are at the noise, the others are not, and one set of parameters predicts all."""
    assert _verdict((0.002, 0.3), together=True) == ("adequate", (False, 0.0))


def test_held_out_recordings_alone_can_tell_that_something_is_missing():
    assert _verdict((0.002, 0.3))[0] == "unknown"


@pytest.mark.untyped
@pytest.mark.parametrize("helps", [True, False])
def test_a_map_that_predicts_recordings_held_out_is_reported(helps):
    residual = SimpleNamespace(variable="velocity", helps=helps, row=candidate((0.5, 0.4)))
    found = unexplained_of(_decision("unknown", (True, 1.0)), BINS, residual)
    if helps:
        assert found == Unexplained(True, 1.0, "sliding; carried by velocity", "velocity", 0.4)
    else:
        assert found == Unexplained(True, 1.0, "sliding")


def test_evidence_of_two_effects():
    """The whole, and each effect where it was found."""
    first = candidate((0.5, 0.6), before=(0.4, 0.3))
    second = candidate((0.9, 0.75), before=(0.2, 0.12))
    other = candidate((0.2, 0.1), before=(0.2, 0.12), effect="another")
    whole = candidate((0.95, 0.9), before=(0.4, 0.3), energies=(0.97, 0.92))
    chain = [Round(table(first), 0), Round(table(other, second), 1), Round(table(), None)]
    one, two = evidence_of(chain, whole)
    assert one.whole == two.whole == pytest.approx(0.9)
    assert one.own == pytest.approx(0.5) and two.own == pytest.approx(0.75)
    assert one.energy == two.energy == 0.92
    assert one.lead == pytest.approx(0.5 + 0.6) and two.lead == pytest.approx(0.9 + 0.75 - 0.3)
    assert evidence_of(chain[2:], None) == []


def test_confidence_is_the_logistic_of_its_features():
    logits = np.log([4.0, 3.0, 9.0])
    odds = np.exp(BIAS + np.dot(np.array(WEIGHTS)[[0, 1, 3]], logits) + WEIGHTS[2] * 0.5)
    assert Evidence(0.8, 0.75, 0.5, 0.9).confidence == pytest.approx(odds / (1.0 + odds), rel=1e-12)
    # More of anything makes no name less likely; nothing is certain.
    assert Evidence(0.9, 0.75, 0.5, 0.9).confidence >= Evidence(0.8, 0.75, 0.5, 0.9).confidence
    assert Evidence(1.3, 1.2, 9.0, 2.0).confidence < 1.0 and Evidence(-2.0, -1.0, -1.0, 0.0).confidence > 0.0


def _missing_effect(effect="delay", effect_class=("delay",), sentence="a pure delay between input and force"):
    return MissingEffect(effect, effect_class, 0.97, 1e-9, {}, "stick", "", sentence)


NOTHING = Unexplained(False, 0.0, "")


def test_an_adequate_model_is_reported_in_one_sentence():
    found = summary_sentence("adequate", (), NOTHING, "nowhere above the noise", (fake_recording(n=200),))
    assert (
        found
        == "Nothing significant is missing: the base model leaves no misfit that is significant above the noise."
    )


def test_the_named_effect_its_place_and_the_held_out_error_are_reported():
    fits = (fake_recording("a", role="fit", n=400), fake_recording("kept", n=400))
    units = {"unit": "N*m", "position_unit": "rad"}
    found = summary_sentence("named", (_missing_effect(),), NOTHING, "stick (80 %)", fits, **units)
    base, extended = fits[1].prediction_rmse_base, fits[1].prediction_rmse_extended
    assert found == (
        "Missing from the base model: a pure delay between input and force. The mismatch is in: stick (80 %). "
        "On the held-out recording kept the prediction error 0.1 s ahead falls from "
        f"{base:.3g} to {extended:.3g} rad (noise 1.1e-07)."
    )
    imposed = (fake_recording("kept", n=400, drive="motion"),)
    found = summary_sentence("named", (_missing_effect(),), NOTHING, "stick (80 %)", imposed, **units)
    assert " N*m (noise 1.1e-07)." in found


def test_what_cannot_be_distinguished_is_reported_too():
    effect = _missing_effect(effect_class=("delay", "drive_lag"))
    found = summary_sentence("named", (effect,), NOTHING, "stick", (fake_recording(n=200),))
    assert (
        "a pure delay between input and force, which these recordings cannot distinguish from drive_lag."
        in (found)
    )


def test_several_effects_are_reported_together():
    effects = (_missing_effect(), _missing_effect("constant_load", ("constant_load",), "a constant force"))
    found = summary_sentence("named", effects, NOTHING, "stick", (fake_recording(n=200),))
    assert found.startswith(
        "Missing from the base model: a pure delay between input and force; a constant force."
    )


def test_the_unknown_is_reported_with_its_place():
    found = summary_sentence("unknown", (), Unexplained(True, 1.0, "sliding"), "sliding (90 %)", ())
    assert (
        found
        == "Something is missing that no effect of the catalogue explains. The mismatch is in: sliding (90 %)."
    )
    part = summary_sentence("unknown", (_missing_effect(),), Unexplained(True, 0.6, "sliding"), "sliding", ())
    assert part.endswith("The catalogue does not explain the remaining 60 % of the misfit.")


def _trial(form, **more):
    values = {"p_value": 1e-7, "gain": 0.3, "detectable": {}, "one_step": {}} | more
    return SimpleNamespace(effect=form.name, form=form(), linear_gain=0.0, **values)


def _refitted(form):
    """A candidate that was refitted, as `Refitted` would hold it, and its trial."""
    drive, trial = TABLE_I.with_effects(form()), _trial(form)
    posterior = SimpleNamespace(layout=effect_layout(drive, {"dt": 1e-3, "Fc": 1.0}), drive=drive)
    model = SimpleNamespace(posterior=posterior)
    return SimpleNamespace(effect=form.name, trial=trial, model=model), trial


@pytest.mark.untyped
def test_a_missing_effect_carries_its_class_and_its_parameters():
    form = catalogue()["delay"][0]
    accepted, trial = _refitted(form)
    rest, weights = {"trials": [trial]}, [Evidence(0.9, 0.8, 0.5, 0.95)]
    step = SimpleNamespace(accepted=accepted, rivals=("drive_lag",), **rest)
    extended = {"J": Estimate(1.0, 0.1, "kg"), "delay": Estimate(1e-3, 1e-5, "s")}
    (found,) = missing_effects([step], weights, extended, ["stick"], {})
    assert found.effect_class == ("delay", "drive_lag")
    assert found.parameters == {"delay": extended["delay"]}
    assert found.confidence == pytest.approx(Evidence(*found.evidence).confidence, abs=1e-3)
    assert found.evidence == weights[0]
    assert found.split_by == form.about.split_by
    assert found.sentence == form.about.sentence
    designed = SimpleNamespace(sentence="To distinguish delay from drive_lag: a sine.")
    assert (
        missing_effects([step], weights, extended, ["stick"], {"delay": designed})[0].split_by
        == designed.sentence
    )
    alone = SimpleNamespace(accepted=accepted, rivals=(), **rest)
    assert missing_effects([alone], weights, extended, ["stick"], {})[0].split_by == ""


@pytest.mark.untyped
def test_an_effect_that_kept_its_place_is_reported_with_its_own_parameters():
    """Compared again beside a later one, it is not the last of the drive."""
    delay, load = (catalogue()[name][0] for name in ("delay", "constant_load"))
    drive = TABLE_I.with_effects(delay(), load())
    posterior = SimpleNamespace(layout=effect_layout(drive, {"dt": 1e-3, "Fc": 1.0}), drive=drive)
    refits = [SimpleNamespace(effect=form.name, trial=_trial(form)) for form in (delay, load)]
    steps = [
        SimpleNamespace(
            accepted=SimpleNamespace(**vars(one), model=SimpleNamespace(posterior=posterior)),
            rivals=(),
            trials=[one.trial],
        )
        for one in refits
    ]
    extended = {"delay": Estimate(1e-3, 1e-5, "s"), "load": Estimate(2.0, 0.1, "N")}
    found = missing_effects(steps, [Evidence(0.9, 0.8, 0.5, 0.95)] * 2, extended, ["stick"] * 2, {})
    assert [one.parameters for one in found] == [{name: extended[name]} for name in ("delay", "load")]
    assert [one.sentence for one in found] == [form.about.sentence for form in (delay, load)]


@pytest.mark.untyped
def test_every_effect_of_the_catalogue_has_a_row_and_a_reason():
    delay, load, ripple, pendulum = (
        catalogue()[name][0] for name in ("delay", "constant_load", "ripple", "gravity_pendulum")
    )
    (accepted, trial), (refused, other) = _refitted(delay), _refitted(load)
    trials = [
        trial,
        other,
        _trial(ripple, p_value=0.4),
        _trial(ripple, p_value=0.5, gain=0.1),
        _trial(pendulum),
    ]
    step = SimpleNamespace(
        accepted=accepted,
        rivals=(),
        trials=trials,
        refits=[accepted, refused],
        compared=[candidate((0.9, 0.8)), candidate((0.2, 0.0))],
        dropped="",
        least_share=LEAST_SHARE,
    )
    units = {"force": "N*m", "position": "rad", "input": "V"}
    rows = candidates([step], units, {"gravity_pendulum": "the position is no angle"})
    assert {row.effect for row in rows} == set(catalogue())
    by_name = {row.effect: row for row in rows}
    assert rows[0].effect == "delay"
    assert by_name["delay"].reason == "named"
    assert (by_name["delay"].gain_fit, by_name["delay"].gain_holdout) == pytest.approx((0.9, 0.8))
    assert by_name["constant_load"].reason.startswith("explains too little")
    assert by_name["constant_load"].units == {"load": "N*m"}
    assert by_name["ripple"].reason == "its first step gains too little for a refit"
    assert by_name["ripple"].p_value == pytest.approx(0.8)
    assert not by_name["maxwell_slip"].tested
    assert by_name["maxwell_slip"].reason == "the recordings hold no motion that would show it"
    assert not by_name["gravity_pendulum"].tested
    assert by_name["gravity_pendulum"].reason == "the position is no angle"
    # What would have been accepted later, but was not, says why; what is named does not.
    later = SimpleNamespace(
        **vars(step) | {"accepted": None, "compared": [candidate((0.9, 0.8))] * 2, "dropped": "too late"}
    )
    by_name = {row.effect: row for row in candidates([step, later], units, {})}
    assert by_name["constant_load"].reason == "too late"
    assert by_name["delay"].reason == "named"
