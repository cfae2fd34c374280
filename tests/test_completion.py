"""`frictionjax completion`: the script, sourced by a shell, completes commands, options, files and names of effects."""

import shutil
import subprocess

import pytest

from frictionjax.cli import main
from frictionjax.cli.options import parser
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
    ):
        run = subprocess.run(
            ["bash", "-c", _ASK.format(words=words)], cwd=tmp_path, capture_output=True, text=True
        )
        assert run.stdout.split() == [answer], (words, run.stderr)


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_have_every_command_and_effect(shell, capsys):
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    commands = next(iter(action.choices for action in parser()._actions if action.dest == "command"))
    assert all(name in said for name in (*commands, *catalogue()))
