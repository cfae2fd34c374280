"""`--json`: every command prints its result alone on stdout, and what else it has to say on stderr."""

import json
import tomllib
import types

import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis

from frictionjax.cli import main
from frictionjax.cli.commands import below, program
from frictionjax.cli.study_file import EXAMPLE
from frictionjax.physics import Drive, LuGre
from frictionjax.report.save import verdict_json

DRIVE = Drive(J=1.0, friction=LuGre(1e5, 300.0, 0.4, 0.3, 0.4, 1e-2), motor_constant=1.0)


@pytest.fixture
def log(tmp_path, monkeypatch):
    """A log whose columns are found by a guess, with a warning, in the working directory."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(900) / 500.0
    rows = zip(t, np.cos(9.0 * t), 1e-3 * np.sin(7.0 * t), strict=True)
    lines = ["Time [s],Current [A],Position [m]", *(f"{a:.6g},{b:.9g},{c:.9g}" for a, b, c in rows)]
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def printed(capsys, *arguments):
    """What the command prints as JSON, and what it says on stderr."""
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_every_command_can_print_json():
    plain = {"completion"}  # the script of a shell
    found = {
        command.name[0]: [name for one in command.assemble_argument_collection() for name in one.names]
        for command in below(program())
    }
    assert len(found) == 14
    assert [name for name, options in found.items() if "--json" not in options and name not in plain] == []


def test_explain_as_json(tmp_path, capsys):
    diagnosis = fake_diagnosis(n=200)
    content = verdict_json(diagnosis)
    (tmp_path / "verdict.json").write_text(json.dumps(content))
    for effect, named in ((diagnosis.missing[0].effect, True), (diagnosis.candidates[-1].effect, False)):
        found, _ = printed(capsys, "explain", str(tmp_path), effect)
        assert (found["effect"], found["named"]) == (effect, named)
        assert found["explanation"] == diagnosis.explain(effect)
        assert found["candidate"] in content["candidates"]


def test_a_new_case_file_as_json(log, capsys):
    found, said = printed(capsys, "case", "new", "run.csv", "--out", "case.toml")
    assert found == tomllib.loads((log / "case.toml").read_text())
    assert found["recording"][0]["columns"]["x"] == "Position [m]"
    assert "was read as t" in said


def test_a_simulation_as_json(log, capsys, monkeypatch):
    monkeypatch.setattr("frictionjax.exchange.load_fit", lambda path: types.SimpleNamespace(drive=DRIVE))
    found, said = printed(capsys, "simulate", "fit.json", "run.csv", "--out", "out.csv")
    assert "simulating ..." in said
    table = np.genfromtxt("out.csv", delimiter=",", names=True)
    error = np.sqrt(np.mean((table["x_simulated"] - table["x"]) ** 2))
    assert found["error_rms"] == pytest.approx(error, rel=1e-6) and error > 0.0
    assert (found["of"], found["unit"], found["written"]) == ("x", "m", "out.csv")


def test_the_demo_as_json(tmp_path, capsys, monkeypatch):
    truth, diagnosis = {"missing": ["creep"], "base": {"sigma0": 1810.0}}, fake_diagnosis(n=200)

    def write_demo_case(directory, *, progress):
        progress("running the demo's experiments", 0.5)
        (directory / "sealed").mkdir(parents=True)
        (directory / "sealed" / "truth.json").write_text(json.dumps(truth))
        return directory / "case.toml"

    monkeypatch.setattr("frictionjax.demo.write_demo_case", write_demo_case)
    monkeypatch.setattr("frictionjax.recordings.load_case", lambda path: None)
    monkeypatch.setattr("frictionjax.report.check_writable", lambda out, case: None)
    monkeypatch.setattr("frictionjax.api.diagnose", lambda case, **options: diagnosis)
    found, said = printed(capsys, "demo", "--out", str(tmp_path))
    assert found["truth"] == truth
    assert found["diagnosis"] == json.loads((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    assert "running the demo's experiments ..." in said


def test_the_example_of_a_design_as_json(capsys):
    assert printed(capsys, "study", "--example")[0] == tomllib.loads(EXAMPLE)
