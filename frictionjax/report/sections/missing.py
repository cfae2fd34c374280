"""The missing physics: one card for each named effect, and what stays unexplained."""

from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis, MissingEffect
from frictionjax.report.format import estimate_text, p_equals, percent, unit_text, words
from frictionjax.report.html import text
from frictionjax.report.sections.base import AbstractSection

_SEVERAL = (
    "Effects are added to the model one at a time: the p-value of each is that of the model without it, with the "
    "effects that were found before it."
)


class Missing(AbstractSection):
    """Where the mismatch is; then each effect's name, size and confidence, and the experiment that would distinguish
    effects that these recordings cannot."""

    title: ClassVar[str] = "What is missing"

    def body(self, diagnosis: Diagnosis) -> str:
        missing = diagnosis.missing
        cards = "".join(_card(found) for found in missing)
        unexplained = diagnosis.unexplained
        if unexplained.present:
            where = f" ({unexplained.where})" if unexplained.where else ""
            cards += (
                '<div class="card"><p class="name">Unexplained</p><p>No effect of the catalogue explains '
                f"{text(percent(unexplained.share))} of the mismatch{text(where)}.</p></div>"
            )
        # The place is that of the base model's whole mismatch, so it is the same for every effect.
        places = dict.fromkeys(found.where for found in missing if found.where)
        above = [f"Where the base model fails: {place}." for place in places]
        above += [_SEVERAL] if len(missing) > 1 else []
        intro = "".join(f"<p>{text(sentence)}</p>" for sentence in above)
        return f'{intro}<div class="cards wide">{cards}</div>' if cards else ""


def _card(found: MissingEffect) -> str:
    facts = [
        (words(name), f"{estimate_text(size)} {unit_text(size.unit)}".strip())
        for name, size in found.parameters.items()
    ]
    facts.append(
        ("confidence", f"{percent(found.confidence)} ({p_equals(found.p_value)} for the model without it)")
    )
    others = [words(name) for name in found.effect_class if name != found.effect]
    if others:
        facts.append(("cannot be distinguished from", ", ".join(others)))
    if found.split_by:
        facts.append(("experiment that would distinguish them", found.split_by))
    rows = "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in facts)
    sentence = f"<p>{text(found.sentence)}</p>" if found.sentence else ""
    name = text(words(found.effect).capitalize())
    return f'<div class="card"><p class="name">{name}</p>{sentence}<dl>{rows}</dl></div>'
