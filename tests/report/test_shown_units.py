"""Columns in deg or mA are computed in SI, and every number that a person reads is in the unit of the files."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis

from frictionjax.core import Estimate, FrictionjaxWarning
from frictionjax.core.quantities import DisplayUnit, neat, span
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.mismatch_map.axes import EstimatedMotion, _position
from frictionjax.diagnosis.verdict import Unexplained
from frictionjax.recordings import Plant, audit, case_from_files, load_case
from frictionjax.report import load_diagnosis, save_diagnosis, summary_lines
from frictionjax.report.format import quantity, shown_estimates
from frictionjax.report.sentences import improvement

DEGREES = 180.0 / np.pi
N = 600
T = np.arange(N) / 1000.0
U, X = np.cos(40.0 * T), 0.01 * np.sin(31.0 * T)


def write(folder, header, name="run.csv", x=X, u=U):
    rows = (",".join(f"{value:.12g}" for value in row) for row in zip(T, u, x, strict=True))
    (folder / name).write_text("\n".join([header, *rows]) + "\n")
    return folder / name


def read(*files, **options):
    with warnings.catch_warnings(action="ignore", category=FrictionjaxWarning):
        return case_from_files(*files, **options)


def shown(case):
    return case.plant.position_shown, case.plant.input_shown


def test_the_unit_of_the_files_is_shown_and_si_is_computed(tmp_path):
    case = read(write(tmp_path, "t [s],u [mA],x [deg]"))
    assert (case.plant.position_unit, case.plant.input_unit) == ("rad", "A")
    assert shown(case) == ("deg", "mA")
    np.testing.assert_allclose(case.recordings[0].x, X[:400] / DEGREES, rtol=1e-10)
    assert case.plant.shown_position == DisplayUnit("deg", pytest.approx(DEGREES), "rad")
    assert case.plant.displayed("rad/s").name == "deg/s"
    assert case.plant.displayed("N*m/rad") == "N*m/rad"


def test_one_unit_for_all_files_or_si(tmp_path):
    first = write(tmp_path, "t,u [A],x [deg]")
    alike = write(tmp_path, "t,u [A],x [degrees]", "alike.csv", x=-X)
    other = write(tmp_path, "t,u [A],x [rad]", "other.csv", x=-X)
    assert shown(read(first, alike)) == ("deg", "")
    assert shown(read(first, other)) == ("", "")
    assert shown(read(first, alike, position_unit="rad")) == ("", "")
    assert shown(read(first, alike, position_unit="deg")) == ("", "")
    assert shown(read(first, alike, units={"x": "turn/4096"})) == ("", "")
    assert shown(read(first, alike, units={"x": "turn"})) == ("turn", "")
    assert shown(read(first, alike, scale={"x": 2.0})) == ("", "")


def test_a_case_file_shows_what_its_files_have_unless_it_names_a_unit(tmp_path):
    write(tmp_path, "t,u,x [deg]")
    with warnings.catch_warnings(action="ignore", category=FrictionjaxWarning):
        for plant, expected in (("", "deg"), ('[plant]\nposition_unit = "rad"\n', "")):
            (tmp_path / "case.toml").write_text(f'{plant}[[recording]]\nfile = "run.csv"\n')
            assert load_case(tmp_path / "case.toml").plant.position_shown == expected


def test_the_audit_speaks_the_unit_of_the_files(tmp_path):
    noise = 1e-2 * np.random.default_rng(3).normal(size=N)
    case = read(write(tmp_path, "t,u,x [deg]", x=50.0 * X + noise))
    found = audit(case.recordings[0], case.plant)
    said = " ".join(found.sentences())
    assert f"The noise of x is {found.noise_std * DEGREES:.3g} deg" in said and "rad" not in said
    assert 0.7e-2 / DEGREES < found.noise_std < 1.4e-2 / DEGREES


PLANT = replace(fake_diagnosis(n=200).plant, position_shown="deg")


def test_the_report_and_the_terminal_are_in_degrees_and_the_numbers_of_the_verdict_in_si(tmp_path):
    plain = fake_diagnosis(n=400)
    found = replace(plain, plant=PLANT)
    held = found.recordings[-1]
    assert f"{held.prediction_rmse_base * DEGREES:.3g}" in summary_lines(found)[-1]
    assert " deg " in summary_lines(found)[-1]
    assert "deg rms" in improvement(found) and "rad" not in improvement(found)
    assert f"{held.prediction_rmse_base * DEGREES:.3g}" in repr(found)
    save_diagnosis(found, tmp_path / "deg")
    save_diagnosis(plain, tmp_path / "rad")
    page = (tmp_path / "deg" / "report.html").read_text(encoding="utf-8")
    assert "deg/s" in page and "position (" in page
    # Stiffness and damping stay in SI; nothing else is in rad.
    text = page.replace("N·m/rad", "").replace("N·m·s/rad", "")
    assert "µrad" not in text and " rad" not in text and "rad/s" not in text
    verdicts = [json.loads((tmp_path / unit / "verdict.json").read_text()) for unit in ("deg", "rad")]
    for verdict in verdicts:
        assert verdict["units"]["position"] == "rad"
        verdict["plant"].pop("position_shown")
    assert verdicts[0] == verdicts[1]
    assert load_diagnosis(tmp_path / "deg").plant.position_shown == "deg"
    assert (tmp_path / "deg" / "fit" / f"{held.name}.csv").read_bytes() == (
        tmp_path / "rad" / "fit" / f"{held.name}.csv"
    ).read_bytes()


def test_the_summary_is_in_the_unit_of_the_files():
    held = replace(
        adequate_diagnosis().recordings[0],
        role="holdout",
        prediction_rmse_base=0.02,
        prediction_rmse_extended=0.01,
    )
    nothing = Unexplained(False, 0.0, "")
    said = summary_sentence("unknown", fake_diagnosis(n=200).missing, nothing, "stick", (held,),
                            position_unit=PLANT.shown_position)  # fmt: skip
    assert "from 1.15 to 0.573 deg (noise" in said


def test_places_are_in_the_unit_of_the_files():
    x = np.linspace(0.0, 0.8, 40)[None]
    axis = _position(EstimatedMotion(x, x, x, x), np.ones_like(x, dtype=bool), PLANT)
    assert axis.labels[0] == "x 0 to 5.73 deg"


def test_parameters_of_a_motion_are_shown_in_the_unit_of_the_files():
    found = shown_estimates(
        {"vs": Estimate(0.1, 0.01, "rad/s"), "sigma0": Estimate(2.0, 0.1, "N*m/rad")}, PLANT
    )
    assert (found["vs"].value, found["vs"].unit) == (pytest.approx(0.1 * DEGREES), "deg/s")
    assert found["vs"].stderr == pytest.approx(0.01 * DEGREES)
    assert found["sigma0"] == Estimate(2.0, 0.1, "N*m/rad")


def test_a_decimal_multiple_gives_way_to_a_prefix_that_reads_better():
    millimetres, degrees = DisplayUnit("mm", 1e3, "m"), DisplayUnit("deg", DEGREES, "rad")
    assert neat(0.02, millimetres) == "20 mm" and neat(2e-8, millimetres) == "20 nm"
    assert neat(2e-8, degrees).endswith("e-06 deg")
    assert span(0.1, 0.2, degrees) == "5.73 to 11.5 deg"
    assert quantity(3e-8, millimetres) == "30.0 nm" and quantity(0.5, millimetres) == "500 mm"
    assert quantity(3e-8, degrees).endswith("deg")
    assert Plant(position_unit="m", position_shown="µm").shown_position.suits(1e-12) is False
