"""The commands beside `diagnose`: what they print, write and refuse, from files of a small motion."""

import json
import sys
import tomllib
import types
import warnings

import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis
from scipy.signal import lfilter

from frictionjax.cli import main
from frictionjax.cli.cases import OPTIONS
from frictionjax.core import Estimate, FrictionjaxWarning
from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Controller, load_case
from frictionjax.recordings.schema import CASE_KEYS, CONTROLLER_KEYS, PLANT_KEYS, RECORDING_KEYS
from frictionjax.report.save import verdict_json

N = 1200
DRIVE = Drive(J=1.0, friction=LuGre(1e5, 300.0, 0.4, 0.3, 0.4, 1e-2), motor_constant=1.0)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two logs of a mass on a spring, in a folder of their own, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    for name, seed in (("run.csv", 1.0), ("kept.csv", 1.3)):
        t = np.arange(N) / 500.0
        u = np.sin(9.0 * seed * t) + 0.2 * rng.normal(size=N)
        x = np.cumsum(np.cumsum(u - 0.3 * np.sign(u))) * 4e-6 + 1e-6 * rng.normal(size=N)
        rows = "".join(f"{1e3 * a:.6g},{b:.9g},{1e3 * c:.9g}\n" for a, b, c in zip(t, u, x, strict=True))
        (tmp_path / name).write_text("Time [ms],Current [A],Position [mm]\n" + rows)
    return tmp_path


def error(capsys) -> str:
    """The one line of an error, after warnings."""
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("frictionjax: error: ")
    return line


def read(path, **options):
    """The case, without a word on its units."""
    with warnings.catch_warnings(action="ignore", category=FrictionjaxWarning):
        return load_case(path, **options)


BOTH = ["run.csv", "--holdout", "kept.csv"]


def test_every_key_of_a_case_file_is_an_option():
    roles = {"file", "role"}  # the files themselves, and --holdout
    keys = {*PLANT_KEYS, *RECORDING_KEYS, *CASE_KEYS} - roles - {"plant", "recording", "model"}
    assert set(OPTIONS) - {"holdout"} == keys


def test_check_says_what_is_seen_and_draws_it(files, capsys):
    assert main(["check", *BOTH]) == 0
    printed = capsys.readouterr()
    assert "`Time [ms]` was read as t, `Current [A]` as u, `Position [mm]` as x." in printed.err
    assert "run (fitted):" in printed.out
    assert "1200 samples at 500 Hz, 2.4 s." in printed.out
    assert "kept (held out):" in printed.out
    assert "warmup: the recordings have no common clock" in printed.out
    assert "gravity_pendulum: the unit of the position is not one of an angle" in printed.out
    assert (files / "frictionjax-check.png").read_bytes().startswith(b"\x89PNG")


def test_check_as_json(files, capsys):
    assert main(["check", *BOTH, "--json", "--picture", "seen.png"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["plant"]["position_unit"] == "m"
    assert [one["sample_rate"] for one in content["recordings"]] == [500.0, 500.0]
    assert set(content["cannot_show"]).isdisjoint(content["could_show"])
    assert (files / "seen.png").exists()


@pytest.mark.parametrize("command", ["check", "frf", "simulate"])
def test_what_judges_nothing_needs_no_holdout(files, capsys, monkeypatch, command):
    monkeypatch.setattr("frictionjax.exchange.load_fit", lambda path: types.SimpleNamespace(drive=DRIVE))
    first = ["fit.json"] if command == "simulate" else []
    options = {"simulate": ["--out", "out.csv"], "frf": ["--segment", "256"]}.get(command, [])
    assert main([command, *first, "run.csv", "kept.csv", *options]) == 0
    printed = capsys.readouterr()
    assert "last third" not in printed.err
    if command == "check":
        assert "run (fitted):" in printed.out and "kept (fitted):" in printed.out
        assert "one of them held out (--holdout FILE" in printed.out.splitlines()[-1]


def test_check_looks_at_a_case_file_without_a_holdout(files, capsys):
    (files / "case.toml").write_text('[[recording]]\nfile = "run.csv"\n[[recording]]\nfile = "kept.csv"\n')
    assert main(["check", "case.toml"]) == 0
    assert "kept (fitted):" in capsys.readouterr().out
    assert main(["fit", "case.toml"]) == 2
    assert "no recording is held out" in error(capsys)


def test_check_refuses_a_picture_that_cannot_be_written(files, capsys):
    assert main(["check", *BOTH, "--picture", "no/folder.png"]) == 2
    assert "folder.png: cannot be written" in error(capsys)


def test_a_new_case_file_describes_what_was_read(files, capsys):
    options = [
        "--motor-constant",
        "16",
        "--loop",
        "closed",
        "--interval",
        "0:2",
        "0.1:2.3",
        "--start-time",
        "0",
        "60",
        "--controller",
        "kp=16",
        "kd=0.3",
    ]
    assert main(["case", "new", *BOTH, *options, "--out", "case.toml"]) == 0
    text = (files / "case.toml").read_text()
    table = tomllib.loads(text)
    # The position is in mm in the files: it is shown in that, unless the case file names a unit.
    assert table["plant"] == {"motor_constant": 16.0, "input_unit": "A"}
    assert [one["interval"] for one in table["recording"]] == [[0.0, 2.0], [0.1, 2.3]]
    assert table["recording"][0]["columns"] == {"t": "Time [ms]", "u": "Current [A]", "x": "Position [mm]"}
    for key in (*PLANT_KEYS, *RECORDING_KEYS, *CONTROLLER_KEYS):
        assert f"\n{key} = " in text or f"\n# {key} = " in text, key
    again = read(files / "case.toml")
    assert [(r.role, r.loop, r.start_time, r.x.size) for r in again.recordings] == [
        ("fit", "closed", 0.0, 1000),
        ("holdout", "closed", 60.1, 1100),
    ]
    assert again.controller == Controller(kp=16.0, kd=0.3)


def test_every_example_in_a_new_case_file_is_right(files, capsys):
    main(["case", "new", *BOTH])
    lines = capsys.readouterr().out.splitlines()
    keys = (*PLANT_KEYS, *RECORDING_KEYS, *CONTROLLER_KEYS, "[controller]")
    given = [
        line.removeprefix("# ") if line.split(" = ")[0].removeprefix("# ") in keys else line for line in lines
    ]
    table = tomllib.loads("\n".join(given))
    assert set(table["controller"]) == set(CONTROLLER_KEYS)
    assert set(table["plant"]) == set(PLANT_KEYS)
    assert set(table["recording"][1]) == set(RECORDING_KEYS)


def test_a_new_case_file_in_another_folder_finds_the_files(files, capsys):
    (files / "cases").mkdir()
    assert main(["case", "new", *BOTH, "--out", "cases/arm.toml"]) == 0
    file = files / "cases" / "arm.toml"
    assert [r.name for r in read(file, allow_outside=True).recordings] == ["run", "kept"]
    assert "--allow-outside" in file.read_text().splitlines()[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["case", "new", "run.csv", "--out", "kept.csv"], "exists and is not overwritten"),
        (["case", "new", "run.csv", "--out", "no/case.toml"], "there is no such folder"),
        (["case", "new", "case.toml"], "is a case file already"),
        (["check", *BOTH, "--start-time", "1", "2", "3"], "`--start-time` has 3 values for 2 files"),
        (["check", *BOTH, "--unit", "x=mm", "x=m"], "`--unit` gives `x` twice"),
        (["check", *BOTH, "--columns", "y=Position"], "unknown key `y`"),
        (["frf", *BOTH, "--recording", "rum"], "there is no recording 'rum'"),
        (["frf", *BOTH, "--out", "no/frf.csv"], "there is no such folder"),
        (["fit", *BOTH, "--effect", "crep"], "Did you mean `creep`?"),
        (["simulate", "no.json", *BOTH, "--out", "out.csv"], "no.json: the file does not exist"),
        (["effects", "crep"], "Did you mean `creep`?"),
        (["explain", "run.csv", "creep"], "is not JSON"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(files, capsys, arguments, words):
    assert main(arguments) == 2
    assert words in error(capsys)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (["--columns", "x=Position", "run.csv"], "'run.csv' is not ROLE=COLUMN, such as x=Position"),
        (["--scale", "x=big"], "'big' in 'x=big' is not a number"),
        (["--interval", "5"], "'5' is not FROM:TO, such as 0:12.5"),
        (["--interval", "a:b"], "'a:b' is not FROM:TO"),
        (["--loop", "half"], 'Invalid value "half" for --loop. Choose from: "open", "closed"'),
    ],
)
def test_a_mistyped_option_is_one_line(option, words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["check", "run.csv", *option])
    assert stop.value.code == 2
    assert words in error(capsys)


def test_the_effects_as_text_and_json(capsys):
    assert main(["effects"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split("  ")[0] == "creep" for line in lines)
    assert main(["effects", "creep"]) == 0
    text = capsys.readouterr().out
    assert "compliance [1]: " in text
    assert "Confused with: " in text
    assert main(["effects", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert set(content) == {line.split("  ")[0] for line in lines if "  " in line}
    assert content["return_spring"]["forms"]["ReturnSpring"][0]["unit"] == "force/position"


def test_explain_says_what_the_diagnosis_said(files, capsys):
    diagnosis = fake_diagnosis(n=500)
    (files / "verdict.json").write_text(json.dumps(verdict_json(diagnosis)))
    for effect in (diagnosis.missing[0].effect, diagnosis.candidates[-1].effect):
        assert main(["explain", ".", effect]) == 0
        assert capsys.readouterr().out.strip() == diagnosis.explain(effect)
    assert main(["explain", "verdict.json", "crep"]) == 2
    assert "is not an effect of the catalogue" in error(capsys)


@pytest.mark.parametrize("content", ["[]", '{"schema": "other"}', "[" * 5000])
def test_explain_refuses_what_is_no_verdict(files, capsys, content):
    (files / "verdict.json").write_text(content)
    assert main(["explain", "verdict.json", "creep"]) == 2
    assert "verdict.json" in error(capsys)


def test_explain_refuses_a_damaged_verdict(files, capsys):
    content = verdict_json(fake_diagnosis(n=500))
    del content["candidates"][0]["tested"]
    (files / "verdict.json").write_text(json.dumps(content))
    assert main(["explain", "verdict.json", "creep"]) == 2
    assert "has other fields than this version" in error(capsys)


def test_frf_prints_the_system_and_writes_the_response(files, capsys):
    u = np.random.default_rng(7).normal(size=6000)
    x = lfilter([0.0, 1e-3], [1.0, -1.8, 0.85], u)
    rows = "".join(f"{k / 500.0:.3f},{a:.9g},{b:.9g}\n" for k, (a, b) in enumerate(zip(u, x, strict=True)))
    (files / "stick.csv").write_text("t,u,x [rad]\n" + rows)
    arguments = ["frf", "stick.csv", "--segment", "256", "--out", "frf.csv"]
    assert main(arguments) == 0
    assert "129 frequencies to 250 Hz" in capsys.readouterr().out
    assert np.loadtxt("frf.csv", delimiter=",", skiprows=1).shape == (129, 5)
    assert main([*arguments, "--json", "--band", "2", "60", "--motor-constant", "2"]) == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert found["J"]["value"] > 0.0
    assert "rad" in found["stiffness"]["unit"]


FITTED = types.SimpleNamespace(
    parameters={"J": Estimate(0.5, 0.01, "kg"), "Fc": Estimate(1.0, float("inf"), "N", identified=False)},
    message="",
)


def test_fit_starts_from_the_recordings_and_keeps_what_the_case_knows(files, capsys, monkeypatch):
    called = {}

    def fit(drives, recordings, **options):
        called.update(options, drives=drives, recordings=recordings)
        options["progress"]("fitting", 0.5)
        return FITTED

    monkeypatch.setattr("frictionjax.estimation.fit", fit)
    options = ["--motor-constant", "2", "--inertia", "0.5", "--effect", "return_spring", "constant_load"]
    assert main(["fit", *BOTH, *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["J   0.5 +- 0.01 kg", "Fc  1 N (not determined)"]
    assert [r.name for r in called["recordings"]] == ["run"]
    assert called["fixed"] == ("J",)
    assert called["units"]["position"] == "m"
    for drive in called["drives"]:
        assert (float(drive.J), float(drive.motor_constant)) == (0.5, 2.0)
        assert [effect.name for effect in drive.effects] == ["return_spring", "constant_load"]


def test_fit_starts_from_the_model_of_the_case(files, monkeypatch):
    called = {}

    def fit(drives, recordings, **options):
        called.update(options, drives=drives)
        return FITTED

    monkeypatch.setattr("frictionjax.estimation.fit", fit)
    model = "[model]\nparameters = {J = 0.3, Fc = {value = 0.7, fixed = true}}\n"
    model += 'effects = [{name = "constant_load", load = {value = 0.1, fixed = true}}]\n'
    recordings = '[[recording]]\nfile = "run.csv"\n[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'
    (files / "own.toml").write_text(model + recordings)
    assert main(["fit", "own.toml", "--effect", "return_spring"]) == 0
    assert called["fixed"] == ("Fc", "load")
    for drive in called["drives"]:
        assert (float(drive.J), float(drive.friction.Fc)) == (0.3, 0.7)
        assert [effect.name for effect in drive.effects] == ["constant_load", "return_spring"]


@pytest.mark.parametrize(("linear", "said"), [(90.0, "linear"), (110.0, "held")])
def test_fit_keeps_the_likelier_input_where_it_is_to_decide(files, capsys, monkeypatch, linear, said):
    costs, kept = {"zero": 100.0, "linear": linear}, []

    def fit(drives, recordings, **options):
        return types.SimpleNamespace(**vars(FITTED), cost=costs[drives[0].hold], hold=drives[0].hold)

    monkeypatch.setattr("frictionjax.estimation.fit", fit)
    monkeypatch.setattr("frictionjax.exchange.save_fit", lambda result, path: kept.append(result.hold))
    assert main(["fit", *BOTH, "--hold", "auto", "--out", "fit.json"]) == 0
    sentence = (
        f"The input is taken to be {said} between samples, which is likelier by 10 in the log-likelihood."
    )
    assert sentence in capsys.readouterr().out
    assert kept == [min(costs, key=costs.get)]
    main(["fit", *BOTH, "--hold", "linear", "--out", "fit.json"])
    assert kept[1:] == ["linear"] and "likelier" not in capsys.readouterr().out


def test_simulate_runs_a_saved_drive_on_a_recorded_input(files, capsys, monkeypatch):
    monkeypatch.setattr("frictionjax.exchange.load_fit", lambda path: types.SimpleNamespace(drive=DRIVE))
    assert main(["simulate", "fit.json", *BOTH, "--recording", "kept", "--out", "run.csv"]) == 0
    assert "kept: x simulated from the input alone differs by" in capsys.readouterr().out
    table = np.genfromtxt("run.csv", delimiter=",", names=True)
    assert table.dtype.names == ("t", "u", "x", "x_simulated")
    assert table["x_simulated"][0] == table["x"][0]
    assert np.ptp(table["x_simulated"]) > 0.0


def test_a_terminal_shows_a_sign_of_life_before_jax_is_loaded(files, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["effects", "creep"]) == 0
    assert "loading" in capsys.readouterr().err
