"""The check on simulated machines: how often each name is right on data like the user's, and what else is said."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.checked import Check, CheckedAnswer
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import words
from frictionjax.report.html import table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.template import fill

_HOW = (
    "Machines were simulated with the inputs, rates and noise of these recordings, and each was diagnosed. {}They are "
    "no sample of the machines that are met: the numbers say how well data like these tell the explanations apart."
)
_TURNS = (
    "Every second one is the machine that was found; in the others acts, in turn, what the name is commonly taken for, "
    "as it fits these recordings best, or nothing beyond the base model. "
)
_ALONE = "All of them are the base model alone. "
_HEAD = ("what acts", "what is said", "machines", "right")


class CheckedSection(AbstractSection):
    """A sentence for each name; then one row for each thing that was said of each machine. Empty without a check."""

    title: ClassVar[str] = "On data like yours"

    def body(self, diagnosis: Diagnosis) -> Markup:
        check = diagnosis.check
        if check is None:
            return Markup("")
        how = _HOW.format(_TURNS if check.names else _ALONE)
        rows = [_row(answer, check) for answer in check.answers]
        below = table(_HEAD, rows) if rows else Markup("")
        return fill("prose.html.j2", sentences=[*check.sentences, how], below=below)


def _row(answer: CheckedAnswer, check: Check) -> tuple[str, ...]:
    total = sum(one.machines for one in check.answers if one.acting == answer.acting)
    return (
        _listed(answer.acting) or "the base model alone",
        _listed(answer.named)
        or {"adequate": "nothing is missing"}.get(answer.verdict, "something without a name"),
        f"{answer.machines} of {total}",
        "yes" if answer.right else "no",
    )


def _listed(names: tuple[str, ...]) -> str:
    return " and ".join(words(name) for name in names)
