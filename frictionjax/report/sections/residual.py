"""The force that the base model lacks, and what of it is left after the extension."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report import figures
from frictionjax.report.html import legend
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import panels
from frictionjax.report.series import holdout_first, is_extended
from frictionjax.report.template import fill

_INTRO = (
    "The force that the model would need in addition, at each instant, to follow the measurement, smoothed from the "
    "data. Shaded: plus and minus two standard deviations of the noise."
)


class ResidualSection(AbstractSection):
    """For each recording the residual force and its noise band, whole and in the same close-up as above."""

    title: ClassVar[str] = "Residual force over time"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return Markup("")
        extended = is_extended(diagnosis)
        groups, notes = panels(recordings, diagnosis.plant, extended, figures.residual)
        key = legend(extended, ("band", "± 2 standard deviations"))
        return fill("charts.html.j2", intro=[_INTRO], legend=key, groups=groups, notes=notes)
