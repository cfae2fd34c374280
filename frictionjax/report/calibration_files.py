"""`save_calibration`: a calibration as JSON and as a figure, beside the store of its study."""

import io
import json
from pathlib import Path

from matplotlib.figure import Figure

from frictionjax.core import InputError
from frictionjax.core.files import write_whole
from frictionjax.core.json import plain_json
from frictionjax.report.canvas import drawing
from frictionjax.report.plots.calibration import draw_calibration
from frictionjax.studies import Calibration


def calibration_json(found: Calibration) -> str:
    """What a calibration `found`, as strict JSON text."""
    content = {
        "draws": found.draws,
        "failed": found.failed,
        "sentences": found.sentences,
        "ranks": [one._asdict() for one in found.ranks],
        "excess": found.excess,
        "excess_error": found.excess_error,
        "reliability": [one._asdict() for one in found.reliability],
        "false_names": [one._asdict() for one in found.false_names],
    }
    return json.dumps(plain_json(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def save_calibration(found: Calibration, store: Path) -> tuple[Path, Path]:
    """Write what a calibration `found` beside the `store` of its study: its numbers and its figure, each whole or not
    at all.

    **Returns:** the file of the numbers, which ends in `.json`, and that of the figure, which ends in `.png`.

    **Raises:** `InputError` where they cannot be written.
    """
    numbers, picture = store.with_suffix(".json"), store.with_suffix(".png")
    with drawing():
        figure = Figure(layout="constrained")
        draw_calibration(found, figure, None)
        drawn = io.BytesIO()
        figure.savefig(drawn, format="png")
    try:
        write_whole(numbers, lambda stream: stream.write(calibration_json(found).encode()))
        write_whole(picture, lambda stream: stream.write(drawn.getvalue()))
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})",
            file=error.filename or numbers,
            cure="Choose another `--out`; the store is there",
        ) from error
    return numbers, picture
