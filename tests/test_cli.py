"""The program from outside: what it prints, where, and the status with which it ends."""

import json
import signal
import subprocess
import sys
import tempfile
import types
import warnings
from dataclasses import replace

import numpy as np
import pytest
from helpers_diagnosis import SUMMARY, adequate_diagnosis, fake_check, fake_diagnosis

from frictionjax.cli import main
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.report.save import save_diagnosis
from frictionjax.studies import machines_file

pytestmark = pytest.mark.untyped

CASE = """
name = "bench"

[[recording]]
file = "run.csv"
role = "fit"
"""


class NamedCase(str):
    """Stands in for a case: its name, and no recordings."""

    recordings = ()
    model = None


@pytest.fixture
def api(monkeypatch):
    """Stands in for `frictionjax.api`: the program's own work, without minutes of fitting."""
    calls = {}

    def diagnose(case, *, known=(), without=(), progress):
        calls["case"], calls["asked"] = case, (known, without)
        progress("fitting the base model", 0.2)
        progress("fitting the base model", 0.3)
        warnings.warn(
            "noise_small: resampled,\n  0.3 % of the stamps are jittered.", FrictionjaxWarning, stacklevel=2
        )
        progress("naming what is missing", 0.9)
        return calls["diagnosis"]

    def load_case(path, **options):
        calls["options"] = options
        return NamedCase(f"case of {path}")

    def case_from_files(files, holdout, **options):
        calls["bare"] = (files, holdout, options)
        return NamedCase("bare case")

    stub = types.ModuleType("frictionjax.api")
    vars(stub).update(diagnose=diagnose, save_diagnosis=save_diagnosis, __all__=["save_diagnosis"])
    monkeypatch.setitem(sys.modules, "frictionjax.api", stub)
    monkeypatch.setattr("frictionjax.recordings.load_case", load_case)
    monkeypatch.setattr("frictionjax.recordings.case_from_files", case_from_files)
    calls["diagnosis"] = fake_diagnosis(n=500)
    calls["stub"] = stub
    return calls


def run(*arguments: str) -> subprocess.CompletedProcess:
    """The program as a process of its own."""
    command = [sys.executable, "-m", "frictionjax", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


def only_line(text: str) -> str:
    (line,) = text.splitlines()
    assert line.startswith("frictionjax: error: ")
    return line


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_an_answer_about_the_program_does_not_wait_for_jax(option):
    code = f"""
import sys
from frictionjax.cli import main
try:
    main([{option!r}])
except SystemExit as stop:
    assert not stop.code
assert not {{"jax", "numpy", "matplotlib"}} & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "frictionjax" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "command"),
        (["diagnose"], "FILE"),
        (["diagnose", "case.toml"], "--out"),
        (["diagnose", "case.toml", "--out", "out", "--frobnicate"], "--frobnicate"),
        (["diagnose", "a", "--motor-constant", "big", "--out", "out"], 'unable to convert "big" into float'),
        (["explain"], "explain"),
    ],
)
def test_options_that_make_no_sense_are_one_line(arguments, words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert words in only_line(capsys.readouterr().err)


def test_no_arguments_as_a_process():
    done = run()
    assert done.returncode == 2
    assert done.stdout == ""
    only_line(done.stderr)


def test_the_verdict_is_printed_and_the_files_are_written(api, tmp_path, capsys):
    assert main(["diagnose", "case.toml", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert api["case"] == "case of case.toml"
    assert printed.out.startswith(SUMMARY + "\n")
    (change,) = [line for line in printed.out.splitlines() if line.startswith("  holdout_stick")]
    assert " -> " in change
    assert "rad" in change
    for name in ("report.html", "verdict.json", "fit"):
        assert str(tmp_path / "out" / name) in printed.out
    assert json.loads((tmp_path / "out" / "verdict.json").read_text(encoding="utf-8"))["verdict"] == "named"


@pytest.fixture
def checking(api, monkeypatch):
    """A check that takes no time, and the digest of what it is asked for; stops once where `api["stops"]` is set."""

    def check_diagnosis(case, diagnosis, machines, *, known, without, store, progress):
        api["checks"] = [*api.get("checks", []), (case, machines, known, without, store.name)]
        machines_file.keep_machines(store.with_suffix(".json"), "asked", ())
        progress("3 of 8 cases", 0.4)
        if api.pop("stops", False):
            raise KeyboardInterrupt("The study was stopped: 3 of 8 cases are finished")
        return replace(diagnosis, check=fake_check())

    vars(api["stub"]).update(check_diagnosis=check_diagnosis)
    monkeypatch.setattr("frictionjax.studies.check.asked_of", lambda case, *, without: "asked")
    monkeypatch.setattr("frictionjax.diagnosis.intake.as_asked.accepted", lambda case, known: case)
    return api


def test_a_check_is_printed_and_saved(checking, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["diagnose", "case.toml", "--out", str(out), "--check", "8", "--without", "creep"]) == 0
    assert checking["checks"] == [("case of case.toml", 8, [], ["creep"], "check_8.zarr")]
    printed = capsys.readouterr()
    assert printed.out.splitlines()[1].startswith(
        "On data like yours the name maxwell slip is right 5 of the 6 times"
    )
    assert "3 of 8 cases ..." in printed.err.splitlines()
    kept = json.loads((out / "verdict.json").read_text(encoding="utf-8"))["check"]
    assert kept["machines"] == 11 and kept["names"][0]["right"] == 5
    assert kept["sentences"][0] in printed.out
    assert "On data like yours" in (out / "report.html").read_text(encoding="utf-8")


def test_a_stopped_check_goes_on_without_another_diagnosis(checking, tmp_path, capsys):
    out, command = tmp_path / "out", ["diagnose", "case.toml", "--out", str(tmp_path / "out")]
    checking["stops"] = True
    assert main([*command, "--check", "8"]) == 130
    assert "interrupted: The study was stopped: 3 of 8" in capsys.readouterr().err
    kept = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    assert kept["verdict"] == "named" and kept["check"] is None
    del checking["case"]
    assert main([*command, "--check", "8"]) == 0
    assert "case" not in checking and len(checking["checks"]) == 2
    assert json.loads((out / "verdict.json").read_text(encoding="utf-8"))["check"]["machines"] == 11
    assert main(command) == 0 and "case" in checking  # without a check it is diagnosed


def test_checks_of_another_case_are_replaced(checking, tmp_path, monkeypatch):
    command = ["diagnose", "case.toml", "--out", str(tmp_path), "--check", "8"]
    main(command)
    (tmp_path / "check_8.zarr").mkdir()
    (tmp_path / "check_9.json").write_text("of somebody else")
    monkeypatch.setattr("frictionjax.studies.check.asked_of", lambda case, *, without: "other")
    del checking["case"]
    main(command[:-2])
    assert "case" in checking
    assert not (tmp_path / "check_8.zarr").exists() and not (tmp_path / "check_8.json").exists()
    assert (tmp_path / "check_9.json").exists()


def test_where_nothing_was_diagnosed_there_is_nothing_to_check(checking, tmp_path, capsys):
    found = fake_diagnosis(n=200)
    untested = tuple(replace(one, tested=False) for one in found.candidates)
    checking["diagnosis"] = replace(found, candidates=untested)
    assert main(["diagnose", "case.toml", "--out", str(tmp_path), "--check", "8"]) == 0
    assert "warning: Nothing was diagnosed, so there is no answer to check." in capsys.readouterr().err
    assert "checks" not in checking


def test_without_zarr_a_check_is_refused_before_the_work(checking, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("frictionjax.core.frames.importlib.util.find_spec", lambda name: None)
    assert main(["diagnose", "case.toml", "--out", str(tmp_path), "--check", "8"]) == 2
    assert "python -m pip install 'frictionjax[studies]'" in capsys.readouterr().err
    assert "case" not in checking


def test_progress_is_a_line_a_stage_and_a_warning_is_one_line(api, tmp_path, capsys):
    line = "noise_small: resampled, 0.3 % of the stamps are jittered."
    api["diagnosis"] = replace(api["diagnosis"], warnings=(line, "holdout_stick: clipped."))
    main(["diagnose", "case.toml", "--out", str(tmp_path)])
    assert capsys.readouterr().err.splitlines() == [
        "fitting the base model ...",
        f"warning: {line}",
        "naming what is missing ...",
        "writing the report ...",
        "warning: holdout_stick: clipped.",
    ]


def test_progress_is_a_bar_on_a_terminal(api, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    main(["diagnose", "case.toml", "--out", str(tmp_path)])
    printed = capsys.readouterr().err
    assert "20 %" in printed
    assert "naming what is missing" in printed
    assert "\nwarning: noise_small" in printed.replace("\r", "\n")


def test_the_status_is_zero_whatever_the_verdict(api, tmp_path, capsys):
    api["diagnosis"] = adequate_diagnosis()
    assert main(["diagnose", "case.toml", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "No recording was held out" in printed
    assert "->" not in printed


def test_bare_recordings(api, tmp_path):
    arguments = ["run1.csv", "run2.csv", "--holdout", "run3.csv", "run4.csv", "--motor-constant", "16"]
    assert main(["diagnose", *arguments, "--sample-rate", "2e3", "--out", str(tmp_path)]) == 0
    files, holdout, options = api["bare"]
    assert (files, holdout) == (["run1.csv", "run2.csv"], ["run3.csv", "run4.csv"])
    assert (options["motor_constant"], options["sample_rate"]) == (16.0, 2000.0)
    assert api["case"] == "bare case"
    assert api["asked"] == ([], [])


def test_a_name_may_be_accepted_or_rejected(api, tmp_path):
    arguments = ["run1.csv", "--holdout", "run2.csv", "--with", "delay", "--without", "ripple", "creep"]
    assert main(["diagnose", *arguments, "--out", str(tmp_path)]) == 0
    assert api["asked"] == (["delay"], ["ripple", "creep"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["case.toml", "run.csv"], "case.toml: a case file lists its own recordings"),
        (["case.toml", "--holdout", "run.csv"], "case.toml: a case file lists its own recordings"),
        (["case.toml", "--motor-constant", "16"], "`--motor-constant` is for recordings without a case file"),
    ],
)
def test_a_case_file_stands_alone(api, tmp_path, capsys, arguments, words):
    assert main(["diagnose", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert words in only_line(capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_what_may_be_read_is_an_option(api, tmp_path):
    assert main(["diagnose", "case.toml", "--out", str(tmp_path)]) == 0
    assert api["options"] == {"allow_outside": False, "limit": None, "needs_holdout": True}
    assert main(["diagnose", "case.toml", "--allow-outside", "--limit", "2", "--out", str(tmp_path)]) == 0
    assert api["options"] == {"allow_outside": True, "limit": 2.0, "needs_holdout": True}


def test_a_request_to_end_is_a_line_and_status_143(api, tmp_path, capsys):
    before = signal.getsignal(signal.SIGTERM)

    def diagnose(case, *, known=(), without=(), progress):
        signal.raise_signal(signal.SIGTERM)

    api["stub"].diagnose = diagnose
    assert main(["diagnose", "case.toml", "--out", str(tmp_path / "out")]) == 143
    assert capsys.readouterr().err == "frictionjax: asked to end\n"
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_result_that_cannot_be_written_after_all_is_kept(api, tmp_path, capsys, monkeypatch):
    def full(diagnosis, directory):
        raise InputError("cannot be written (No space left on device)", file=directory)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    api["stub"].save_diagnosis = full
    assert main(["diagnose", "case.toml", "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out.startswith(SUMMARY)
    (saved,) = (path for path in tmp_path.iterdir() if path.name.startswith("frictionjax-"))
    assert (saved / "verdict.json").exists()
    assert f"No space left on device). The result was written into {saved} instead." in printed.err


def test_what_stands_in_the_way_of_a_recording_is_found_before_the_work(api, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(NamedCase, "recordings", (types.SimpleNamespace(name="run", x=np.zeros(3)),))
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "run.csv").write_text("mine\n")
    assert main(["diagnose", "case.toml", "--out", str(tmp_path)]) == 2
    assert "run.csv: exists and was not written by frictionjax" in only_line(capsys.readouterr().err)
    assert "case" not in api


def test_an_unwritable_directory_is_found_before_the_work(api, tmp_path, capsys):
    (tmp_path / "out").write_text("mine")
    assert main(["diagnose", "case.toml", "--out", str(tmp_path / "out")]) == 2
    assert "is a file" in only_line(capsys.readouterr().err)
    assert "case" not in api


def test_an_interrupt_is_a_line_and_status_130(api, tmp_path, capsys):
    def diagnose(case, *, known=(), without=(), progress):
        raise KeyboardInterrupt

    api["stub"].diagnose = diagnose
    assert main(["diagnose", "case.toml", "--out", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == "frictionjax: interrupted\n"
    assert not (tmp_path / "out").exists()


def test_a_terminal_that_lacks_a_letter_gets_a_question_mark(api, tmp_path, monkeypatch):
    class Ascii:
        encoding = "ascii"
        text = ""

        def write(self, text):
            text.encode("ascii")
            self.text += text

        def flush(self): ...

    api["diagnosis"] = replace(api["diagnosis"], summary="Above 20 µm.")
    monkeypatch.setattr(sys, "stdout", Ascii())
    assert main(["diagnose", "case.toml", "--out", str(tmp_path)]) == 0
    assert sys.stdout.text.startswith("Above 20 ?m.\n")


def test_the_demo_opens_its_seal_at_the_end(api, tmp_path, capsys, monkeypatch):
    truth = {
        "seed": 1,
        "missing": ["maxwell_slip"],
        "base": {"sigma0": 1810.0},
        "maxwell_slip": {"share": 0.4},
    }

    def write_demo_case(directory, *, seed=2002, progress):
        progress("running the demo's experiments", 0.5)
        (directory / "sealed").mkdir(parents=True)
        (directory / "sealed" / "truth.json").write_text(json.dumps(truth | {"seed": seed}))
        return directory / "case.toml"

    monkeypatch.setattr("frictionjax.demo.write_demo_case", write_demo_case)
    assert main(["demo", "--out", str(tmp_path), "--seed", "7"]) == 0
    printed = capsys.readouterr().out
    assert api["case"] == f"case of {tmp_path / 'case' / 'case.toml'}"
    assert json.loads((tmp_path / "case" / "sealed" / "truth.json").read_text())["seed"] == 7
    sealed = printed[printed.index("True model") :].split("\n", 1)[1]
    assert [line.split() for line in sealed.splitlines()] == [
        ["truth", "found"],
        ["missing", "maxwell_slip", "maxwell_slip/elasto_plastic"],
        ["sigma0", "1810", "1814", "+-", "1.9", "N*m/rad"],
        ["maxwell_slip", "share", "0.4", "0.42", "+-", "0.01"],
    ]


def test_a_missing_case_file(tmp_path, capsys):
    assert main(["diagnose", str(tmp_path / "no.toml"), "--out", str(tmp_path / "out")]) == 2
    assert "no.toml" in only_line(capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_a_missing_recording_as_a_process(tmp_path):
    files = [str(tmp_path / "no.csv"), "--holdout", str(tmp_path / "neither.csv")]
    done = run("diagnose", *files, "--motor-constant", "16", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "no.csv" in only_line(done.stderr)
    assert not (tmp_path / "out").exists()


def test_a_typo_in_a_key(tmp_path, capsys):
    (tmp_path / "case.toml").write_text(CASE.replace("role", "rolle"))
    assert main(["diagnose", str(tmp_path / "case.toml"), "--out", str(tmp_path / "out")]) == 2
    line = only_line(capsys.readouterr().err)
    assert "case.toml" in line
    assert "rolle" in line
    assert not (tmp_path / "out").exists()
