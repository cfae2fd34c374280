"""The help of the program and how it reads its options: examples, plain text in pipes, several values, errors."""

import os
import subprocess
import sys
from itertools import pairwise

import pytest

from frictionjax.cli import main
from frictionjax.cli.commands import below, program
from frictionjax.cli.docstrings import guide

COMMANDS = [name for name in program() if not name.startswith("-") and name != "case"]
EVERY = [*([name] for name in COMMANDS), ["case"], ["case", "new"]]


def bound(*words):
    """What the arguments of a command become."""
    return program().parse_args(words, exit_on_error=False, print_error=False)[1].arguments


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_the_help_of_a_command_ends_with_its_examples(words, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*words, "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"Usage: frictionjax {' '.join(words)}")
    examples = said.rstrip().partition("\nexamples:\n")[2].splitlines()
    assert examples[0].startswith("  frictionjax ")
    # A long example goes on in the next line, as in a shell.
    assert all(line.startswith((f"  frictionjax {' '.join(words)}", "    ")) for line in examples)
    assert all(before.endswith(" \\") for before, line in pairwise(examples) if line.startswith("    "))
    assert max(len(line) for line in said.splitlines()) <= 80


def test_every_option_has_a_meaning_and_examples_are_those_of_the_docstring():
    for command in below(program()):
        said = guide(command.default_command)
        assert said.examples and said.about.endswith(".")
        for one in command.assemble_argument_collection():
            assert one.parameter.help or not one.show, (command.name, one.name)


def test_the_help_of_the_program_ends_with_first_steps(capsys):
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert "first steps:\n  frictionjax demo " in said
    places = [said.index(f" {name} ") for name in (*COMMANDS[:3], "case", *COMMANDS[3:])]
    assert places == sorted(places)  # what comes first is asked for most


def test_the_options_that_a_case_file_sets_have_a_heading(capsys):
    assert main(["check", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    first, rest = said.split("for recordings without a case file (which sets these itself)")
    assert "--limit GB" in first and "--json" in first and "[default: frictionjax-check.png]" in first
    assert all(one in rest for one in ("--columns ROLE=COLUMN...", "--holdout FILE...", "--unit ROLE=UNIT"))


@pytest.mark.parametrize(
    "words", [["--help"], ["--version"], ["diagnose", "--help"], ["diagnose", "a.csv", "--ot"], ["check"], []]
)
def test_an_answer_about_options_is_plain_in_a_pipe_and_does_not_wait_for_jax(words):
    code = f"""
import sys
from frictionjax.cli import main
try:
    status = main({words!r})
except SystemExit as stop:
    status = stop.code
heavy = {{"jax", "numpy", "matplotlib", "scipy", "frictionjax.core"}} & set(sys.modules)
assert not heavy, heavy
sys.exit(status)
"""
    coloured = os.environ | {"FORCE_COLOR": "1", "TTY_COMPATIBLE": "1", "TERM": "xterm-256color"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=coloured, timeout=600)
    asked = {"--help", "--version"} & set(words)
    assert done.returncode == (0 if asked else 2), done.stderr
    assert bool(done.stdout) == bool(asked) and len(done.stderr.splitlines()) == (0 if asked else 1)
    assert b"\x1b" not in done.stdout + done.stderr


def test_a_default_is_shown_and_a_flag_has_none(capsys):
    assert main(["paper", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "[default: frictionjax-paper]" in said and "seed of all noise [default: 0]" in said
    assert "False" not in said and "None" not in said


def test_an_option_takes_several_values_and_may_be_repeated():
    found = bound(
        "check", "a.csv", "b.csv", "--holdout", "c.csv", "d.csv", "--name", "x", "--holdout", "e.csv"
    )
    assert [str(file) for file in found["files"]] == ["a.csv", "b.csv"]
    assert [str(file) for file in found["source"].holdout] == ["c.csv", "d.csv", "e.csv"]
    pairs = ("--columns", "t=Time", "u=Motor Current", "--columns", "x=3", "--scale", "u=-1", "t=1e-3")
    source = bound("check", "a.csv", *pairs)["source"]
    assert source.columns == [("t", "Time"), ("u", "Motor Current"), ("x", "3")]
    assert source.scale == [("u", -1.0), ("t", 1e-3)]
    source = bound("check", "a.csv", "--interval", "0:1", "-1:3", "--start-time", "-5", "60")["source"]
    assert (source.interval, source.start_time) == ([(0.0, 1.0), (-1.0, 3.0)], [-5.0, 60.0])
    assert bound("frf", "a.csv", "--band", "2", "150")["band"] == (2.0, 150.0)
    assert bound("fit", "a.csv", "--effect", "creep", "ripple", "--json")["effect"] == ["creep", "ripple"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "a command is needed, one of: diagnose, arm, check, case, {rest}. See `frictionjax --help`."),
        (["case"], "a command is needed, one of: new. See `frictionjax case --help`."),
        (["check", "a", "--no-json"], "Unknown option: --no-json. Did you mean --json? {see}"),
        (["check", "a", "--empty-holdout"], "Unknown option: --empty-holdout. Did you mean --holdout? {see}"),
        (
            ["check", "a", "--columns", "x=X", "b"],
            "'b' is not ROLE=COLUMN, such as x=Position; {first}. {see}",
        ),
        (["check", "a", "--name", "x", "b"], "nothing is expected where 'b' stands; {first}. {see}"),
    ],
)
def test_an_error_says_what_is_wrong_and_where_help_stands(words, line, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    first, see = "files stand before the options", "See `frictionjax check --help`."
    rest = "fit, frf, simulate, study, effects, explain, demo, paper, warm, completion"
    expected = line.format(first=first, see=see, rest=rest)
    said = capsys.readouterr().err
    assert said.startswith("frictionjax: error: ") and said.endswith(f"{expected}\n")
    assert said.count("\n") == 1
