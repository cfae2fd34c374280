"""A case whose base fit is not credible: no effect is named, and the first sentence says what to correct or check."""

from frictionjax.core import Estimate
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.recording_fits import recording_fits
from frictionjax.diagnosis.evidence.views import View
from frictionjax.diagnosis.findings.as_given import column_as_given, simulation_as_given
from frictionjax.diagnosis.table import ComparisonTable, OtherDecision
from frictionjax.diagnosis.verdict import Candidate, Diagnosis, Unexplained
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Case

REASON = "not tested: the base fit is not credible"

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
) -> Diagnosis:
    """The result for a `case` whose base fit is not credible: `unknown`, no effect named, every effect untested.

    **Arguments:**

    - `case`: the case.
    - `base`: its base fit.
    - `scene`, `predicted`: its recordings, and what the base fit predicts for them, for the plots.
    - `parameters`: of the base fit.
    - `warnings`: sentences, that of `what_to_check` first.
    - `cure`: the sentence of `mistake`, or empty.
    - `seconds`: stage -> s.
    - `tables`, `decided`: what was compared, and what else was decided.
    """
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
        candidates=tuple(Candidate(name, float("nan"), {}, False, REASON) for name in catalogue()),
        warnings=warnings,
        seconds=seconds,
        given=given,
        comparisons=tables,
        decided=decided,
    )
