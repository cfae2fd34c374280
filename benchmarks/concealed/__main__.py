"""`python -m benchmarks.concealed`: make a sealed batch, solve it without the truth, reveal the results.

    python -m benchmarks.concealed make --cases 120 --seed 71 --out out/batch
    python -m benchmarks.concealed make --cases 120 --seed 72 --families industrial,joint --out out/joints
    python -m benchmarks.concealed solve out/batch --rivals
    python -m benchmarks.concealed reveal out/batch --out out/revealed
    python -m benchmarks.concealed series

`solve` goes on where it stopped. Hours at 120 cases. `series` prints a row for each batch whose results are kept.
"""

import argparse
import sys
from contextlib import nullcontext
from pathlib import Path

from benchmarks.concealed.seal import BrokenSeal


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.concealed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    make = verbs.add_parser("make", help="draw, simulate, write and seal a batch")
    make.add_argument("--cases", type=int, default=120)
    make.add_argument("--seed", type=int, required=True)
    make.add_argument("--out", type=Path, required=True)
    make.add_argument(
        "--families",
        type=lambda text: tuple(text.split(",")),
        default=(),
        help="families of experiments, with commas between them, in equal parts (default: the usual ones)",
    )
    solve = verbs.add_parser("solve", help="diagnose every case of a batch")
    solve.add_argument("batch", type=Path)
    solve.add_argument("--rivals", action="store_true", help="let the rivals look too")
    solve.add_argument(
        "--bic-seconds", type=float, default=0.0, help="time for refits by BIC, s a case (with --rivals)"
    )
    solve.add_argument("--workers", type=int, default=1, help="processes, each on a core of its own")
    reveal = verbs.add_parser("reveal", help="check the seal and score")
    reveal.add_argument("batch", type=Path)
    reveal.add_argument("--out", type=Path, required=True)
    reveal.add_argument(
        "--no-witness", action="store_true", help="leave out oracle and energy: nothing is simulated again"
    )
    verbs.add_parser("series", help="print a row for each batch whose results are kept")
    return parser.parse_args(arguments)


def main() -> None:
    """Run one of the verbs; what is wrong with a folder is reported in a sentence."""
    try:
        _run(parsed())
    except (BrokenSeal, FileExistsError, FileNotFoundError) as error:
        sys.exit(str(error))


def _run(options: argparse.Namespace) -> None:
    """Each imports only what it needs, and `make` nothing of the library."""
    if options.verb == "make":
        from benchmarks.concealed.composition import UnknownFamily
        from benchmarks.concealed.make import make

        try:
            value = make(options.cases, options.seed, options.out, options.families)
        except UnknownFamily as error:
            sys.exit(str(error))
        print(f"sealed: sha256 {value}")
    elif options.verb == "solve":
        from benchmarks.concealed.solve import set_up, solve, workers

        set_up(options.batch)
        with workers(options.workers, options.batch) if options.workers > 1 else nullcontext() as executor:
            solve(options.batch, rivals=options.rivals, bic_seconds=options.bic_seconds, executor=executor)
    elif options.verb == "series":
        from benchmarks.concealed.tables import kept, series

        print(series(kept()))
    else:
        from benchmarks.concealed.reveal import markdown, reveal

        results = reveal(options.batch, options.out, look=not options.no_witness)
        print(markdown(results))
        sys.stderr.write(f"written: {options.out / 'report.html'}, {options.out / 'results.json'}\n")


if __name__ == "__main__":
    main()
