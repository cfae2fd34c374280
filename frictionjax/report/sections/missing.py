"""The missing physics: one card for each named effect, and what stays unexplained."""

from typing import Any, ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis, MissingEffect
from frictionjax.recordings import Plant
from frictionjax.report.format import estimate_text, p_equals, percent, shown_estimates, unit_text, words
from frictionjax.report.meanings import form_of, meaning_of, with_amplitudes
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sentences import remainder
from frictionjax.report.template import fill

_SEVERAL = (
    "Effects are added to the model one at a time: the p-value of each is that of the model without it, with the "
    "effects that were found before it."
)


class MissingSection(AbstractSection):
    """Where the mismatch is; then each effect's name, size and confidence, and the experiment that would distinguish
    effects that these recordings cannot."""

    title: ClassVar[str] = "What is missing"

    def body(self, diagnosis: Diagnosis) -> Markup:
        missing, rest = diagnosis.missing, remainder(diagnosis)
        if not missing and not rest:
            return Markup("")
        several = len(missing) > 1
        places = [f"Where the base model fails: {found.where}." for found in missing if found.where]
        intro = [_SEVERAL] if several else places
        cards = [_card(found, diagnosis.plant, several=several) for found in missing]
        return fill("missing.html.j2", intro=intro, cards=cards, remainder=rest)


def _card(found: MissingEffect, plant: Plant, *, several: bool) -> dict[str, Any]:
    """The card of an effect; where it acts only if it is one of `several`, as the mismatch of the base model is where a
    single one does."""
    facts = [("errors that it explains", found.where)] if several and found.where else []
    for name, size in with_amplitudes(shown_estimates(found.parameters, plant)).items():
        value = f"{estimate_text(size)} {unit_text(size.unit)}".strip()
        meaning = meaning_of(f"{found.effect}.{name}")
        facts.append((words(name), f"{value} ({meaning})" if meaning else value))
    facts.append(
        ("confidence", f"{percent(found.confidence)} ({p_equals(found.p_value)} for the model without it)")
    )
    others = [words(name) for name in found.effect_class if name != found.effect]
    if others:
        facts.append(("cannot be distinguished from", ", ".join(others)))
    if found.split_by:
        facts.append(("experiment that would distinguish them", found.split_by))
    if found.next_experiment is not None:
        facts.append(("how long it must last", found.next_experiment.sentence))
    form = form_of(found)
    if form is not None:
        facts.append(("shows in", form.about.shows))
    return {
        "name": words(found.effect).capitalize(),
        "sentence": found.sentence,
        "facts": facts,
        "equation": form.about.equation if form else "",
    }
