"""For each recording two figures side by side: the whole of it, and a close-up where the mismatch is largest."""

from collections.abc import Callable, Sequence

from frictionjax.diagnosis.verdict import RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report.figures import Draw
from frictionjax.report.format import number
from frictionjax.report.html import picture, text
from frictionjax.report.series import zoom

MOST = 24  # recordings that are drawn: a page of hundreds is not read


def panels(recordings: Sequence[RecordingFit], plant: Plant, extended: bool, draw: Draw) -> str:
    """Both figures of every recording, under the recording's name.

    **Arguments:**

    - `recordings`: in the order of the page; past the first `MOST` they are only counted.
    - `plant`, `extended`: handed to `draw`.
    - `draw`: one of `report.figures`.

    **Returns:**

    HTML.
    """
    page = "".join(_pair(recording, plant, extended, draw) for recording in recordings[:MOST])
    left_out = len(recordings) - MOST
    if left_out > 0:
        page += (
            f'<p class="note">{left_out} more recordings are not drawn; their series are in fit/*.csv.</p>'
        )
    return page


def _pair(recording: RecordingFit, plant: Plant, extended: bool, draw: Draw) -> str:
    near = zoom(recording)
    first, last = (number(float(recording.t[k])) for k in (near.start, near.stop - 1))
    whole = _drawn(lambda: draw(recording, plant, extended, slice(None), near), f"{recording.name}, whole")
    close = _drawn(
        lambda: draw(recording, plant, extended, near), f"close-up of the tinted {first} to {last} s"
    )
    tag = ' <span class="tag">held out</span>' if recording.role == "holdout" else ""
    heading = f"<h3>{text(recording.name)}{tag}</h3>"
    return f'<section class="recording">{heading}<div class="figures">{whole}{close}</div></section>'


def _drawn(draw: Callable[[], str], caption: str) -> str:
    """A picture with its caption, or in its place why there is none: the rest of the page does not depend on it."""
    try:
        return picture(draw(), caption)
    except Exception as error:
        said = f"{caption}: this picture could not be drawn ({type(error).__name__}: {error})."
        return f'<p class="note">{text(said)}</p>'
