"""The sections of the report, in the order of the page: sentences, pictures, tables, words."""

from frictionjax.report.sections.base import AbstractSection as AbstractSection
from frictionjax.report.sections.candidates import CandidatesSection
from frictionjax.report.sections.ceiling import CeilingsSection
from frictionjax.report.sections.checked import CheckedSection
from frictionjax.report.sections.closed_loop import ClosedLoopSection
from frictionjax.report.sections.comparison import ComparisonSection, ErrorsSection
from frictionjax.report.sections.friction import FrictionSection
from frictionjax.report.sections.glossary import GlossarySection
from frictionjax.report.sections.headline import HeadlineSection
from frictionjax.report.sections.horizons import HorizonsSection
from frictionjax.report.sections.mismatch import MismatchSection, SimulationMissesSection
from frictionjax.report.sections.missing import MissingSection
from frictionjax.report.sections.parameters import ParametersSection
from frictionjax.report.sections.record import RecordSection
from frictionjax.report.sections.residual import ResidualSection

SECTIONS: tuple[AbstractSection, ...] = (
    HeadlineSection(),
    MissingSection(),
    CeilingsSection(),
    CheckedSection(),
    FrictionSection(),
    ComparisonSection(),
    ResidualSection(),
    MismatchSection(),
    SimulationMissesSection(),
    ErrorsSection(),
    HorizonsSection(),
    ClosedLoopSection(),
    ParametersSection(),
    CandidatesSection(),
    RecordSection(),
    GlossarySection(),
)
