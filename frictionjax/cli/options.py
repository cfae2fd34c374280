"""The commands of the program and their options."""

import argparse
from pathlib import Path
from typing import Any, NoReturn

from frictionjax import __version__
from frictionjax.cli.arm_options import ARM, arm_options
from frictionjax.cli.case_options import case_options
from frictionjax.cli.common_options import count, inputs_option, json_option
from frictionjax.cli.study_options import STUDY, study_options

_DESCRIPTION = (
    "Friction identification: where a machine differs from its model, which physics is missing, "
    "and whether the answer is confirmed on held-out recordings."
)
_FIRST_STEPS = """first steps:
  frictionjax demo                                        a simulated machine, its diagnosis, the truth
  frictionjax check run.csv                               what is in a file, in seconds
  frictionjax diagnose run.csv --out result               name what is missing
  frictionjax case new run1.csv run2.csv > case.toml      write down what the files cannot say
"""


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"frictionjax: error: {message}. See `{self.prog} --help`.\n")


def parser() -> argparse.ArgumentParser:
    """The parser of the whole program."""
    whole = _Parser(prog="frictionjax", description=_DESCRIPTION, epilog=_FIRST_STEPS)
    whole.add_argument("--version", action="version", version=f"frictionjax {__version__}")
    commands = whole.add_subparsers(dest="command", required=True, metavar="command")
    _diagnose(commands)
    arm_options(_command(commands, *ARM))
    _check(commands)
    _case(commands)
    _fit(commands)
    _frf(commands)
    _simulate(commands)
    study_options(_command(commands, *STUDY))
    _effects(commands)
    _explain(commands)
    _demo(commands)
    _paper(commands)
    _warm(commands)
    _completion(commands)
    return whole


def _command(
    commands: Any, name: str, summary: str, description: str, *examples: str
) -> argparse.ArgumentParser:
    epilog = "\n".join(["examples:", *(f"  {example}" for example in examples)]) if examples else None
    return commands.add_parser(name, help=summary, description=description, epilog=epilog)


def _diagnose(commands: Any) -> None:
    command = _command(
        commands,
        "diagnose",
        "name what is missing in the model of a recorded machine",
        "Diagnose one case: a case file, or recordings without one and the options below.",
        "frictionjax diagnose case.toml --out result",
        "frictionjax diagnose run1.csv run2.csv --holdout run3.csv --motor-constant 16 --out result",
        "frictionjax diagnose case.toml --with gravity_pendulum --without ripple --out again",
        "frictionjax diagnose case.toml --out result --check 20",
        'frictionjax diagnose log.csv --columns t=Time u="Motor Current" x=Angle --unit t=ms x=deg --out result',
    )
    inputs_option(command)
    command.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="where verdict.json, report.html and fit/ go"
    )
    command.add_argument(
        "--with",
        dest="known",
        nargs="+",
        action="extend",
        default=[],
        metavar="EFFECT",
        help="effects that act: they become part of the base model, and the rest is judged again",
    )
    command.add_argument(
        "--without",
        nargs="+",
        action="extend",
        default=[],
        metavar="EFFECT",
        help="effects that do not act: they are tested, but not named",
    )
    command.add_argument(
        "--check",
        type=count,
        metavar="N",
        help="also diagnose N simulated machines like this one: how often the name is right; goes on where it stopped",
    )
    json_option(command, "verdict.json")
    case_options(command)


def _check(commands: Any) -> None:
    command = _command(
        commands,
        "check",
        "read files, draw them, say what they contain and what could be learnt",
        "Read recordings as `diagnose` would, without fitting anything: sampling, noise, regimes of friction, faults, "
        "and which effects these recordings could show.",
        "frictionjax check run1.csv run2.csv",
        "frictionjax check case.toml --picture case.png",
    )
    inputs_option(command)
    command.add_argument(
        "--picture",
        type=Path,
        default=Path("frictionjax-check.png"),
        metavar="FILE",
        help="where the recordings are drawn, as PNG (default: %(default)s)",
    )
    json_option(command, "what is printed")
    case_options(command)


def _case(commands: Any) -> None:
    command = _command(
        commands,
        "case",
        "case files",
        "Case files: what recordings cannot say of themselves.",
        "frictionjax case new run1.csv run2.csv --holdout run3.csv > case.toml",
    )
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    new = _command(
        actions,
        "new",
        "write a commented case file for recordings",
        "Read recordings and print a case file for them, with every key explained.",
        "frictionjax case new run1.csv run2.csv --holdout run3.csv > case.toml",
    )
    new.add_argument("inputs", nargs="+", metavar="FILE", help="the recordings to fit")
    new.add_argument(
        "--out", type=Path, metavar="FILE", help="write it there, unless it exists, and not to stdout"
    )
    json_option(new, "its keys")
    case_options(new)


def _fit(commands: Any) -> None:
    command = _command(
        commands,
        "fit",
        "fit the LuGre model and the inertia, by maximum likelihood",
        "Fit the base model, with effects that are already known, to the recordings that are not held out.",
        "frictionjax fit run1.csv run2.csv --holdout run3.csv --motor-constant 16 --out fit.json",
        "frictionjax fit case.toml --effect return_spring constant_load",
    )
    inputs_option(command)
    command.add_argument(
        "--effect",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="effects to fit beside the base model",
    )
    command.add_argument("--out", type=Path, metavar="FILE", help="also write the result there, as JSON")
    json_option(command, "the fit")
    case_options(command)


def _frf(commands: Any) -> None:
    command = _command(
        commands,
        "frf",
        "frequency response of a recording in stick, and the second-order system in it",
        "Estimate the frequency response from input to position, and fit inertia, stiffness and damping to it.",
        "frictionjax frf noise.csv --band 2 150 --motor-constant 16",
    )
    inputs_option(command)
    command.add_argument(
        "--recording", metavar="NAME", help="which recording of the case (default: the first)"
    )
    command.add_argument(
        "--band",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="Hz that the second-order system is fitted to",
    )
    command.add_argument(
        "--segment", type=int, default=8192, metavar="N", help="samples of a segment (default: %(default)s)"
    )
    command.add_argument(
        "--out", type=Path, metavar="FILE", help="write frequency, response and coherence there, CSV"
    )
    json_option(command, "the fitted system")
    case_options(command)


def _simulate(commands: Any) -> None:
    command = _command(
        commands,
        "simulate",
        "run a fitted drive on a recorded input",
        "Simulate a fit of `frictionjax fit` on the inputs of recordings, from their first sample on.",
        "frictionjax simulate fit.json run3.csv --out simulated.csv",
    )
    command.add_argument("model", metavar="FIT", help="a fit, as `frictionjax fit --out` writes it")
    inputs_option(command)
    command.add_argument(
        "--recording", metavar="NAME", help="which recording of the case (default: the first)"
    )
    command.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="FILE",
        help="where t, u, measured and simulated x go, CSV",
    )
    json_option(command, "the error of the simulation")
    case_options(command)


def _effects(commands: Any) -> None:
    command = _command(
        commands,
        "effects",
        "list the effects that can be named, or describe one",
        "The catalogue of effects: what each is, where it shows, what it is confused with.",
        "frictionjax effects",
        "frictionjax effects creep",
    )
    command.add_argument("name", nargs="?", metavar="NAME", help="the effect to describe")
    json_option(command, "the same")


def _explain(commands: Any) -> None:
    command = _command(
        commands,
        "explain",
        "why an effect was named or not",
        "Read a verdict and say why an effect was named in it, was not, or could not be tested.",
        "frictionjax explain result creep",
    )
    command.add_argument("verdict", metavar="VERDICT", help="verdict.json, or the folder that holds it")
    command.add_argument("effect", metavar="EFFECT", help="the name of an effect")
    json_option(command, "the same")


def _demo(commands: Any) -> None:
    command = _command(
        commands,
        "demo",
        "diagnose a simulated machine, then compare with the truth",
        "Write a case of a simulated machine, diagnose it, and print the true model beside the verdict.",
        "frictionjax demo",
        "frictionjax demo --seed 7 --out other-demo",
    )
    command.add_argument(
        "--out",
        type=Path,
        default=Path("frictionjax-demo"),
        metavar="DIR",
        help="where the result and DIR/case go (default: %(default)s)",
    )
    command.add_argument(
        "--seed", type=int, metavar="N", help="seed of the machine's parameters and of all noise"
    )
    json_option(command, "the true model and verdict.json")


def _paper(commands: Any) -> None:
    command = _command(
        commands,
        "paper",
        "the figures and tables of Hensen, van de Molengraft, Steinbuch (2002), reproduced",
        "Run every experiment of the paper on synthetic machines, in about two minutes: figures as PNG and "
        "SVG, and tables.json with every number beside its reference value.",
        "frictionjax paper --out figures",
    )
    command.add_argument(
        "--out",
        type=Path,
        default=Path("frictionjax-paper"),
        metavar="DIR",
        help="where the figures and tables.json go (default: %(default)s)",
    )
    command.add_argument(
        "--real", type=Path, metavar="DIR", help="a folder with MultisineTypeB.mat, a motor bench"
    )
    command.add_argument(
        "--diagnose",
        action="store_true",
        help="also diagnose the twins whose friction is not LuGre: minutes more",
    )
    command.add_argument(
        "--quick", action="store_true", help="fewer data and seeds: faster, with less accurate numbers"
    )
    command.add_argument(
        "--seed", type=int, default=0, metavar="N", help="seed of all noise (default: %(default)s)"
    )
    json_option(command, "tables.json")


def _warm(commands: Any) -> None:
    command = _command(
        commands,
        "warm",
        "compile what diagnoses need, so that later ones need not wait for it",
        "Compile and keep the programs of the base model, alone and with each effect of the catalogue: minutes, once "
        "for each version and machine. What is there already is not made again.",
        "frictionjax warm",
        "frictionjax warm --effect gravity_pendulum ripple delay",
    )
    command.add_argument(
        "--effect",
        nargs="+",
        action="extend",
        metavar="EFFECT",
        help="only these effects (default: the whole catalogue)",
    )
    command.add_argument(
        "--longest",
        type=int,
        default=16384,
        metavar="SAMPLES",
        help="samples of the longest recording to come (default: %(default)s)",
    )
    json_option(command, "what was kept")


def _completion(commands: Any) -> None:
    command = _command(
        commands,
        "completion",
        "print a script with which a shell completes commands and options",
        "Print a script with which the shell completes commands, options, files and names of effects.",
        "frictionjax completion bash > ~/.local/share/bash-completion/completions/frictionjax",
        "frictionjax completion zsh > ~/.zfunc/_frictionjax",
    )
    command.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell")
