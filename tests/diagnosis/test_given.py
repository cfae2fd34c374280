"""What `diagnose` takes: a path, a case, recordings or a table in memory, each made into one case."""

import sys

import numpy as np
import pytest

import frictionjax as fj

pytestmark = pytest.mark.untyped

T = np.arange(4000) / 1000.0
COLUMNS = {"t": T, "u": np.sin(7.0 * T), "x": 1e-3 * np.sin(7.0 * T - 0.3) + 1e-3 * T}
PLANT = fj.Plant(motor_constant=16.0, position_unit="rad")


@pytest.fixture
def diagnosed(monkeypatch):
    """The cases that reach the diagnosis itself, which is not made here."""
    cases = []
    module = sys.modules["frictionjax.diagnosis.diagnose"]
    monkeypatch.setattr(module, "_diagnose", lambda case, *_: cases.append(case))
    return cases


@pytest.mark.filterwarnings("ignore::frictionjax.FrictionjaxWarning")
def test_every_form_of_a_case_is_diagnosed_alike(diagnosed, tmp_path):
    file, toml = tmp_path / "run.csv", tmp_path / "case.toml"
    table = np.column_stack(list(COLUMNS.values()))
    np.savetxt(file, table, header="t,u,x", comments="", delimiter=",", fmt="%.17g")
    text = '[plant]\nmotor_constant = 16.0\nposition_unit = "rad"\n[[recording]]\nfile = "run.csv"\n'
    toml.write_text(text, encoding="utf-8")
    case = fj.load_case(toml)
    for data, plant in ((toml, None), (str(toml), None), (case, None), (file, PLANT), (COLUMNS, PLANT)):
        fj.diagnose(data, plant=plant)
    fj.diagnose(list(case.recordings))
    assert len(diagnosed) == 6
    for one in diagnosed:
        assert one.plant == PLANT
        assert [recording.role for recording in one.recordings] == ["fit", "holdout"]
        np.testing.assert_array_equal(one.fit_recordings[0].x, case.fit_recordings[0].x)


def test_what_is_no_case_never_reaches_a_diagnosis(diagnosed):
    for data in (3, [], None):
        with pytest.raises(fj.InputError, match="is not a case"):
            fj.diagnose(data)
    assert diagnosed == []
