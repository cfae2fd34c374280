"""The sections of the report, in the order of the page: sentences, pictures, tables, words."""

from frictionjax.report.sections.base import AbstractSection as AbstractSection
from frictionjax.report.sections.candidates import Candidates
from frictionjax.report.sections.ceiling import Ceilings
from frictionjax.report.sections.checked import Checked
from frictionjax.report.sections.closed_loop import InClosedLoop
from frictionjax.report.sections.comparison import Comparison, Errors
from frictionjax.report.sections.friction import Friction
from frictionjax.report.sections.glossary import Glossary
from frictionjax.report.sections.headline import Headline
from frictionjax.report.sections.horizons import Horizons
from frictionjax.report.sections.mismatch import Mismatch, SimulationMisses
from frictionjax.report.sections.missing import Missing
from frictionjax.report.sections.parameters import Parameters
from frictionjax.report.sections.record import Record
from frictionjax.report.sections.residual import Residual

SECTIONS: tuple[AbstractSection, ...] = (
    Headline(),
    Missing(),
    Ceilings(),
    Checked(),
    Friction(),
    Comparison(),
    Residual(),
    Mismatch(),
    SimulationMisses(),
    Errors(),
    Horizons(),
    InClosedLoop(),
    Parameters(),
    Candidates(),
    Record(),
    Glossary(),
)
