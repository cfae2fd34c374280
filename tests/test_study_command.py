"""`frictionjax study`: a design file becomes a store; what is wrong with it is one line and status 2."""

import json
import sys
import tomllib

import numpy as np
import pytest

import frictionjax as fj
from frictionjax.cli import main
from frictionjax.cli.study_file import EXAMPLE, study_of
from frictionjax.studies import run

pytest.importorskip("zarr")

SMALL = """
[study]
task = "simulate"
seed = 4
repeats = 2
[axes.level]
values = [0.1, 0.2]
[machine]
parameters = {J = 1.0, sigma0 = 1e5, sigma1 = 316.0, sigma2 = 0.4, Fc = 1.0, Fs = 1.5, vs = 1e-3}
[experiment]
samples = 64
"""


@pytest.fixture
def design(tmp_path, monkeypatch):
    """A small design file in the working directory."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "design.toml"
    path.write_text(SMALL)
    return path


def line(capsys):
    """The only line on stderr that is no progress."""
    lines = [text for text in capsys.readouterr().err.splitlines() if not text.endswith(" ...")]
    assert len(lines) == 1, lines
    return lines[0]


def test_a_design_file_becomes_a_store_and_is_not_run_twice(design, capsys):
    assert main(["study", "design.toml", "--out", "s.zarr"]) == 0
    printed = capsys.readouterr()
    assert (
        "4 cases (level 2, repeat 2), 0 of them failed." in printed.out and "Written: s.zarr" in printed.out
    )
    assert printed.err.splitlines()[0] == "compiling ..."
    assert main(["study", "design.toml", "--out", "s.zarr", "--resume", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["cases"], said["failed"], said["sizes"]) == (4, 0, {"level": 2, "repeat": 2})
    assert "x" in said["results"] and said["written"] == ["s.zarr"]
    found = fj.load_study("s.zarr")
    assert found["x"].shape == (2, 2, 64) and found.attrs["study"]["seed"] == 4
    assert main(["study", "design.toml", "--out", "s.zarr"]) == 2
    assert "there are results of an earlier run. Go on with `--resume`" in line(capsys)
    assert main(["study", "design.toml", "--out", "s.zarr", "--resume"]) == 0
    design.write_text(SMALL.replace("seed = 4", "seed = 5"))
    assert main(["study", "design.toml", "--out", "s.zarr", "--resume"]) == 2
    capsys_line = line(capsys)
    assert "results there are of another study: seed is 4 there and 5 here" in capsys_line


def test_an_interrupt_says_how_to_go_on(design, capsys, monkeypatch):
    def interrupted(*args, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "compute", interrupted)
    monkeypatch.setattr(run.jax, "local_devices", lambda: [None])
    assert main(["study", "design.toml", "--out", "s.zarr"]) == 130
    assert "frictionjax: interrupted: The study was stopped: 0 of 4 cases are finished. Run it again" in line(
        capsys
    )


def test_the_example_has_every_key_and_is_right(tmp_path, capsys):
    assert main(["study", "--example"]) == 0
    path = tmp_path / "example.toml"
    path.write_text(capsys.readouterr().out)
    study = study_of(path)
    assert study.design.shape == {"noise": 3, "sigma0": 2, "repeat": 20}
    np.testing.assert_allclose(study.design.table().take(np.array([119]))["noise"], 1e-7)
    assert isinstance(study.task, fj.ResponseTask) and float(study.task.machine.effects[0].load) == 0.05
    assert set(tomllib.loads(EXAMPLE)["experiment"][0]) == {f for f in vars(fj.Experiment()) if f != "role"}


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ('task = "simulate"', 'task = "fit"', fj.FitTask),
        ("repeats = 2", 'design = "random"\ncases = 8', fj.SimulationTask),
        ("repeats = 2", 'design = "sobol"\ncases = 8\ndesign_seed = 3', fj.SimulationTask),
    ],
)
def test_other_tasks_and_designs(design, old, new, kind):
    design.write_text(SMALL.replace(old, new))
    assert isinstance(study_of(design).task, kind)


def test_two_effects_of_a_design_file_are_told_apart(design):
    pair = '[discriminate]\nfirst = {name = "constant_load", load = 0.1}\nrefit_steps = 3\n'
    noisy = SMALL.replace('"simulate"', '"discriminate"').replace(
        "samples = 64", "samples = 64\nnoise = 1e-8"
    )
    design.write_text(noisy + "\n" + pair)
    task = study_of(design).task
    assert isinstance(task, fj.DiscriminationTask) and float(task.first.load) == 0.1
    assert task.second is None and task.refit_steps == 3
    design.write_text(noisy + "\n" + pair.replace("constant_load", "crepe"))
    with pytest.raises(fj.InputError, match='"crepe" is no effect of the catalogue'):
        study_of(design)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[study]", "[studies]", "`studies` is no key. Known: study, axes"),
        ("seed = 4", "sead = 4", "design.toml, [study]: `sead` is no key"),
        ("seed = 4", "seed = -4", "design.toml: `seed` is -4"),
        ("seed = 4", "seed = ", "is no TOML"),
        ("repeats = 2", "cases = 2", "a factorial design has no `cases`"),
        ("repeats = 2", 'design = "sobol"', "a sobol design needs the number of its `cases`"),
        (
            '"simulate"',
            '"guess"',
            "`task` is 'guess'. Choose one of: simulate, response, fit, diagnose, discriminate",
        ),
        ("values = [0.1, 0.2]", "value = 1", "[axes.level]: `value` is no key. Known: values, low"),
        ("values = [0.1, 0.2]", "unit = 'N'", "axis `level`: it has no values"),
        ("[axes.level]", "[axes.lewel]", "nothing of the machine or the experiment is called `lewel`"),
        ("J = 1.0, ", "", "[machine] parameters: `J` has no value"),
        ("J = 1.0", "Jay = 1.0", "`Jay` is no parameter of the base model"),
        ("[machine]", "[machine]\neffects = [{name = 'crepe'}]", '"crepe" is no effect of the catalogue'),
        ("samples = 64", "sample = 64", "[[experiment]] 1: `sample` is no key"),
        ("samples = 64", "samples = 64\n[response]\nband = [1, 2]", "[response]: the task is 'simulate'"),
    ],
)
def test_what_is_wrong_in_a_design_file_is_one_line(design, capsys, old, new, words):
    design.write_text(SMALL.replace(old, new))
    assert main(["study", "design.toml", "--out", "s.zarr"]) == 2
    said = line(capsys)
    assert said.startswith("frictionjax: error: design.toml") and words in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["study"], "a study needs a design file and `--out`"),
        (
            ["study", "none.toml", "--out", "s"],
            "none.toml: there is no such file. `frictionjax study --example",
        ),
    ],
)
def test_what_is_not_there_is_one_line(design, capsys, arguments, words):
    assert main(arguments) == 2
    assert words in line(capsys)


@pytest.mark.parametrize("option", [["--workers", "0"], ["--chunk", "many"]])
def test_a_mistyped_option_is_one_line(design, capsys, option):
    with pytest.raises(SystemExit) as stop:
        main(["study", "design.toml", "--out", "s", *option])
    assert stop.value.code == 2 and "is not a whole number from 1 on" in line(capsys)


def test_without_dask_the_command_names_what_installs_it(design, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["study", "design.toml", "--out", "s.zarr", "--dask", "tcp://127.0.0.1:1"]) == 2
    assert "python -m pip install 'frictionjax[cluster]'" in line(capsys)
