"""What the report says in words: how much better, what next, what remains; and what the parameters mean."""

import math
import re
from dataclasses import replace
from html import unescape

import pytest
from helpers_diagnosis import adequate_diagnosis, fake_check, fake_diagnosis, fake_recording

from frictionjax.core import Estimate
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.mismatch_map.axes import REGIMES
from frictionjax.diagnosis.mismatch_map.where_words import where_words
from frictionjax.diagnosis.recording_fit import ClosedLoop, Horizon, Unmeasured
from frictionjax.diagnosis.verdict import Candidate, Ceiling, MismatchBin, MissingEffect, Unexplained
from frictionjax.physics.effects import catalogue
from frictionjax.report.meanings import meaning_of, with_amplitudes
from frictionjax.report.sections.closed_loop import ClosedLoopSection
from frictionjax.report.sections.headline import HeadlineSection, limiting
from frictionjax.report.sections.horizons import HorizonsSection
from frictionjax.report.sections.missing import MissingSection
from frictionjax.report.sections.record import RecordSection
from frictionjax.report.sentences import badge, improvement, next_step, remainder
from frictionjax.report.terminal import summary_lines


def _alone(**changes):
    """The fake diagnosis with a class of one."""
    found = fake_diagnosis(n=400)
    (first,) = found.missing
    return replace(found, missing=(replace(first, effect_class=("maxwell_slip",), split_by=""),), **changes)


def test_the_improvement_has_units_of_position_and_force():
    held = replace(
        fake_recording(n=4), prediction_rmse_base=1.2e-6, prediction_rmse_extended=1.5e-7,
        unmeasured_base=Unmeasured(3e-2, 1.0, 1.0), unmeasured_extended=Unmeasured(2e-3, 0.1, 0.1),
    )  # fmt: skip
    said = improvement(_alone(recordings=(held,)))
    assert said == (
        "On the held-out recordings the model with it predicts the position 0.1 s ahead to 0.15 µrad rms instead of "
        "1.2 µrad (8.0 times better, 1.4 × noise floor), and the force that it lacks is 2.0 mN·m rms instead of "
        "30 mN·m."
    )
    imposed = replace(held, drive="motion", force=held.x)
    assert "predicts the friction force 0.1 s ahead to 0.15 µN·m" in improvement(
        _alone(recordings=(imposed,))
    )
    assert "better" not in improvement(_alone(recordings=(replace(held, prediction_rmse_extended=2e-6),)))
    assert improvement(_alone(recordings=())) == ""


def test_an_adequate_model_has_no_extension_to_speak_of():
    said = improvement(adequate_diagnosis())
    assert said.startswith("On the recordings the base model predicts the position 0.1 s ahead to ")
    assert next_step(adequate_diagnosis()) == "Use the base model as it is."
    untested = (Candidate("backlash", math.nan, {}, False, "reason"), Candidate("creep", 0.5, {}, True, ""))
    some = next_step(replace(adequate_diagnosis(), candidates=untested))
    assert "these recordings cannot show backlash: " in some


def test_what_next_depends_on_what_was_found():
    found = fake_diagnosis(n=400)
    assert next_step(found).startswith(
        "To decide between maxwell slip or elasto plastic, record this and diagnose again: nested triangles"
    )
    alone = _alone()
    assert next_step(alone) == (
        "Add hysteresis with non-local memory to your model, with the friction parameters of the extended model "
        "(sigma0 changes most, from 2010 N·m/rad to 1814 N·m/rad)."
    )
    left = Unexplained(True, 0.4, "slow sliding")
    unknown = replace(alone, verdict="unknown", unexplained=left)
    assert next_step(unknown).startswith(
        "Add hysteresis with non-local memory, then look for a cause in slow"
    )
    assert next_step(replace(unknown, missing=())).startswith("Look for a cause in slow sliding")
    untested = (Candidate("creep", math.nan, {}, False, ""),)
    assert next_step(replace(unknown, missing=(), candidates=untested)) == ""


@pytest.mark.parametrize("verdict", ["named", "unknown"])
def test_the_badge_and_what_remains_agree(verdict):
    left = replace(
        _alone(verdict=verdict), unexplained=Unexplained(True, 0.10, "slow sliding", "velocity", 0.5)
    )
    whole = replace(left, unexplained=Unexplained(False, 0.01, ""))
    assert "10 %" in remainder(left) and "over velocity removes 50 %" in remainder(left)
    assert remainder(whole) == ""
    above = Ceiling(0.3, 0.1, 0.7, 0.6, 8.0, 0.025, 0.05, 0.02, "velocity", True)
    assert "A force that is free in velocity" in remainder(replace(left, ceiling=above))
    assert "A force that is free" not in remainder(left)
    if verdict == "named":
        assert badge(left).startswith(
            "Named: all but 10 % of the misfit is explained; 0.1 s ahead, the held-out"
        )
        assert badge(whole).startswith("Named: no significant misfit remains; 0.1 s ahead, the held-out")
        assert "explains all but 10 % of the misfit" in remainder(left)
    else:
        assert "no effect of the catalogue explains the rest" in badge(left)


@pytest.mark.parametrize("verdict", ["named", "adequate"])
@pytest.mark.parametrize("present", [True, False])
def test_badge_sentence_and_cards_say_how_far_from_the_noise_the_model_is(verdict, present):
    """A model that is far from the noise is nowhere called one that explains the recordings to the noise."""
    near = replace(
        fake_recording(n=400), noise_floor=1e-7, prediction_rmse_base=1.2e-7, prediction_rmse_extended=1.1e-7
    )
    far = replace(near, name="far", prediction_rmse_base=9e-5, prediction_rmse_extended=1.18e-5)
    fitted = replace(far, name="fitted", role="fit", prediction_rmse_base=1.0, prediction_rmse_extended=1.0)
    found = _alone(
        verdict=verdict, recordings=(fitted, near, far), unexplained=Unexplained(present, 0.1, ""),
    )  # fmt: skip
    largest = "118 × noise floor" if verdict == "named" else "900 × noise floor"
    assert badge(found).endswith(f"; 0.1 s ahead, the held-out error is up to {largest}")
    assert f"up to {largest})" in improvement(found)
    body = str(HeadlineSection().body(found))
    assert f"{largest} (100 nrad)" in body  # on the card of that recording
    said = f"{badge(found)} {improvement(found)} {body}".lower()
    assert not re.search(r"identified and modelled|explains? \S+ ?\S* to the noise|at the noise", said)
    alone = replace(found, recordings=(near,))
    assert "held-out error is 1.1 ×" in badge(alone) or "held-out error is 1.2 ×" in badge(alone)
    silent = replace(found, recordings=(fitted, replace(far, noise_floor=0.0)))
    assert "noise floor" not in badge(silent) + improvement(silent)


def test_warnings_that_change_the_reading_stand_at_the_top():
    found = fake_diagnosis(n=400)
    of_a_file = found.warnings[0]
    general = "Not identifiable from these recordings: vs of the base model."
    found = replace(found, warnings=(of_a_file, general))
    assert limiting(found) == [general]
    top, record = str(HeadlineSection().body(found)), str(RecordSection().body(found))
    assert general in top and of_a_file not in top
    assert general in record and of_a_file in record
    untested = (Candidate("creep", math.nan, {}, False, ""),)
    refused = replace(found, verdict="unknown", missing=(), candidates=untested)
    assert limiting(refused) == [of_a_file, general]


def test_compilation_is_said_beside_the_total_not_above_it():
    body = str(RecordSection().body(fake_diagnosis(n=10)))
    assert "compiled programs for 9.00 s" in body
    assert body.index("total") < body.index("compiled programs for")


def test_a_wave_is_shown_by_amplitude_and_phase():
    parts = {
        "ripple.sine": Estimate(3.0, 0.1, "N"),
        "ripple.cosine": Estimate(4.0, 0.1, "N"),
        "ripple.sine2": Estimate(0.0, 0.2, "N"),
        "ripple.cosine2": Estimate(-2.0, 0.1, "N"),
        "ripple.period": Estimate(0.02, 1e-5, "m"),
    }
    found = with_amplitudes(parts)
    assert list(found) == [
        f"ripple.{name}" for name in ("amplitude", "phase", "amplitude2", "phase2", "period")
    ]
    assert found["ripple.amplitude"].value == pytest.approx(5.0)
    assert found["ripple.amplitude"].stderr == pytest.approx(0.1)
    assert found["ripple.phase"].value == pytest.approx(math.degrees(math.atan2(4.0, 3.0)))
    assert found["ripple.phase"].stderr == pytest.approx(math.degrees(0.1 / 5.0))
    assert (found["ripple.amplitude2"].value, found["ripple.phase2"].value) == (2.0, -90.0)
    alone = {"sine": Estimate(1.0, 0.1, "N")}
    assert with_amplitudes(alone) == alone


def test_every_parameter_has_a_meaning():
    assert meaning_of("Fc") == "Coulomb friction"
    assert meaning_of("J") and meaning_of("no_such") == ""
    for name, forms in catalogue().items():
        for form in forms:
            estimates = {
                f"{name}.{one.name}": Estimate(1.0, 0.1, one.unit)
                for one in (*form.strengths, *form.nuisances)
            }
            for label in with_amplitudes(estimates):
                assert meaning_of(label), label


def test_a_card_shows_what_the_parameters_mean():
    sizes = {"sine": Estimate(0.03, 1e-3, "N*m"), "cosine": Estimate(0.04, 1e-3, "N*m")}
    ripple = MissingEffect(
        "ripple", ("ripple",), 0.9, 1e-9, sizes | {"period": Estimate(0.2, 1e-3, "rad")}, ""
    )
    body = str(MissingSection().body(replace(fake_diagnosis(n=10), missing=(ripple,))))
    assert "0.0500 ± 0.0010 N·m (amplitude of the wave)" in body
    assert "deg (phase of the wave" in body
    assert "km u - F - sine sin(2 pi x/period)" in body


def test_each_horizon_has_its_column_and_each_recording_its_own():
    longer = (
        Horizon(0.002, 2e-7, 1e-7, 1e-6),
        Horizon(0.1, 4e-6, 2e-6, 1e-4),
        Horizon(1.0, 5e-6, 3e-6, 2e-3),
    )
    first = replace(fake_recording(n=40), name="long", horizons=(*longer, Horizon(7.5, 6e-6, math.inf, 3e-3)))
    second = replace(
        fake_recording(n=40), name="short", horizons=(longer[0], Horizon(0.15, 7e-6, 4e-6, 1e-3))
    )
    pushed = replace(fake_recording(n=40, drive="motion"), name="pushed", unmeasured_base=None)
    page = str(HorizonsSection().body(_alone(recordings=(first, second, pushed))))
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.S)
    found = [re.findall(r"<t[hd].*?</t[hd]>", row, re.S) for row in rows]
    head, *cells = ([re.sub(r"\s*<[^>]+>\s*", " ", cell).split() for cell in row] for row in found)
    assert [" ".join(words) for words in head] == [
        *("recording", "one sample ahead", "0.1 s ahead", "1 s ahead", "whole recording"),
        *("lacking force", "of the applied force"),
    ]
    assert " ".join(cells[0][1]) == "0.200 µrad → 0.100 µrad (1.00 µrad)"
    assert "–" in cells[0][4] and "(3.00" in cells[0][4]  # a run that overflows
    assert cells[1][2:4] == [["–"], ["–"]] and "(1.00" in cells[1][4]  # shorter than twice 0.1 s
    assert cells[2][1:] == [["–"]] * 6


def test_the_closed_loop_has_a_table_where_there_is_a_controller():
    closed = ClosedLoop(2e-3, 3e-5, 0.5, 0.25, given=4e-3, input_given=0.75, law=0.62)
    under = replace(fake_recording(n=40), name="servo", closed_loop=closed)
    page = str(
        ClosedLoopSection().body(_alone(recordings=(under, replace(fake_recording(n=40), name="open"))))
    )
    text = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    assert "position input position, your model as given" in text
    assert "servo 2.00 mrad → 0.0300 mrad 500 mV → 250 mV 4.00 mrad 750 mV" in text
    assert " open " not in text
    assert "its gains make 62 % in servo out of the recorded reference" in text
    blind = replace(under, closed_loop=replace(closed, law=None, given=None, input_given=None))
    page = str(ClosedLoopSection().body(_alone(recordings=(blind,))))
    assert "as given" not in page and "out of the recorded reference" not in page
    assert not ClosedLoopSection().body(_alone(recordings=(fake_recording(n=40),)))


def _brackets(text):
    """Where a `text` has brackets inside others, or two in a row."""
    return re.findall(r"\([^()]*\(.*|\)\s*\(.*", text)


def _canned():
    """Diagnoses of every effect, alone and as one of a class, with each regime as the place of the mismatch."""
    found = fake_diagnosis(n=400)
    (first,) = found.missing
    fits, unexplained = found.recordings, Unexplained(True, 0.2, "slow sliding (Stribeck)", "velocity", 0.5)
    ceiling = Ceiling(0.3, 0.1, 0.7, 0.6, 8.0, 0.025, 0.05, 0.02, "velocity", True)
    within = replace(found.within[0], phrase="in stick (bristle bent below 20 %)")
    for number, (name, forms) in enumerate(catalogue().items()):
        label = REGIMES[number % len(REGIMES)]
        others = [one for one in REGIMES if one != label]
        bins = (
            MismatchBin("regime", label, 0.7, 120.0, 80.0, 100, 1e-6),
            *(MismatchBin("regime", one, 0.075, 1.1, 1.0, 100, 0.5) for one in others),
        )
        where = where_words(bins, (), (within,))
        assert label.rstrip(")") in where
        for members, verdict in (((name,), "named"), ((name, "creep"), "unknown")):
            one = replace(
                first, effect=name, effect_class=members, sentence=forms[0].about.sentence, where=where
            )
            said = summary_sentence(
                verdict, (one, replace(one, effect="delay")), unexplained, where, fits, Unmeasured(1e-3, 0.1, 0.1),
                "N*m", ceiling, position_unit="rad",
            )  # fmt: skip
            changed = replace(
                found.candidates[0], effect=name, reason="explains too little (16 % on the fit)"
            )
            yield replace(
                found, verdict=verdict, summary=said, missing=(one,), unexplained=unexplained, ceiling=ceiling,
                check=fake_check(), candidates=(changed, replace(changed, effect="other")),
            )  # fmt: skip
    yield from (found, adequate_diagnosis())


def test_no_sentence_has_brackets_in_a_row_or_inside_each_other():
    for found in _canned():
        title, *_ = repr(found).split("\n")
        said = [found.summary, title, *found._display().sentences, improvement(found), next_step(found)]
        said += [remainder(found), badge(found), *summary_lines(found)]
        said += [found.explain(one.effect) for one in found.candidates]
        page = re.sub(r"<[^>]+>", " ", str(HeadlineSection().body(found)) + str(MissingSection().body(found)))
        said += [line for line in page.split("\n") if "code" not in line]
        assert [wrong for sentence in said for wrong in _brackets(unescape(sentence))] == []


@pytest.mark.parametrize("text", ["a (b (c)) d", "presliding (20 to 80 %) (38 % of the excess)", "a (b)(c)"])
def test_brackets_are_found_where_they_are(text):
    assert _brackets(text) and not _brackets("a (b), c (d; e)")
