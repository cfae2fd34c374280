"""The notebooks: executed in their small setting, and committed with the outputs of a whole run."""

import dataclasses
import json
import os
import sys
import types
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis, fake_recording
from nbclient import NotebookClient

import frictionjax as fj
from frictionjax.studies.estimator_comparison import ESTIMATORS, PARAMETERS, UNITS, EstimatorComparison
from frictionjax.studies.run import run_study

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_is_the_paper():
    assert "01_the_paper.ipynb" in [path.name for path in NOTEBOOKS]


HERE = (
    *("00_quickstart", "01a_the_open_question", "01b_which_estimator", "02_monte_carlo", "04_full_refit"),
    *("05_your_own_effect", "06_a_robot_joint"),
)
"""Notebooks whose cells are executed in this process, without their diagnosis, their fits and their studies."""

MACHINES = {
    "03_real_machines": "emps",
    "03a_motor_bench": "motor_bench",
    "03b_tribometer": "tribometer",
    "03c_pendulum": "pendulum",
}
"""Notebooks on recordings that the reader has, and their names among `MACHINES`."""

IN_A_KERNEL = [path for path in NOTEBOOKS if path.stem not in {*HERE, *MACHINES}]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_has_the_outputs_of_a_whole_run(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= 3
    outputs = [output for cell in code for output in cell["outputs"]]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output["output_type"] == "error" or output.get("name") == "stderr" for output in outputs)
    assert "/tmp/" not in json.dumps(outputs)


def _execute(stem, monkeypatch, *, small=True):
    """Execute the cells of a notebook here, in its small setting unless what is large is replaced, and return the names
    that it made."""
    monkeypatch.setenv("FRICTIONJAX_SMALL", str(int(small)))
    names: dict = {}
    for cell in nbformat.read(FOLDER / f"{stem}.ipynb", as_version=4).cells:
        if cell.cell_type == "code":
            exec(compile(cell.source, f"{stem}.ipynb", "exec"), names)
    return names


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def _write_small_case(directory):
    """Files with the names of the demo's, half a second each."""
    for k, name in enumerate(("noise_small", "breakaway", "moves", "holdout_stick", "holdout_moves")):
        recording = fake_recording(name, n=1000, seed=k)
        table = np.column_stack([recording.t, recording.u, (1.0 + 0.1 * k) * recording.x])
        np.savetxt(Path(directory) / f"{name}.csv", table, delimiter=",", header="t,u,x", comments="")
    return Path(directory) / "case.toml"


def test_the_quickstart_leads_from_files_to_a_verdict(monkeypatch, capsys, tmp_path):
    """All of it but the diagnosis itself, which other tests make."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    given = []
    monkeypatch.setattr("frictionjax.demo.write_demo_case", _write_small_case)
    monkeypatch.setattr("frictionjax.api.diagnose", lambda case: given.append(case) or fake_diagnosis())
    names = _execute("00_quickstart", monkeypatch)
    (case,) = given
    assert [one.role for one in case.recordings] == ["fit"] * 3 + ["holdout"] * 2
    assert case.plant == fj.Plant(16.0, position_unit="rad", force_unit="N*m", input_unit="V")
    assert names["again"].verdict == names["found"].verdict == "named"
    assert "maxwell_slip is named" in capsys.readouterr().out
    assert (names["folder"] / "result" / "report.html").is_file()


def _fitted(drive, data, **_):
    """What a fit of `drive` returns where it reaches the truth of notebooks 04 and 05; fits have their own tests."""
    friction = fj.LuGre(sigma0=1e5, sigma1=316.2, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3)
    effects = tuple(type(effect)(cubic=2e3) for effect in drive.effects)
    found = fj.Drive(1.0, friction, drive.motor_constant, effects)
    names = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", *(["cubic"] if effects else []))
    values = {"J": 1.0, "cubic": 2e3} | {name: float(getattr(friction, name)) for name in names[1:7]}
    estimates = {name: fj.Estimate(values[name], 0.01 * values[name], f"unit of {name}") for name in names}
    covariance = np.diag([estimates[name].stderr ** 2 for name in names])
    return fj.FitResult(
        found, estimates, names, covariance, covariance, {}, 0.0, True, f"Fitted {len(names)}.", ()
    )


def test_the_full_refit_is_compared_and_drawn(monkeypatch, capsys):
    """All of it but the fits themselves, which other tests make."""
    fitted = []
    monkeypatch.setattr(
        "frictionjax.api.fit", lambda drive, data: fitted.append(data) or _fitted(drive, data)
    )
    profile = fj.Profile("vs", 1e-3, 1e-5, np.array([0.97e-3, 1.03e-3]), np.array([9.0, 9.0]), "m/s")
    monkeypatch.setattr("frictionjax.api.profile_likelihood", lambda result, name: profile)
    said = types.SimpleNamespace(sentences=("A sentence.",))
    monkeypatch.setattr("frictionjax.api.identifiability", lambda result: said)
    names = _execute("04_full_refit", monkeypatch)
    assert [getattr(one, "name", None) or [r.name for r in one] for one in fitted] == [
        ["stick", "break-away", "sliding"],
        "stick",
    ]
    assert names["sk"].J.value == pytest.approx(1.0, rel=0.05)
    printed = capsys.readouterr().out
    assert "vs          not identifiable      +0.000 %                 0.0" in printed
    assert "vs: profile 0.00098" in printed
    assert "Fitted 7.\nA sentence." in printed


def test_an_effect_of_ones_own_is_simulated_and_drawn(monkeypatch, capsys):
    """All of it but the fit itself, which other tests make."""
    monkeypatch.setattr("frictionjax.api.fit", _fitted)
    names = _execute("05_your_own_effect", monkeypatch)
    assert [one.role for one in names["case"].recordings] == ["fit", "fit", "holdout"]
    assert repr(names["StiffeningHose"](cubic=2e3)) == "StiffeningHose(cubic=2000)"
    curve = names["right"].lines[0]
    np.testing.assert_allclose(curve.get_ydata(), 2e3 * (1e-3 * curve.get_xdata()) ** 3, atol=1e-12)
    printed = capsys.readouterr().out
    assert "zero strength is the base model: True" in printed
    assert "with the hose: " in printed


def _detected(rng, compliance):
    """Every second recording is noticed from 0.4 % of creep on, and a quarter is taken for another effect."""
    found = compliance >= 0.004 and rng.random() < 0.5
    creep = found and rng.random() < 0.5
    expected = 600.0 * compliance
    return {
        "detected": found,
        "named_creep": creep,
        "named_another": found and not creep,
        "expected_score": expected,
    }


def _stiffness(rng, noise, level):
    """A stiffness that falls with the level and scatters with the noise."""
    estimate = 1e5 * (1.0 - 0.1 * level) + 1e10 * noise * rng.standard_normal()
    return {"stiffness": estimate, "stiffness_stderr": 1e10 * noise, "stiffness_true": 1e5}


def test_monte_carlo_reads_its_stores_and_draws_them(monkeypatch, capsys, tmp_path):
    """All of it but what is computed for each case: the designs, the stores and the summaries are real."""
    pytest.importorskip("zarr")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    asked = []

    def canned(study, store):
        asked.append(study)
        response = isinstance(study.task, fj.ResponseTask)
        task = fj.PythonTask(_stiffness if response else _detected, units={"stiffness": "N/m"})
        return run_study(fj.Study(study.design, task, seed=study.seed), store, progress=False)

    monkeypatch.setattr("frictionjax.api.run_study", canned)
    monkeypatch.setattr(
        "frictionjax.api.compare_estimators", lambda *, draws, levels: _comparison(draws, levels)
    )
    names = _execute("02_monte_carlo", monkeypatch)
    response, naming = asked
    assert response.design.shape == {"noise": 5, "level": 2, "repeat": 32}
    # The function of the second study can be traced: what a case of it returns is what the figure needs.
    traced = jax.eval_shape(naming.task.function, jax.random.key(0), 0.01)
    assert {name: one.shape for name, one in traced.items()} == dict.fromkeys(
        ("detected", "named_creep", "named_another", "expected_score"), ()
    )
    assert float(names["size"]) == pytest.approx(600.0)
    printed = capsys.readouterr().out
    assert "320 fits, 0 of them failed" in printed
    row = names["summary"].isel(noise=0, level=1)
    assert float(row["stiffness_bias"]) == pytest.approx(-2000.0, abs=10.0)
    assert f"{float(row['stiffness_bias']):.0f} +- {float(row['stiffness_bias_mcse']):.0f}" in printed
    # Two draws, 1 % above and 3 % below the truth.
    assert "stiffness joint      bias   -1.000 +- 2.000 %, rms error   2.236 +- 0.894 %" in printed
    labels = [
        label for number in plt.get_fignums() for one in plt.figure(number).axes for label in _labels(one)
    ]
    assert len(labels) == 2 * (3 + 2 + 1)
    assert all(label.endswith(")") and "(" in label for label in labels), labels


def _labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def _comparison(draws, levels):
    """A comparison whose two draws lie 1 % above and 3 % below the truth."""
    assert draws == 2
    truth = np.array([1.0, 1e5, 316.6, 0.4, 1.0, 1.5, 1e-3])
    shape = (4, len(levels), draws, 7)
    estimates = np.broadcast_to(truth * np.array([1.01, 0.97])[:, None], shape)
    return EstimatorComparison(
        estimators=ESTIMATORS,
        parameters=PARAMETERS,
        units=UNITS,
        noise=np.asarray(levels) * 1.5e-5,
        truth=truth,
        estimates=estimates,
        stderr=np.broadcast_to(0.01 * truth, shape),
        converged=np.ones(shape[:3], bool),
        bound=np.broadcast_to(0.01 * truth, (4, len(levels), 7)),
        seconds=dict.fromkeys(ESTIMATORS, 1.0),
        excitation=0.1,
    )


@pytest.mark.slow
@pytest.mark.parametrize("stem", HERE)
def test_a_notebook_that_is_executed_here_runs_whole(stem, monkeypatch):
    for name in ("JAX_ENABLE_X64", "XLA_FLAGS", "MPLBACKEND", "FRICTIONJAX_SMALL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    notebook = nbformat.read(FOLDER / f"{stem}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()


@pytest.mark.parametrize("path", IN_A_KERNEL, ids=lambda path: path.stem)
def test_a_notebook_runs_in_its_small_setting(path, monkeypatch):
    monkeypatch.setenv("FRICTIONJAX_SMALL", "1")
    # As a user's kernel starts: without the strictness of this test session.
    for name in ("JAX_ENABLE_X64", "XLA_FLAGS", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()
    printed = "".join(
        output.get("text", "")
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "stream"
    )
    assert "Traceback" not in printed
    if path.stem == "01_the_paper":
        assert "50.329 Hz" in printed
        assert "softening bristle" in printed
        images = sum("image/png" in o.get("data", {}) for c in notebook.cells for o in c.get("outputs", []))
        assert images >= 4


def test_the_open_question_is_diagnosed_and_drawn(monkeypatch, capsys):
    """All of it but the diagnosis itself, which other tests make."""
    given = []
    monkeypatch.setattr("frictionjax.api.diagnose", lambda case: given.append(case) or fake_diagnosis())
    monkeypatch.setattr("frictionjax.paper.experiments.case_of", lambda twin: f"the case of {twin.name}")
    names = _execute("01a_the_open_question", monkeypatch, small=False)
    assert given == ["the case of softening bristle"]
    before, after = names["found"].held_out_rmse()
    assert f"0.1 s ahead: {1e6 * before:.2f} -> {1e6 * after:.2f} µrad" in capsys.readouterr().out


def test_the_estimators_are_compared_and_drawn(monkeypatch, capsys):
    monkeypatch.setattr(
        "frictionjax.studies.estimator_comparison.compare_estimators",
        lambda *, draws, levels: _comparison(draws, levels),
    )
    names = _execute("01b_which_estimator", monkeypatch)
    printed = capsys.readouterr().out
    assert "joint      noise" in printed and "bias -1.00e-02" in printed
    assert len(names["axes"].lines) == len(ESTIMATORS)


def test_a_robot_joint_is_read_recorded_and_written_back(monkeypatch, capsys):
    """All of it but the diagnosis itself: the file is read, and the machine recorded, as at full size."""
    given, fake = [], fake_diagnosis()
    # An inertia of the joint's size: that of the body alone must fit into it.
    own = dataclasses.replace(fake, extended={**fake.extended, "J": fj.Estimate(0.21, 0.01, "kg*m^2")})
    monkeypatch.setattr("frictionjax.api.diagnose", lambda case: given.append(case) or own)
    names = _execute("06_a_robot_joint", monkeypatch, small=False)
    (case,) = given
    assert case.model == names["known"].model and case.plant.motor_constant == 1.0
    assert [one.role for one in case.recordings] == ["fit"] * 3 + ["holdout"]
    assert case.model.parameters["J"].value == pytest.approx(0.08 + 0.02 + 1.8 * 0.25**2)
    assert names["gravity"] == pytest.approx(1.8 * 9.81 * 0.25)
    assert all(1.0 < np.ptp(one.x) < 4.0 for one in case.recordings)
    printed = capsys.readouterr().out
    assert 'effects = [{name = "gravity_pendulum"' in printed
    assert "<joint" in printed and "lugre=" in printed


@pytest.mark.parametrize("stem", MACHINES)
def test_a_real_machine_is_reported_and_drawn(stem, monkeypatch, capsys):
    """What the notebook does with a diagnosis, where its data are absent."""
    asked, given = [], []
    t = np.arange(26_000) / 2500.0
    recordings = tuple(
        fj.Recording(role, u=np.cos(t), x=np.sin(t), sample_rate=2500.0, role=role)
        for role in ("fit", "holdout")
    )
    case = fj.Case("a machine", fj.Plant(1.0), recordings)
    monkeypatch.setattr(
        "frictionjax.studies.real_machines.load_machine", lambda name: asked.append(name) or case
    )
    monkeypatch.setattr(
        "frictionjax.api.diagnose", lambda case, **effort: given.append((case, effort)) or fake_diagnosis()
    )
    names = _execute(stem, monkeypatch, small=False)
    assert asked == [MACHINES[stem]]
    ((diagnosed, effort),) = given
    whole = fj.Effort()
    fewer = {
        "03_real_machines": {},
        "03a_motor_bench": {
            "rounds": 1,
            "screening": dataclasses.replace(whole.screening, first_forms=2, related=1),
            "refitting": dataclasses.replace(whole.refitting, residual_maps=1, map_steps=6),
        },
    }.get(stem, {"rounds": 1})
    options = {"effort": dataclasses.replace(whole, **fewer)} if fewer else {}
    assert effort == options | ({"without": ("backlash",)} if stem == "03a_motor_bench" else {})
    lengths = [one.x.size for one in diagnosed.recordings]
    assert lengths == [one.u.size for one in diagnosed.recordings]
    assert lengths == ([20_000, 20_000] if stem == "03a_motor_bench" else [26_000, 26_000])
    found = names["found"]
    before, after = found.held_out_rmse()
    assert f"0.1 s ahead: {before:.3g} -> {after:.3g} rad" in capsys.readouterr().out
    drawn = [patch.get_width() for patch in names["left"].patches]
    assert max(drawn) == max(b.excess for b in found.mismatch if b.axis in ("regime", "direction"))
    assert names["right"].get_ylabel() == "residual force (N*m)"


def test_where_the_recordings_are_absent_a_notebook_says_so(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("FRICTIONJAX_DATA", str(tmp_path))
    names = _execute("03c_pendulum", monkeypatch)
    assert names["case"] is None and names["found"] is None
    assert "Left out: " in capsys.readouterr().out


REAL = FOLDER.parents[1] / "shared" / "real"


@pytest.mark.slow
@pytest.mark.parametrize("stem", MACHINES)
@pytest.mark.skipif(not REAL.exists(), reason="the recordings are not beside the repository")
def test_a_real_machine_runs_whole(stem, monkeypatch):
    for name in ("JAX_ENABLE_X64", "XLA_FLAGS", "MPLBACKEND", "FRICTIONJAX_SMALL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("FRICTIONJAX_DATA", str(REAL))
    notebook = nbformat.read(FOLDER / f"{stem}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
