"""What is missing, one card for each named effect, and what stays unexplained."""

from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis, MissingEffect
from frictionjax.report.format import estimate_text, p_value, percent, unit_text, words
from frictionjax.report.html import text
from frictionjax.report.sections.base import AbstractSection


class Missing(AbstractSection):
    """Name, size, place, confidence, and the experiment that would split a class of look-alikes."""

    title: ClassVar[str] = "What is missing"

    def body(self, diagnosis: Diagnosis) -> str:
        cards = "".join(_card(found) for found in diagnosis.missing)
        unexplained = diagnosis.unexplained
        if unexplained.present:
            where = f" ({unexplained.where})" if unexplained.where else ""
            cards += (
                '<div class="card"><p class="name">Unexplained</p><p>No effect of the catalogue explains '
                f"{text(percent(unexplained.share))} of the mismatch{text(where)}.</p></div>"
            )
        return f'<div class="cards wide">{cards}</div>' if cards else ""


def _card(found: MissingEffect) -> str:
    facts = [
        (words(name), f"{estimate_text(size)} {unit_text(size.unit)}".strip())
        for name, size in found.parameters.items()
    ]
    if found.where:
        facts.append(("where", found.where))
    facts.append(
        ("confidence", f"{percent(found.confidence)} (p {p_value(found.p_value)} under the base model)")
    )
    others = [words(name) for name in found.effect_class if name != found.effect]
    if others:
        facts.append(("not told apart from", ", ".join(others)))
    if found.split_by:
        facts.append(("would be split by", found.split_by))
    rows = "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in facts)
    sentence = f"<p>{text(found.sentence)}</p>" if found.sentence else ""
    name = text(words(found.effect).capitalize())
    return f'<div class="card"><p class="name">{name}</p>{sentence}<dl>{rows}</dl></div>'
