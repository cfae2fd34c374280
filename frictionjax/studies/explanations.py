"""Machines that may be behind recordings: the diagnosed one, and what it is commonly taken for, as fitted to them.

An effect that is commonly taken for a named one is refitted in its place, with everything else free. One that lowers
the misfit by less than what is worth a refit in a diagnosis explains nothing and is left out: its machine would be the
one without it.
"""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate, Progress
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import pace_of
from frictionjax.diagnosis.intake.coverage import not_testable
from frictionjax.diagnosis.intake.starting_point import StartingPoint, starting_point
from frictionjax.diagnosis.refitting.shortlist import confused_with, one_of_each
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.score_test import Trial, forms_to_try
from frictionjax.diagnosis.screening.try_catalogue import try_catalogue
from frictionjax.diagnosis.verdict import Diagnosis, MissingEffect
from frictionjax.estimation.descent.robust import RobustFit, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect, catalogue
from frictionjax.recordings import Case
from frictionjax.studies.experiment import changed_drive, places_of

_FORMS = 2  # of one effect that are refitted: those whose tests gain most


class Explanation(eqx.Module):
    """A machine that may be behind the recordings of a case.

    **Attributes:** `acting` (names of the effects that act beyond the base model), `drive`, `deflection` (of the
    bristle at the first sample of each recording, the fitted ones first, over Fs/sigma0, shape `(r,)`), `misfit` (per
    sample of the fitted recordings).
    """

    acting: tuple[str, ...] = eqx.field(static=True)
    drive: Drive
    deflection: Float[np.ndarray, " r"]
    misfit: float = eqx.field(static=True)


def explanations_of(
    case: Case,
    diagnosis: Diagnosis,
    executor: Executor,
    progress: Progress,
    *,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> tuple[Explanation, ...]:
    """The machine that a `diagnosis` of a `case` describes, first; then what else may be behind the recordings, the
    nearest to them first: what each named effect is commonly taken for, and the base model alone.

    **Arguments:**

    - `case`: whose base model contains what the user accepts.
    - `diagnosis`: of it.
    - `executor`: runs tests side by side.
    - `progress`: called as the machines are fitted.
    - `rule`, `effort`: those of the diagnosis.
    """
    fits = _Fits(case, diagnosis, executor, rule, effort)
    progress("the diagnosed machine", 0.0)
    first = fits.as_found(diagnosis.missing)
    if not diagnosis.missing:
        return (first,)
    others = [fits.as_found(())]
    for number, found in enumerate(diagnosis.missing):
        progress(f"what {found.effect} is commonly taken for", (number + 1) / (len(diagnosis.missing) + 1))
        others += fits.in_place_of(found)
    return first, *sorted(others, key=lambda one: one.misfit)


class _Fits:
    """Fits of machines to the recordings of a `case`, beside its `diagnosis`; `executor`, `rule` and `effort` as in
    `explanations_of`."""

    def __init__(
        self, case: Case, diagnosis: Diagnosis, executor: Executor, rule: Rule, effort: Effort
    ) -> None:
        self.diagnosis, self.executor, self.rule, self.effort = diagnosis, executor, rule, effort
        self.starting: StartingPoint = starting_point(case)
        batch = self.starting.batch
        self.base = _with_values(self.starting.start.drives[0], diagnosis.base)
        self.scales = plant_scales(self.base, batch, turn=case.plant.turn)
        self.pace = pace_of(self.base, batch, self.starting.held_out, rule=rule)
        barred, self.barred_forms = not_testable(case, batch, rule=rule)
        inside = {effect.name for effect in self.starting.own.effects}
        self.barred = {*barred, *inside, *(found.effect for found in diagnosis.missing)}

    def as_found(self, missing: Sequence[MissingEffect]) -> Explanation:
        """The machine with the parameters that are reported, and the `missing` effects."""
        settled = [(drive, self._settled(drive)) for drive in self.with_effects(missing)]
        # A settled model has the integration error of its steps; what is reported is corrected for it.
        drive, model = min(settled, key=lambda pair: pair[1].fitted.misfit)
        names = tuple(found.effect for found in missing)
        return Explanation(names, drive, model.judgement.deflection, model.fitted.misfit)

    def in_place_of(self, found: MissingEffect) -> list[Explanation]:
        """What the effect that was `found` is commonly taken for, each in its place and as near to the recordings as it
        comes."""
        twins = confused_with(found.effect) - self.barred
        rest = tuple(other for other in self.diagnosis.missing if other is not found)
        if not twins:
            return []
        without = frozenset(catalogue()) - twins | self.barred_forms
        model = self._settled(self.with_effects(rest)[0])
        trials = try_catalogue(model, self.scales, self.executor, without, effort=self.effort)
        best = one_of_each([trial for some in trials for trial in some])
        chosen = [trial for name in sorted(twins) for trial in [t for t in best if t.effect == name][:_FORMS]]
        refits = list(self.executor.map(_refitted, chosen))
        least = self.effort.screening.least_gain
        shown = [
            (trial.effect, refit)
            for trial, refit in zip(chosen, refits, strict=True)
            if model.fitted.misfit - refit[1].misfit > least
        ]
        explanations = []
        for name in sorted({effect for effect, _ in shown}):
            refits = [refit for effect, refit in shown if effect == name]
            posterior, fitted = min(refits, key=lambda refit: refit[1].misfit)
            judged = judge(posterior, fitted)
            acting = (*(other.effect for other in rest), name)
            # Tests see the fitted recordings alone; the others begin as in the model without the effect.
            begins = np.append(judged.deflection, model.judgement.deflection[judged.deflection.size :])
            explanations.append(Explanation(acting, judged.drive, begins, fitted.misfit))
        return explanations

    def with_effects(self, missing: Sequence[MissingEffect]) -> list[Drive]:
        """The base model with the `missing` effects at the sizes that are reported: one drive for each form with these
        parameters, and for each value of what a diagnosis chooses from a few values and does not report."""
        # Labels of further effects depend on which others there are; what was found of each has plain names.
        drives = [_with_values(self.base, self.diagnosis.extended if missing else self.diagnosis.base)]
        for found in missing:
            drives = [drive.with_effects(one) for drive in drives for one in self._instances(found)]
        return drives

    def _instances(self, found: MissingEffect) -> Iterable[AbstractEffect]:
        sizes = {name: estimate.value for name, estimate in found.parameters.items()}
        known: dict[tuple, AbstractEffect] = {}
        for form in catalogue()[found.effect]:
            parameters = (*form.strengths, *form.nuisances)
            if {one.name for one in parameters if one.transform != "none"} != sizes.keys():
                continue
            periods: dict[str, tuple[float, ...]] = {
                str(one.scale): (sizes[one.name],) for one in form.nuisances if one.grid == "period"
            }
            for instance in forms_to_try(form, self.scales, periods):
                values: dict[str, Any] = {
                    one.name: sizes.get(one.name, getattr(instance, one.name)) for one in parameters
                }
                own = form(**values)
                known.setdefault((form, *(float(getattr(own, p.name)) for p in form.nuisances)), own)
        return known.values()

    def _settled(self, drive: Drive) -> Model:
        """The model of this `drive`, brought to its minimum."""
        starting = self.starting
        posterior, vector = robust_posterior(
            drive,
            starting.batch,
            starting.held_out,
            scales=self.scales,
            fixed=starting.own.fixed,
            pace=self.pace,
        )
        slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
        fitted = descend(slow, vector, graduate=False)
        return Model(slow, fitted, judge(slow, fitted))


def _refitted(trial: Trial) -> tuple[Posterior, RobustFit]:
    """The model of a `trial` with everything free, from the step that its test takes."""
    slow = trial.posterior.at_bandwidth(SLOW_BANDWIDTH)
    return slow, descend(slow, trial.vector, graduate=False)


def _with_values(drive: Drive, values: Mapping[str, Estimate]) -> Drive:
    """The `drive` with the `values` of those of its parameters that were estimated, by label."""
    places = places_of(drive)
    return changed_drive(drive, {name: one.value for name, one in values.items() if name in places})
