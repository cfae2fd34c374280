"""Write docs/effects.md from the catalogue: `python docs/make_effects.py`. Nothing in that page is edited by hand."""

import inspect
from pathlib import Path

from frictionjax.core import Parameter
from frictionjax.physics import effects
from frictionjax.physics.effects import AbstractEffect, catalogue

PAGE = Path(__file__).with_name("effects.md")

# The slots that an effect may fill, in the order in which they decide the family. Level comes before force: warm-up
# and asymmetry fill both, and are known as changes of the friction.
_FAMILIES = {
    "Presliding": (
        effects.AbstractBristleEffect,
        effects.AbstractSpringEffect,
        effects.AbstractSlipEffect,
        effects.AbstractDampingEffect,
        effects.AbstractCreepEffect,
    ),
    "Friction level": (effects.AbstractLevelEffect,),
    "Forces beside friction": (effects.AbstractForceEffect,),
    "Transmission and load": (effects.AbstractLoadEffect,),
    "Drive (input to force)": (effects.AbstractInputEffect,),
    "Measurement": (effects.AbstractSensorEffect,),
}
_NEEDS = {
    "sliding": "sliding",
    "presliding": "presliding",
    "rest": "rests before break-away",
    "both directions": "motion in both directions",
    "clock": "a common clock (`start_time`)",
    "angle": "positions in rad",
    "temperature": "a measured temperature",
    "motor force": "an input that drives the machine (no imposed motion)",
}
_HEAD = """# Effects that can be named

This page is written by `python docs/make_effects.py` from what each effect says of itself in the catalogue
(`frictionjax.catalogue()`). An effect may have several forms: equations that differ and carry one name. Strengths are
zero in the base model; nuisance parameters (times, periods, shapes) have no meaning while the strength is zero.

Symbols: `x` position, `v` velocity, `z` bristle deflection, `F_z` bristle force, `G` steady-state friction level, `F`
friction, `u` input, `km` motor constant. Base model: `J x'' = km u - F`, `F = sigma0 z + sigma1 z' + sigma2 v`,
`z' = v - |v| sigma0 z / G(v)`.
"""


def families() -> dict[str, list[str]]:
    """Family -> names of its effects, in the order of the page.

    **Raises:** `LookupError` for an effect that fits no family.
    """
    found: dict[str, list[str]] = {family: [] for family in _FAMILIES}
    for name, forms in catalogue().items():
        found[_family(name, forms)].append(name)
    return found


def _family(name: str, forms: tuple[type[AbstractEffect], ...]) -> str:
    if "presliding" in forms[0].about.needs:
        return "Presliding"
    for family, slots in _FAMILIES.items():
        if any(issubclass(form, slots) for form in forms):
            return family
    raise LookupError(f"{name} fits no family: add its slot to docs/make_effects.py")


def page() -> str:
    """The whole page as Markdown."""
    parts = [_HEAD]
    forms_of = catalogue()
    for family, names in families().items():
        parts += [f"## {family}\n", *(_entry(name, forms_of[name]) for name in names)]
    return "\n".join(parts)


def overview() -> str:
    """The page that leads to a page for each effect, for the site, as Markdown."""
    parts = [_HEAD]
    forms_of = catalogue()
    for family, names in families().items():
        parts.append(f"## {family}\n")
        for name in names:
            parts += [
                f"### `{name}`",
                "",
                f"{_sentence(forms_of[name])} [Equations and picture](effects/{name}.md).",
                "",
            ]
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """Effect -> its own page, for the site, as Markdown."""
    found = {}
    for name, forms in catalogue().items():
        title, _, sentence, _, *facts = _entry(name, forms, link="{}.md").split("\n")
        picture = f"![Torque against velocity and position, without and with {name}](../pictures/effects/{name}.png)"
        said = (
            "One arm, driven by the same input without and with the effect: the torque that input and motion leave "
            "over, against velocity and position in sliding, and against the displacement in stick."
        )
        back = "[All effects](../effects.md)"
        parts = (title.removeprefix("##"), sentence, picture, said, "\n".join(facts), back)
        found[name] = "\n\n".join(parts)
    return found


def _sentence(forms: tuple[type[AbstractEffect], ...]) -> str:
    sentence = forms[0].about.sentence
    return f"{sentence[0].upper()}{sentence[1:]}."


def _entry(name: str, forms: tuple[type[AbstractEffect], ...], link: str = "#{}") -> str:
    """What an effect says of itself, as Markdown; a `link` leads to the effect whose name stands in it."""
    about = forms[0].about
    facts = [
        ("Equation", f"`{about.equation}`"),
        ("Shows in", about.shows),
        ("Needs", ", ".join(_NEEDS[need] for need in about.needs)),
        ("Confused with", ", ".join(f"[`{other}`]({link.format(other)})" for other in about.confused_with)),
        ("Experiment that tells them apart", about.split_by),
    ]
    lines = [f"### `{name}`", "", _sentence(forms), ""]
    lines += [f"- {title}: {text}." for title, text in facts if text]
    source = ""
    for form in forms:
        lines.append(f"- Form `{form.__name__}`: {_first_paragraph(form)}")
        if form.about.equation != about.equation:
            lines.append(f"  Equation: `{form.about.equation}`.")
        lines.append(f"  Strengths: {_listed(form.strengths)}.")
        if form.nuisances:
            lines.append(f"  Nuisance parameters: {_listed(form.nuisances)}.")
        if form.about.source and form.about.source != source:
            source = form.about.source
            lines.append(f"  Source: {source}.")
    return "\n".join([*lines, ""])


def _first_paragraph(form: type[AbstractEffect]) -> str:
    return " ".join((inspect.getdoc(form) or "").split("\n\n")[0].split())


def _listed(parameters: tuple[Parameter, ...]) -> str:
    units = {"{force}": "force", "{position}": "position", "{input}": "input"}
    texts = []
    for one in parameters:
        unit = one.unit
        for key, word in units.items():
            unit = unit.replace(key, word)
        texts.append(f"`{one.name}` ({one.meaning}; {unit})")
    return ", ".join(texts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
