"""The study from end to end in its quick setting: estimates, validation, tables, figures, and the program."""

import json
import math
import xml.etree.ElementTree as ElementTree

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from frictionjax.cli import main
from frictionjax.core import Estimate, InputError
from frictionjax.report.paper import paper_lines, tables, write_paper
from frictionjax.report.paper.tables import plain
from frictionjax.studies.paper import Twin, identify, motor_bench, reproduce
from frictionjax.studies.paper.validation import folded

FIGURES = ["fig2_presliding", "eq3_linearisation", "fig4a_table3_stiffness", "fig4b_response"]
FIGURES += ["fig5_breakaway", "fig6_sines"]


@pytest.fixture(scope="module")
def paper():
    stages = []
    found = reproduce(quick=True, progress=lambda stage, fraction: stages.append((stage, fraction)))
    fractions = [fraction for _, fraction in stages]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)
    assert len({stage for stage, _ in stages}) >= 5
    return found


@pytest.fixture(scope="module")
def by_name(paper):
    return {one.twin.name: one for one in paper.validations}


def test_the_fit_finds_the_twin_within_its_band(paper):
    one = paper.identified[0]
    twin, lowest = one.twin, one.fits[0]
    # The mode above the band and friction's own phase bias each by per cents; the paper's level costs stiffness.
    assert lowest.J.value == pytest.approx(twin.J, rel=0.03)
    assert lowest.stiffness.value == pytest.approx(twin.sigma0, rel=0.03)
    assert lowest.damping.value == pytest.approx(twin.sigma1 + twin.sigma2, rel=0.1)
    assert one.fit is one.fits[2]
    assert one.fit.stiffness.value < lowest.stiffness.value - 2.0 * lowest.stiffness.stderr
    assert lowest.delay.value > twin.delay / 1e4 - 3.0 * lowest.delay.stderr
    assert one.without_delay[0].delay.value == 0.0


def test_every_fit_converged_and_none_got_worse(paper):
    for one in paper.identified:
        for fit in (*one.fits, *one.without_delay):
            assert fit.converged
            assert np.all(np.diff(fit.residual_norm) <= 1e-9 * fit.residual_norm[0])


def test_zero_amplitude_is_nearer_to_the_truth_than_the_papers_level(paper):
    for one in paper.identified:
        zero, truth = one.zero_amplitude.stiffness, one.twin.sigma0
        assert abs(zero.value - truth) < 4.0 * zero.stderr
        assert abs(zero.value - truth) < abs(one.fit.stiffness.value - truth)


def test_a_lugre_machine_agrees_with_its_model(by_name):
    lugre = by_name["LuGre"]
    for sine in ("small", "large"):
        assert lugre.ratio(sine, "extrapolated") == pytest.approx(1.0, abs=0.05)
        # Identified at 0.01 V, it is too soft: the model moves further than the machine, never less.
        assert 0.9 < lugre.ratio(sine) < 1.0
    np.testing.assert_allclose(lugre.ramp_ratio_extrapolated[1:], 1.0, atol=0.05)
    assert lugre.break_away[0] == pytest.approx(lugre.break_away[2], abs=0.01)


@pytest.mark.parametrize("name", ["non-local memory", "creep", "softening bristle"])
def test_the_papers_mismatch_appears_on_the_other_three(by_name, name):
    other, lugre = by_name[name], by_name["LuGre"]
    assert other.ratio("large") > 1.15
    assert other.ratio("large") > other.ratio("small") + 0.1
    assert other.mismatch["large"] > 2.0 * lugre.mismatch["large"]


def test_only_softening_agrees_at_small_torque_and_not_at_large(by_name):
    soft, creep = by_name["softening bristle"].ramp_ratio, by_name["creep"].ramp_ratio
    assert soft[1] == pytest.approx(1.0, abs=0.08)
    assert soft[-1] > 1.3
    assert np.all(creep > 1.1)


def test_a_folded_sine_is_one_period_without_its_drift():
    t = np.arange(10_000) / 1e4
    x = 3.0 * np.sin(2.0 * np.pi * 20.0 * t + 0.4) + 7.0
    loop = folded(x, 20.0, skip=4)
    assert loop.shape == (500,)
    assert 0.5 * np.ptp(loop) == pytest.approx(3.0, rel=1e-3)
    assert np.mean(loop) == pytest.approx(0.0, abs=1e-12)


def test_levels_without_the_papers_are_refused():
    with pytest.raises(InputError, match=r"must hold the paper's 0\.01 V"):
        identify([Twin()], levels=(0.001, 0.002, 0.003))


def _numbers(value):
    if isinstance(value, dict):
        for item in value.values():
            yield from _numbers(item)
    elif isinstance(value, list):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, float):
        yield value


def test_tables_are_strict_json_and_say_what_is_lost(paper):
    text = json.dumps(tables(paper), allow_nan=False)
    found = json.loads(text)
    assert all(math.isfinite(number) for number in _numbers(found))
    assert found["fig2"]["virgin_displacement_m"]["reference"] == pytest.approx(44.936e-6, abs=5e-10)
    assert found["linearisation"]["natural_frequency_Hz"]["value"] == pytest.approx(50.329, abs=5e-4)
    assert any("Table III" in sentence for sentence in found["lost"])
    assert set(found["fig4"]) == {one.twin.name for one in paper.identified}
    assert found["fig4"]["creep"]["twin_ours"]["creep"] == 1.0
    assert found["motor_bench"] is None
    assert found["diagnoses"] == {}


def test_plain_values():
    value = {"a": np.float64("nan"), "b": (jnp.ones(2), math.inf), 1: Estimate(1.0, math.inf, "N")}
    expected = {"a": None, "b": [[1.0, 1.0], None]}
    expected["1"] = {"value": 1.0, "stderr": None, "unit": "N", "identified": True}
    assert plain(value) == expected


def test_every_figure_is_drawn_with_units_on_its_axes(paper, tmp_path):
    files = write_paper(paper, tmp_path / "new")
    assert [file.stem for file in files] == [*FIGURES, "tables"]
    for name in FIGURES:
        with Image.open(tmp_path / "new" / f"{name}.png") as picture:
            picture.load()
            assert min(picture.size) > 300
            assert len(set(picture.convert("L").resize((64, 64)).tobytes())) > 20  # not a blank sheet
        root = ElementTree.parse(tmp_path / "new" / f"{name}.svg").getroot()
        assert root.tag.endswith("svg")
        words = " ".join(
            "".join(element.itertext()) for element in root.iter() if element.tag.endswith("text")
        )
        assert any(unit in words for unit in ("(µm)", "(1)", "(Hz)", "(s)"))
    assert json.loads((tmp_path / "new" / "tables.json").read_text(encoding="utf-8"))["schema"]


def test_lines_for_the_terminal(paper):
    lines = paper_lines(paper)
    assert any("50.329 Hz" in line for line in lines)
    assert any(line.startswith("  softening bristle") for line in lines)


def only_line(text):
    (line,) = text.splitlines()
    assert line.startswith("frictionjax: error: ")
    return line


def test_the_program_writes_and_tells(paper, tmp_path, capsys, monkeypatch):
    asked = {}

    def stub(*, quick, seed, progress):
        asked.update(quick=quick, seed=seed)
        progress("presliding loop (Fig. 2)", 0.5)
        return paper

    def write(given, directory, *, explained, bench, progress):
        assert (given, explained, bench) == (paper, (), None)
        progress("drawing", 0.5)
        return [directory / "tables.json"]

    monkeypatch.setattr("frictionjax.studies.paper.reproduce", stub)
    monkeypatch.setattr("frictionjax.report.paper.write_paper", write)
    assert main(["paper", "--out", str(tmp_path / "out"), "--seed", "3"]) == 0
    told = capsys.readouterr()
    assert asked == {"quick": False, "seed": 3}
    assert told.err.splitlines() == ["presliding loop (Fig. 2) ...", "drawing ..."]
    assert str(tmp_path / "out" / "tables.json") in told.out


def test_an_output_that_is_a_file_is_found_before_the_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("frictionjax.studies.paper.reproduce", lambda **_: pytest.fail("worked in vain"))
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    assert main(["paper", "--out", str(tmp_path / "out")]) == 2
    assert "is a file" in only_line(capsys.readouterr().err)


def test_a_folder_without_the_recordings_is_found_before_the_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("frictionjax.studies.paper.reproduce", lambda **_: pytest.fail("worked in vain"))
    assert main(["paper", "--out", str(tmp_path / "out"), "--real", str(tmp_path)]) == 2
    line = only_line(capsys.readouterr().err)
    assert "there is no MultisineTypeB.mat" in line
    assert str(tmp_path) in line


def test_a_file_that_is_no_recording_is_one_line(tmp_path):
    for name in ("MultisineTypeA.mat", "MultisineTypeB.mat"):
        (tmp_path / name).write_bytes(b"not a mat file")
    with pytest.raises(InputError, match=r"MultisineType"):
        motor_bench(tmp_path)
