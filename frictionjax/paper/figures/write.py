"""Writes the figures of the study, and tables.json."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from frictionjax.core import InputError, Progress, silent
from frictionjax.paper.experiments import Explained, MotorBench, Paper
from frictionjax.paper.figures.bench import fig_bench
from frictionjax.paper.figures.estimators import fig_estimators
from frictionjax.paper.figures.responses import fig4a, fig4b
from frictionjax.paper.figures.sheet import save
from frictionjax.paper.figures.tables import tables
from frictionjax.paper.figures.theory import fig2, linearisation
from frictionjax.paper.figures.validation import fig5, fig6
from frictionjax.report.canvas import drawing


def write_paper(
    paper: Paper,
    directory: str | Path,
    *,
    explained: Sequence[Explained] = (),
    bench: MotorBench | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Draw every figure as PNG and SVG, and write tables.json.

    **Arguments:**

    - `paper`: from `reproduce`.
    - `directory`: where to write; made if it is not there. Files of the same names are overwritten.
    - `explained`: from `explain`; may be empty.
    - `bench`: from `motor_bench`, for one more figure.
    - `progress`: called as the work goes on.

    **Returns:** the files, in the order in which they were written: for each figure its PNG, and tables.json last.

    **Raises:** `InputError` when the directory cannot be written.
    """
    directory = Path(directory)
    figures: dict[str, Callable[[], Figure]] = {
        "fig2_presliding": lambda: fig2(paper.presliding),
        "eq3_linearisation": lambda: linearisation(paper.linearised),
        "fig4a_table3_stiffness": lambda: fig4a(paper.sweep, paper.identified),
        "fig4b_response": lambda: fig4b(paper.identified[0]),
        "fig5_breakaway": lambda: fig5(paper.validations),
        "fig6_sines": lambda: fig6(paper.validations),
    }
    if paper.comparison is not None:
        comparison = paper.comparison
        figures["comparison_estimators"] = lambda: fig_estimators(comparison)
    if bench is not None:
        figures["real_motor_bench"] = lambda: fig_bench(bench)
    written = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with drawing():
            for i, (name, draw) in enumerate(figures.items()):
                progress("drawing", i / len(figures))
                save(draw(), directory / name)
                written.append(directory / f"{name}.png")
        text = json.dumps(tables(paper, explained, bench), indent=1, ensure_ascii=False, allow_nan=False)
        (directory / "tables.json").write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})",
            file=error.filename or directory,
            cure="Choose another output directory.",
        ) from error
    progress("drawing", 1.0)
    return [*written, directory / "tables.json"]
