"""Options that say of recordings what a case file would say."""

import argparse
from typing import Any

_ROLES = "t, u, x, v, force, reference, temperature, normal_force, supply, simulated"


def case_options(command: argparse.ArgumentParser) -> None:
    """Give a `command` what may be read, and the keys of a case file as options."""
    command.add_argument(
        "--allow-outside", action="store_true", help="let the case file name recordings outside of its folder"
    )
    command.add_argument(
        "--limit", type=float, metavar="GB", help="the most that is read of one file, unpacked (default: 0.5)"
    )
    group = command.add_argument_group(
        "for recordings without a case file (which sets these itself)",
        f"Roles of columns are {_ROLES}. One option may carry several values; end them with another option, or "
        "write the files first.",
    )
    group.add_argument(
        "--holdout",
        nargs="+",
        action="extend",
        default=[],
        metavar="RECORDING",
        help="held-out recordings, which judge the result (by default, the last third of a single recording)",
    )
    group.add_argument("--name", metavar="TEXT", help="name of the case (default: that of the first file)")
    group.add_argument(
        "--motor-constant", type=float, metavar="KM", help="force or torque per input unit, when known"
    )
    group.add_argument(
        "--inertia", type=float, metavar="J", help="known inertia or mass (default: identified)"
    )
    group.add_argument(
        "--encoder-step",
        type=float,
        metavar="STEP",
        help="quantum of the position sensor, position units: SI where columns say theirs",
    )
    group.add_argument(
        "--hold",
        choices=("zero", "linear", "auto"),
        help="what the input does between samples: held (default), straight to the next one, or as is likelier",
    )
    for quantity in ("position", "force", "input"):
        group.add_argument(
            f"--{quantity}-unit",
            metavar="UNIT",
            help=f"unit of {quantity}, such as {_UNITS[quantity]} (default: where columns say theirs, SI, and what is "
            "read by people in that of the columns)",
        )
    group.add_argument(
        "--sample-rate", type=float, metavar="HZ", help="needed when files have no time column"
    )
    _pairs(group, "--columns", "COLUMN", str, "the column of each role, by its header or its number")
    _pairs(
        group,
        "--unit",
        "UNIT",
        str,
        "the unit of a column, where its header does not say it: t=ms x=deg u=mA",
    )
    _pairs(
        group, "--scale", "FACTOR", float, "factors that columns are multiplied by to reach the units: u=-1"
    )
    group.add_argument(
        "--loop",
        choices=("open", "closed"),
        help="closed: the input answers to the measured position (default: open)",
    )
    _pairs(
        group,
        "--controller",
        "NUMBER",
        float,
        "kp, ki, kd, limit and rate (Hz) of the controller of the position, for closed-loop free runs: kp=16 kd=0.3",
        name="KEY",
    )
    group.add_argument(
        "--drive",
        choices=("force", "motion"),
        help="force: the input is applied; motion: the position is imposed, the force is measured (default: force)",
    )
    group.add_argument(
        "--start-time",
        nargs="+",
        type=float,
        metavar="S",
        help="s since power-on of the first sample: one, or one for each file in order, held-out files last",
    )
    group.add_argument(
        "--interval",
        nargs="+",
        type=_interval,
        metavar="FROM:TO",
        help="the part to use, s of the file's own time: one, or one for each file in order, held-out files last",
    )


_UNITS = {"position": "rad", "force": "N*m", "input": "V"}


def _pairs(group: Any, option: str, value: str, kind: type, meaning: str, name: str = "ROLE") -> None:
    def pair(text: str) -> tuple[str, Any]:
        key, sign, given = text.partition("=")
        if not sign or not key.strip() or not given.strip():
            problem = f"{text!r} is not {name}={value}, such as {_EXAMPLES[option]}"
            raise argparse.ArgumentTypeError(f"{problem}; files stand before the options")
        try:
            return key.strip(), kind(given)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{given!r} in {text!r} is not a number") from None

    group.add_argument(option, nargs="+", action="extend", type=pair, metavar=f"{name}={value}", help=meaning)


_EXAMPLES = {"--columns": "x=Position", "--unit": "x=mm", "--scale": "u=-1", "--controller": "kp=16"}


def _interval(text: str) -> tuple[float, float]:
    first, sign, last = text.partition(":")
    try:
        if not sign:
            raise ValueError
        return float(first), float(last)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not FROM:TO, such as 0:12.5; files stand before the options"
        ) from None
