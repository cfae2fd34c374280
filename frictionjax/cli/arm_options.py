"""The options of `frictionjax arm`."""

import argparse
from pathlib import Path

from frictionjax.cli.common_options import json_option

ARM = (
    "arm",
    "name what is missing in the friction of each joint of a robot",
    "Refit the rigid-body model of an arm to logs of all its joints, and diagnose what it leaves of each torque. "
    "Columns are found by their names: q1, tau1, ..., or elbow.position, elbow.effort.",
    "frictionjax arm run1.csv run2.csv --holdout run3.csv --model robot.xml --out result",
    "frictionjax arm log.mcap --model robot.urdf --only elbow wrist_1 --out result",
    "frictionjax arm log.csv --model robot.xml --q A B --tau C D --joints shoulder elbow --out result",
)
"""Name, summary, description and examples of the command."""


def arm_options(command: argparse.ArgumentParser) -> None:
    """Give the `command` its options."""
    command.add_argument("inputs", nargs="+", metavar="LOG", help="logs to fit: time, positions and torques")
    command.add_argument(
        "--model", required=True, type=Path, metavar="FILE", help="the rigid bodies, as MuJoCo's XML or URDF"
    )
    command.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="where index.html, arm.json and joints/ go"
    )
    _several(
        command,
        "--holdout",
        "LOG",
        "held-out logs, which judge the result (default: the last third of a single one)",
    )
    _several(
        command,
        "--joints",
        "NAME",
        "joints of the model, in the order of the log's columns (default: by the columns' names, else all)",
    )
    _several(command, "--only", "NAME", "joints to diagnose (default: all)")
    _several(command, "--q", "COLUMN", "columns of the positions, in the order of the joints")
    _several(command, "--tau", "COLUMN", "columns of the torques, in the order of the joints")
    command.add_argument("--time", metavar="COLUMN", help="the column of time")
    command.add_argument(
        "--sample-rate", type=float, metavar="HZ", help="needed when logs have no time column"
    )
    command.add_argument(
        "--limit", type=float, metavar="GB", help="the most that is read of one file, unpacked (default: 0.5)"
    )
    json_option(command, "arm.json")


def _several(command: argparse.ArgumentParser, option: str, what: str, meaning: str) -> None:
    command.add_argument(option, nargs="+", action="extend", default=[], metavar=what, help=meaning)
