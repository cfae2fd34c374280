"""The options of `frictionjax study`."""

import argparse
from pathlib import Path

from frictionjax.cli.common_options import count, json_option

STUDY = (
    "study",
    "run a Monte Carlo study or a sweep of simulated machines",
    "Compute every case of a design file, and write the results as a Zarr store. A run that was stopped goes on "
    "with --resume: nothing is computed twice.",
    "frictionjax study --example > design.toml",
    "frictionjax study design.toml --out study.zarr --workers 2",
    "frictionjax study design.toml --out study.zarr --dask tcp://host:8786 --resume",
    "frictionjax study calibrate --draws 1000 --out calibration.zarr --workers 2",
)
"""Name, summary, description and examples of the command."""


def study_options(command: argparse.ArgumentParser) -> None:
    """Give the `command` its options."""
    command.add_argument(
        "design", nargs="?", metavar="DESIGN", help="the design file, design.toml, or the word calibrate"
    )
    command.add_argument("--out", type=Path, metavar="STORE", help="the folder that becomes the store")
    command.add_argument(
        "--draws", type=count, metavar="N", help="of study calibrate: machines that are drawn and diagnosed"
    )
    command.add_argument("--example", action="store_true", help="print a design file with every key")
    command.add_argument("--resume", action="store_true", help="go on where an earlier run was stopped")
    command.add_argument(
        "--workers", type=count, metavar="N", help="processes on this machine (default: one)"
    )
    command.add_argument("--dask", metavar="ADDRESS", help="a Dask scheduler whose workers compute")
    command.add_argument(
        "--chunk",
        type=count,
        metavar="N",
        help="cases that a worker is given at a time (default: as many as take five seconds)",
    )
    json_option(command, "what the store holds")
