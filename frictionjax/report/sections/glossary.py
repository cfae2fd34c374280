"""The words of the report."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import is_extended
from frictionjax.report.template import fill

TERMS = (
    (
        "base model",
        "Inertia, motor and LuGre friction, or your own model, with the parameters that fit best.",
    ),
    ("extended model", "The base model with the named effects, all parameters fitted again."),
    ("held out", "A recording that was used for no fit, only to judge the models."),
    ("0.1 s ahead", "Predicted from all samples up to 0.1 s before; drift over longer times does not count."),
    ("free run", "Simulated from the first sample and the input alone."),
    ("noise floor", "The error that a perfect model would leave, from the noise of the sensor."),
    ("residual force", "The force that a model would need in addition to move as the machine did."),
    ("stick", "The machine hardly moves: the contact is bent elastically."),
    ("presliding", "Motion of micrometres before break-away, elastic with hysteresis."),
    ("break-away", "Where presliding ends and sliding begins; the force there is static friction."),
    ("sliding", "Motion beyond break-away; slow sliding is where friction falls with speed (Stribeck)."),
    ("mismatch", "What the base model fails to predict; the map says where it is."),
    ("share, excess", "Share of the whole mismatch; power of the errors over what noise alone would give."),
    (
        "p-value",
        "How probable errors as large as these would be without the effect; small means: not by chance.",
    ),
    ("confidence", "How often names with such evidence are right, from simulated machines."),
    ("cannot be distinguished", "Effects that explain these recordings equally well; an experiment decides."),
    ("standard error", "The scatter of an estimate that the noise of these recordings causes."),
    (
        "not determined",
        "The recordings would look the same with quite other values of this parameter.",
    ),
)
"""Terms and their meanings, in the order of the page."""


OF_EXTENSIONS = {"extended model", "confidence", "cannot be distinguished"}
"""Terms of a page with an extended model."""


class GlossarySection(AbstractSection):
    """The terms of the page, each in a sentence."""

    title: ClassVar[str] = "Glossary"

    def body(self, diagnosis: Diagnosis) -> Markup:
        named = set() if is_extended(diagnosis) else OF_EXTENSIONS
        terms = [(term, meaning) for term, meaning in TERMS if term not in named]
        return fill("glossary.html.j2", terms=terms)
