"""The force that the base model lacks, and what of it is left after the extension."""

from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report import figures
from frictionjax.report.html import legend
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import panels
from frictionjax.report.series import holdout_first, is_extended

_INTRO = (
    "The force that would have to be added to the model at each instant for it to follow the measurement, smoothed "
    "from the data. Shaded: plus and minus two standard deviations; what stays inside may be noise."
)


class Residual(AbstractSection):
    """For each recording the residual force over its band, the whole of it and the same close-up as above."""

    title: ClassVar[str] = "Residual force"

    def body(self, diagnosis: Diagnosis) -> str:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return ""
        extended = is_extended(diagnosis)
        pictures = panels(recordings, diagnosis.plant, extended, figures.residual)
        return f"<p>{_INTRO}</p>{legend(extended, ('band', '± 2 standard deviations'))}{pictures}"
