"""report.html: one file, nothing fetched, the sentence first, and no section that an empty list could break."""

import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import jax
import numpy as np
import pytest
from helpers_diagnosis import SUMMARY, adequate_diagnosis, fake_check, fake_diagnosis, fake_recording

from frictionjax.diagnosis.verdict import Candidate, MismatchBin, SimulationAsGiven, Unexplained
from frictionjax.recordings import Plant
from frictionjax.report.figures import comparison
from frictionjax.report.format import quantity
from frictionjax.report.page import render
from frictionjax.report.sections.candidates import CandidatesSection
from frictionjax.report.sections.mismatch import MismatchSection
from frictionjax.report.sections.missing import MissingSection
from frictionjax.report.sections.parameters import ParametersSection

MAP_WITHOUT_LEVELS = (MismatchBin("regime", "sliding", 1.0, 3.0),)
VOID = {"meta", "br", "line", "circle", "rect", "link", "path"}


class Page(HTMLParser):
    """The parts of a page that the tests ask for; fails on tags that do not nest."""

    def __init__(self, text: str):
        super().__init__()
        self.open, self.links, self.charts, self.tags, self.words = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []
        self.visible = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.links += [attrs[key] for key in ("href", "src", "data", "action") if key in attrs]
        if tag == "svg" and attrs.get("class") == "chart":
            self.charts.append(attrs)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "title", "script"} & set(self.open):
            self.words.append(data)


@pytest.fixture(scope="module")
def page():
    return Page(render(fake_diagnosis(n=2000)))


def test_it_opens_with_what_is_missing_how_much_better_and_what_to_do(page):
    first = SUMMARY.split(". ")[0]
    assert page.visible.startswith(f"{first}. On the held-out recordings the model with it predicts")
    assert page.visible.index("Next: To decide between") < page.visible.index("Named: no significant misfit")


@pytest.mark.parametrize(
    ("tested", "badge"), [(False, "Not diagnosed: the base model"), (True, "Unknown: physics is missing")]
)
def test_a_case_that_was_not_diagnosed_says_so(tested, badge):
    untested = (Candidate("creep", float("nan"), {}, tested, "not tested: the base fit is not credible"),)
    found = replace(fake_diagnosis(n=10), verdict="unknown", missing=(), candidates=untested)
    assert found.was_diagnosed is tested
    assert badge in Page(render(found)).visible


def test_it_fetches_nothing(page):
    assert page.links
    assert all(link.startswith(("data:", "#")) for link in page.links)
    assert page.links[0] == "data:,"  # no icon is asked for either
    assert page.tags.count("script") == page.tags.count("link") == 1
    assert not {"iframe", "object", "img"} & set(page.tags)
    text = render(adequate_diagnosis())
    assert "@import" not in text
    assert "url(" not in text
    assert "fetch(" not in text and "XMLHttpRequest" not in text


def test_every_chart_has_words_for_those_who_cannot_see_it(page):
    # Three recordings, whole and close-up, measured and residual force; over speed, displacement and travel.
    over_time = [attrs for attrs in page.charts if attrs["data-name"] == "time"]
    assert len(over_time) == 3 * 2 * 2
    assert all(attrs["aria-label"] for attrs in page.charts)
    names = [attrs["aria-label"].split(",")[0] for attrs in over_time[::2]]
    assert names[:3] == ["holdout_stick", "noise_small", "breakaway"]


def test_pictures_stand_before_tables(page):
    titles = ("What is missing", "Measured and modelled", "Parameters value", "Glossary")
    order = [page.visible.index(title) for title in ("holdout_stick held out", "standard error; the change")]
    assert order == sorted(order)
    assert page.tags.index("table") > page.tags.index("figure")
    assert titles[-1] in page.visible


def test_an_adequate_case_has_no_extended_model_and_no_empty_sections():
    page = Page(render(adequate_diagnosis()))
    assert page.visible.startswith("The base model explains these recordings to the noise.")
    assert "Adequate" in page.visible
    assert "extended" not in page.visible
    assert "No recording was held out" in page.visible
    assert "What is missing" not in page.visible
    assert "the model fits worst" in page.visible
    assert "Candidates" not in page.visible
    assert "Where the base model fails" not in page.visible


def test_a_case_without_recordings_or_numbers_still_renders():
    empty = replace(adequate_diagnosis(), recordings=())
    assert "base model explains" in Page(render(empty)).visible


def test_what_is_not_finite_is_drawn_as_a_gap():
    recording = fake_recording(n=600)
    recording.residual_force_std[:] = np.inf
    recording.free_base[300:] = np.nan
    recording.free_extended[:] = np.inf
    recording.predicted_base[:50] = np.nan
    Page(render(replace(fake_diagnosis(), recordings=(recording,))))


def test_a_single_sample_still_renders():
    one = jax.tree.map(lambda series: series[:1], fake_recording())
    Page(render(replace(fake_diagnosis(), recordings=(one,))))


def test_an_imposed_motion_is_judged_in_force_units():
    recording = fake_recording(n=600, drive="motion")
    page = Page(render(replace(fake_diagnosis(), recordings=(recording,))))
    assert "nN·m" in page.visible  # the size of the prediction error, now a force
    assert "nrad" not in page.visible


def test_the_user_s_own_model_as_given_has_columns_of_its_own():
    found = fake_diagnosis()
    given = replace(found.recordings[0], prediction_rmse_given=0.123456, free_run_rmse_given=0.234567)
    page = render(replace(found, recordings=(given,)))
    assert "your model as given" in page
    for error in (0.123456, 0.234567):
        assert quantity(error, found.plant.position_unit) in page
    assert "your model as given" not in render(found)


def test_the_user_s_simulation_has_a_line_a_sentence_and_a_map_of_its_own():
    found = fake_diagnosis()
    first, *others = found.recordings
    moved = first.x + 1e-5 * np.sin(7.0 * first.t)
    first = replace(first, free_given=moved, free_run_rmse_given=0.234567, increment_rmse_given=0.345678)
    bins = (MismatchBin("regime", "sliding", 1.0, 77.0, 1.5, 1000, 0.005),)
    given = SimulationAsGiven("column", "Your simulation misses it by much.", "sliding", bins)
    page = render(replace(found, recordings=(first, *others), given=given))
    assert page.count("Your simulation misses it by much.") == 2
    assert "Where your simulation misses" in page and 'class="axes as-given"' in page
    assert "your simulation as given: free-run error" in page and "prediction error" in page
    assert "as given: prediction error" not in page
    for error in (0.234567, 0.345678):
        assert quantity(error, found.plant.position_unit) in page
    drawn = comparison(first, found.plant, True, slice(None))
    (line,) = (one for one in drawn.panels[0].series if one.colour == "given")
    assert line.label == "your simulation, free run" and line.y.size == first.t.size
    plain = render(found)
    assert "Where your simulation misses" not in plain and "your simulation" not in plain


def test_bins_that_are_not_significant_are_grey(page):
    """Only those whose p-value, corrected for the whole map, is known to be no less than 5 %."""
    body = MismatchSection().body(fake_diagnosis(n=600))
    grey = [row for row in body.split("<tr ") if row.startswith('class="chance"')]
    assert len(grey) == 1
    assert "after rests below 10 ms" in grey[0]
    assert "Grey bins are not significant (family-wise p > 0.05)." in page.visible
    assert "Grey bins" not in MismatchSection().body(
        replace(fake_diagnosis(n=600), mismatch=MAP_WITHOUT_LEVELS)
    )


def test_the_part_with_the_excess_is_said(page):
    assert "Only after rests longer than 0.3 s : in presliding, this part has 97 %" in page.visible
    assert '<ul class="within">' not in MismatchSection().body(replace(fake_diagnosis(n=600), within=()))


def test_text_of_users_is_escaped():
    diagnosis = replace(
        fake_diagnosis(),
        recordings=(fake_recording("a<b>&\"'", n=600),),
        mismatch=(MismatchBin("<axis>", "v < 1", 1.0, 3.0),),
        plant=Plant(16.0, "<m>", "<N>", "<V>"),
        summary="<h1>&",
    )
    page = Page(render(diagnosis))
    assert page.visible.startswith("<h1>&")
    assert "a<b>&\"'" in page.visible
    assert not {"axis", "m", "n", "v"} & set(page.tags)


def test_unexplained_physics_is_said():
    unexplained = Unexplained(True, 0.43, "sliding at one spot of the stroke")
    body = MissingSection().body(replace(fake_diagnosis(), unexplained=unexplained))
    assert "43 %" in body
    assert "one spot of the stroke" in body
    page = Page(render(replace(fake_diagnosis(n=600), verdict="unknown", unexplained=unexplained)))
    assert "The extended model has the named effects only" in page.visible
    assert "an effect is named, but no effect of the catalogue explains the rest" in page.visible
    nothing = Page(
        render(replace(fake_diagnosis(n=600), verdict="unknown", unexplained=unexplained, missing=()))
    )
    assert "physics is missing that no effect of the catalogue explains" in nothing.visible


def test_the_place_of_the_mismatch_is_above_the_card_and_of_several_effects_on_each():
    diagnosis = fake_diagnosis(n=10)
    (first,) = diagnosis.missing
    places = {"effect": "creep", "effect_class": ("creep",), "where": "stick (90 % of what it explains)"}
    second = replace(first, p_value=3e-5, **places)
    one = Page(MissingSection().body(diagnosis)).visible
    assert one.startswith(
        "Where the base model fails: presliding, first 20 um after a reversal. Maxwell slip"
    )
    assert "98 % (p = 10⁻¹² for the model without it)" in one
    assert "experiment that would distinguish them nested triangles" in one
    assert "one at a time" not in one
    both = Page(MissingSection().body(replace(diagnosis, missing=(first, second)))).visible
    for place in ("presliding, first 20 um after a reversal", "stick (90 % of what it explains)"):
        assert both.count(f"errors that it explains {place}") == 1
    assert "with the effects that were found before it" in both
    assert "p = 3×10⁻⁵ for the model without it" in both


def test_candidates_are_sorted_and_say_why():
    page = Page(CandidatesSection().body(fake_diagnosis(n=10)))
    order = [page.visible.index(name) for name in ("maxwell slip named", "creep", "backlash not tested")]
    assert order == sorted(order)
    assert "share 0.400" in page.visible
    assert "needs a second encoder" in page.visible


def test_a_parameter_that_the_data_do_not_determine_is_said_in_words():
    body = Page(ParametersSection().body(fake_diagnosis(n=10))).visible
    assert "not determined by these recordings" in body
    assert "1814.0 ± 1.9" in body
    assert "−11 %" in body


def test_saving_a_diagnosis_writes_the_report_whatever_was_imported(tmp_path):
    """In a process of its own: `Diagnosis.save` needs nobody to have imported the report."""
    code = (
        "import sys; from helpers_diagnosis import adequate_diagnosis; "
        "assert 'frictionjax.report' not in sys.modules; adequate_diagnosis().save(sys.argv[1])"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], check=True, cwd=Path(__file__).parents[1] / "support"
    )
    Page((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_many_long_recordings_stay_small():
    recordings = tuple(fake_recording(f"run{k}", role="fit", n=30000, seed=k) for k in range(8))
    text = render(replace(fake_diagnosis(), recordings=recordings))
    assert len(text) < 5_000_000


def test_beyond_the_first_recordings_only_a_count_is_given(monkeypatch):
    monkeypatch.setattr("frictionjax.report.sections.panels.MOST", 1)
    page = Page(render(fake_diagnosis(n=600)))
    assert sum(attrs["data-name"] == "time" for attrs in page.charts) == 4
    assert "2 more recordings are not drawn" in page.visible


def test_an_unknown_motor_constant_is_said():
    assert "forces are in input units" in Page(render(replace(adequate_diagnosis(), plant=Plant()))).visible


def test_text_of_the_user_is_drawn_as_text():
    """Units and names that would be formulas, markup or half characters elsewhere: no picture is lost to them."""
    plant = Plant(16.0, position_unit="$\\mum$", force_unit="\\frac{N}$", input_unit="<b>" + "V" * 5000)
    name = "mo\udcffves $x^{$ <script>\n" + "long " * 1000
    recording = replace(fake_recording("run", n=200), name=name)
    found = replace(fake_diagnosis(n=10), plant=plant, recordings=(recording,), case=name)
    page = Page(render(found).encode("utf-8", "backslashreplace").decode())
    assert "could not be drawn" not in page.visible
    assert sum(attrs["data-name"] == "time" for attrs in page.charts) == 4
    assert page.tags.count("script") == 1


def test_a_picture_that_cannot_be_drawn_costs_the_picture(monkeypatch):
    def broken(*_):
        raise ValueError("no ink")

    whole = Page(render(fake_diagnosis(n=200)))
    monkeypatch.setattr("frictionjax.report.figures.limits", broken)
    page = Page(render(fake_diagnosis(n=200)))
    assert "this picture could not be drawn (ValueError: no ink)" in page.visible
    assert page.visible.startswith(SUMMARY.split(". ")[0])
    assert len(whole.charts) > len(page.charts) > 0


def test_a_check_is_a_section_with_what_was_said_of_each_machine():
    found = fake_diagnosis(n=200)
    assert "On data like yours" not in Page(render(found)).visible
    page = Page(render(replace(found, check=fake_check()))).visible
    assert "On data like yours the name maxwell slip is right 5 of the 6 times that it is given (83 %" in page
    assert "what acts what is said machines right" in page
    assert "creep maxwell slip 1 of 3 no" in page and "creep creep 2 of 3 yes" in page
    assert "maxwell slip something without a name 1 of 6 no" in page
    assert "the base model alone nothing is missing 2 of 2 yes" in page


def test_a_check_where_nothing_is_named_says_what_was_simulated():
    check = replace(fake_check(), names=(), answers=fake_check().answers[-1:], machines=2, failed=0)
    page = Page(render(replace(adequate_diagnosis(), check=check))).visible
    assert "Of 2 simulated machines 2 were diagnosed right" in page
    assert "All of them are the base model alone." in page
