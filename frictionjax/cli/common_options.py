"""Options that several commands have."""

import argparse


def inputs_option(command: argparse.ArgumentParser) -> None:
    """The recordings of a `command`."""
    command.add_argument(
        "inputs", nargs="+", metavar="FILE", help="one case file (.toml), or the recordings to fit"
    )


def json_option(command: argparse.ArgumentParser, what: str) -> None:
    """`--json`; `what` the `command` prints then."""
    command.add_argument(
        "--json", action="store_true", help=f"print {what} as JSON on stdout, and nothing else"
    )


def count(text: str) -> int:
    """The type of an option that is a number of things, from 1 on."""
    try:
        found = int(text)
    except ValueError:
        found = 0
    if found < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return found
