"""`frictionjax completion`: the script, sourced by a shell, completes commands, options, files and names of effects."""

import shutil
import subprocess

import pytest

from frictionjax.cli import main
from frictionjax.cli.commands import program
from frictionjax.physics import catalogue

_ASK = """
source ./script
function=$(complete -p frictionjax | sed 's/.*-F \\([^ ]*\\).*/\\1/')
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMPREPLY=()
$function
echo "${{COMPREPLY[*]}}"
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes(capsys, tmp_path):
    assert main(["completion", "bash"]) == 0
    (tmp_path / "script").write_text(capsys.readouterr().out)
    (tmp_path / "run.csv").touch()
    for words, answer in (
        ("frictionjax di", "diagnose"),
        ("frictionjax diagnose --enc", "--encoder-step"),
        ("frictionjax diagnose ru", "run.csv"),
        ("frictionjax effects cre", "creep"),
        ("frictionjax fit run.csv --effect rip", "ripple"),
        ("frictionjax diagnose run.csv --with grav", "gravity_pendulum"),
        ("frictionjax diagnose run.csv --without creep mai", "mains_pickup"),
        ("frictionjax explain verdict.json cre", "creep"),
        ("frictionjax warm --effect del", "delay"),
        ("frictionjax diagnose --loop c", "closed"),
        ("frictionjax diagnose --loop closed ru", "run.csv"),
        ("frictionjax diagnose a.csv --holdout b.csv ru", "run.csv"),
        ("frictionjax case n", "new"),
        ("frictionjax case new ru", "run.csv"),
    ):
        run = subprocess.run(
            ["bash", "-c", _ASK.format(words=words)], cwd=tmp_path, capture_output=True, text=True
        )
        assert run.stdout.split() == [answer], (words, run.stderr)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_script_has_every_command_and_effect_and_runs_nothing(shell, capsys):
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    commands = [name for name in program() if not name.startswith("-")]
    assert "diagnose" in commands
    assert all(name in said for name in (*commands, *catalogue()))
    assert "__complete" not in said  # with which the script would ask the program at a key press
    assert "--no-json" not in said and "--empty" not in said


def test_a_name_that_a_shell_completes_is_judged_by_the_command_alone(capsys):
    assert main(["completion", "bash"]) == 0
    assert main(["effects", "crep"]) == 2
    assert "Did you mean `creep`?" in capsys.readouterr().err


def test_another_shell_is_one_line(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["completion", "tcsh"])
    assert stop.value.code == 2
    assert 'Choose from: "bash", "zsh", "fish"' in capsys.readouterr().err
