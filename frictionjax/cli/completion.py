"""The command `completion`: a script with which a shell completes commands, options, files and names of effects.

The script is written once, by shtab, from the parser itself: nothing of frictionjax runs when a key is pressed.
"""

import argparse
from typing import TYPE_CHECKING

from frictionjax.cli.terminal import Terminal, say

if TYPE_CHECKING:
    from collections.abc import Iterable

_FILES = ("FILE", "RECORDING", "FIT", "VERDICT")
_FOLDERS = ("DIR",)
_EFFECT = "EFFECT"
_NAMES_OF_EFFECTS = ("fit", "effects")
"""Commands in which a NAME is that of an effect; elsewhere it is one of a recording or a joint."""


def completion(arguments: argparse.Namespace, terminal: Terminal) -> None:
    """`frictionjax completion`."""
    import shtab

    from frictionjax.cli.options import parser
    from frictionjax.physics import catalogue

    whole = parser()
    effects = tuple(catalogue())
    for name, command in _commands(whole):
        for action in command._actions:
            if action.choices:
                continue
            if action.metavar == _EFFECT or (name in _NAMES_OF_EFFECTS and action.metavar == "NAME"):
                action.choices = effects
            elif action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif action.metavar in _FOLDERS:
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    terminal.close()
    say([shtab.complete(whole, shell=arguments.shell)])


def _commands(
    parser: argparse.ArgumentParser, name: str = ""
) -> "Iterable[tuple[str, argparse.ArgumentParser]]":
    """The name and the parser of each command under a `parser`, and of their own."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield name, command
                yield from _commands(command, name)
