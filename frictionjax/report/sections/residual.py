"""The force that the base model lacks, and what of it is left after the extension."""

from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report import figures
from frictionjax.report.html import legend
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import panels
from frictionjax.report.series import holdout_first, is_extended

_INTRO = (
    "The force that the model would need in addition, at each instant, to follow the measurement, smoothed from the "
    "data. Shaded: plus and minus two standard deviations of the noise."
)


class Residual(AbstractSection):
    """For each recording the residual force and its noise band, whole and in the same close-up as above."""

    title: ClassVar[str] = "Residual force"

    def body(self, diagnosis: Diagnosis) -> str:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return ""
        extended = is_extended(diagnosis)
        pictures = panels(recordings, diagnosis.plant, extended, figures.residual)
        return f"<p>{_INTRO}</p>{legend(extended, ('band', '± 2 standard deviations'))}{pictures}"
