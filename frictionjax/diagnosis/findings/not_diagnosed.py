"""A case whose base fit is not credible: no effect is named, and the first sentence says what to correct or check."""

from collections.abc import Sequence

from frictionjax.core import Estimate
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.recording_fits import recording_fits
from frictionjax.diagnosis.evidence.views import View
from frictionjax.diagnosis.findings.as_given import column_as_given, simulation_as_given
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.table import ComparisonTable, OtherDecision
from frictionjax.diagnosis.verdict import Candidate, Diagnosis, Unexplained
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Case

REASON = "not tested: the base fit is not credible"
_IN_VAIN = "refitted, and no model with it predicts better than constant velocity"
_NO_GAIN = "its first step beside a base fit that is not credible gains too little for a refit"

CHECK = "Check that u is what drives x, on one clock, and their units: no model tried here predicts these recordings."
"""What to do where nothing that was tried explains the fit."""
_NOTHING = "Nothing was diagnosed."


def not_diagnosed(
    case: Case,
    base: Model,
    scene: Scene,
    predicted: View,
    parameters: dict[str, Estimate],
    warnings: tuple[str, ...],
    cure: str,
    seconds: dict[str, float],
    tables: tuple[ComparisonTable, ...] = (),
    decided: tuple[OtherDecision, ...] = (),
    steps: Sequence[Step] = (),
) -> Diagnosis:
    """The result for a `case` whose base fit is not credible: `unknown`, no effect named.

    **Arguments:**

    - `case`: the case.
    - `base`: its base fit.
    - `scene`, `predicted`: its recordings, and what the base fit predicts for them, for the plots.
    - `parameters`: of the base fit.
    - `warnings`: sentences, that of `what_to_check` first.
    - `cure`: the sentence of `mistake`, or empty.
    - `seconds`: stage -> s.
    - `tables`, `decided`: what was compared, and what else was decided.
    - `steps`: of a search for an effect with which the fit is credible; empty where none was made.
    """
    refitted = {refit.effect for step in steps for refit in step.refits}
    tried = {trial.effect for step in steps for trial in step.trials}
    why = {name: _IN_VAIN if name in refitted else _NO_GAIN for name in tried | refitted}
    recordings = case.fit_recordings + case.holdout_recordings
    column = column_as_given(recordings, scene)
    fits = recording_fits(recordings, scene, predicted, predicted, base.judgement.drive, column)
    given = simulation_as_given(column, fits, case.plant, None, extended=False)
    return Diagnosis(
        case=case.name,
        plant=case.plant,
        verdict="unknown",
        summary=" ".join([cure or CHECK, _NOTHING, *([given.sentence] if given else [])]),
        missing=(),
        unexplained=Unexplained(True, 1.0, ""),
        mismatch=(),
        base=parameters,
        extended=parameters,
        recordings=fits,
        candidates=tuple(
            Candidate(name, float("nan"), {}, False, why.get(name, REASON)) for name in catalogue()
        ),
        warnings=warnings,
        seconds=seconds,
        given=given,
        comparisons=tables,
        decided=decided,
    )
