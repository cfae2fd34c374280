"""The field's own pictures: friction over velocity and displacement, and the residual force where an effect acts."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import words
from frictionjax.report.friction import over_displacement, over_velocity, where_it_acts
from frictionjax.report.html import figure, legend
from frictionjax.report.meanings import form_of
from frictionjax.report.motion import motions_of
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import is_extended
from frictionjax.report.template import fill

_INTRO = (
    "Measured friction is the applied force less what accelerates the inertia; that of a model is what the model would "
    "need to move as measured. Where the extended model is right, its line lies on the measured one."
)
_STILL = "No friction over velocity: these recordings do not slide."
_NO_LOOPS = "No friction over displacement: no recording turns back twice within presliding."


class FrictionSection(AbstractSection):
    """Friction over speed in sliding, over displacement in presliding, and for each named effect the residual force
    over the variable along which it shows."""

    title: ClassVar[str] = "Friction, measured and modelled"

    def body(self, diagnosis: Diagnosis) -> Markup:
        motions, extended = motions_of(diagnosis), is_extended(diagnosis)
        if not motions or not diagnosis.was_diagnosed:
            return Markup("")
        pictures, notes = [], []
        velocity = over_velocity(diagnosis, motions, extended)
        if velocity is None:
            notes.append(_STILL)
        else:
            pictures.append(
                figure(
                    lambda: velocity,
                    "Friction over speed in sliding: medians of all recordings, bin by bin (Stribeck curve)",
                )
            )
        loops = over_displacement(diagnosis, motions, extended)
        if loops is None:
            notes.append(_NO_LOOPS)
        else:
            pictures.append(figure(lambda: loops, "Friction over displacement in presliding: hysteresis"))
        for found in diagnosis.missing:
            acts = where_it_acts(found.effect, diagnosis, motions, extended)
            if acts is not None:
                name, form = words(found.effect).capitalize(), form_of(found)
                shows = f". It shows in {form.about.shows}" if form else ""
                pictures.append(
                    figure(
                        lambda chart=acts: chart,
                        f"{name}: {acts.panels[0].name} over {acts.name}{shows}",
                    )
                )
        if not pictures:
            return Markup("")
        groups = [{"title": "", "held_out": False, "figures": pictures}]
        key = legend(extended, ("measured", "measured"))
        return fill("charts.html.j2", intro=[_INTRO], legend=key, groups=groups, notes=notes)
