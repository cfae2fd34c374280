"""The commands of the program: the arguments and the docstring of a function are the options and the help of each."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cyclopts import App, Parameter

from frictionjax import __version__
from frictionjax.cli.arm import arm
from frictionjax.cli.case_options import GENERAL
from frictionjax.cli.completion import completion
from frictionjax.cli.compute import fit, frf, simulate
from frictionjax.cli.docstrings import command, guide
from frictionjax.cli.look import check, effects, explain, new_case
from frictionjax.cli.study import study
from frictionjax.cli.work import demo, diagnose, paper, warm

_ABOUT = (
    "Friction identification: where a machine differs from its model, which physics is missing, "
    "and whether the answer is confirmed on held-out recordings."
)
_FIRST_STEPS = """first steps:
  frictionjax demo                           a simulated machine, and the truth
  frictionjax check run.csv                  what is in a file, in seconds
  frictionjax diagnose run.csv --out result  name what is missing
  frictionjax case new run.csv > case.toml   write down what files cannot say
"""
_CASES = "Case files: what recordings cannot say of themselves."
_COMMANDS = (diagnose, arm, check, new_case, fit, frf, simulate, study, effects, explain, demo, paper, warm,
             completion)  # fmt: skip
"""In the order of the help."""


def program(names: Sequence[str] = ()) -> App:
    """The program with all its commands.

    **Arguments:**

    - `names`: those that may stand where an effect is asked for; empty: any, and the command itself judges them
    """
    whole = App(
        "frictionjax",
        help=_ABOUT,
        help_epilogue=_FIRST_STEPS,
        help_format="plaintext",
        version=f"frictionjax {__version__}",
        # No --no-json and the like; of a flag that is off the help says nothing.
        default_parameter=Parameter(
            negative=(), show_default=lambda value: None if value is False else value
        ),
        group_parameters=GENERAL,
    )
    case = App(
        "case", help=_CASES, help_epilogue=guide(new_case).examples, sort_key=_COMMANDS.index(new_case)
    )
    for place, function in enumerate(_COMMANDS):
        if function is new_case:
            whole.command(case)
            _add(case, function, names, name="new")
        else:
            _add(whole, function, names, sort_key=place)
    whole["--help"].group = whole["--version"].group = (GENERAL,)
    return whole


def below(app: App) -> Iterator[App]:
    """The commands of an `app` that do something; a group of commands does not, those in it do."""
    if app.default_command is not None:
        yield app
    for name in app:
        if not name.startswith("-"):
            yield from below(app[name])


def _add(app: App, function: Callable[..., None], names: Sequence[str], **more: Any) -> None:
    said = guide(function)
    app.command(command(function, names), help=said.about, help_epilogue=said.examples, **more)
