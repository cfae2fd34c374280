"""The table of damaged inputs: `python -m benchmarks.hostile [--inputs 20000] [--seed 0] [--keep DIR] [--rows FILE]`.

`--extras` reads the formats of the extras. `--rows` appends the counts to a file, part by part, and goes on where an
earlier run with the same options was stopped. `--atheris READER` lets atheris choose the damage for one reader.
Exit status 1 when anything but a recording or a clean error came out.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.hostile.coverage import fuzz
from benchmarks.hostile.run import KINDS, run


def main(argv: list[str] | None = None) -> int:
    """Print the table of a run with the options in `argv`; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hostile", description=__doc__)
    parser.add_argument(
        "--inputs", type=int, default=20_000, help="of all readers together (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the first input (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="for one input (default: %(default)s)")
    parser.add_argument(
        "--gigabytes", type=float, default=2.0, help="of memory for it (default: %(default)s)"
    )
    parser.add_argument("--keep", type=Path, help="folder for the inputs that are neither read nor refused")
    parser.add_argument(
        "--extras", action="store_true", help="the formats of the extras that are installed, not the others"
    )
    parser.add_argument(
        "--rows", type=Path, help="JSON lines to which counts are appended; what is in it is not read again"
    )
    parser.add_argument("--atheris", metavar="READER", help="damage chosen by coverage, for one reader")
    options = parser.parse_args(argv)
    if options.atheris is not None:
        return fuzz(options.atheris, options.inputs, options.seed)
    with tempfile.TemporaryDirectory() as scratch:
        table = run(
            options.inputs,
            options.seed,
            Path(scratch),
            seconds=options.seconds,
            gigabytes=options.gigabytes,
            keep=options.keep,
            extras=options.extras,
            rows=options.rows,
        )
    print(f"{'reader':<20}{'inputs':>9}" + "".join(f"{kind:>14}" for kind in KINDS))
    for reader, counts in table.items():
        print(f"{reader:<20}{counts.total():>9}" + "".join(f"{counts[kind]:>14}" for kind in KINDS))
    bad = sum(counts[kind] for counts in table.values() for kind in KINDS[2:])
    print(
        f"{bad} of {sum(counts.total() for counts in table.values())} inputs were neither read nor refused in one line."
    )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
