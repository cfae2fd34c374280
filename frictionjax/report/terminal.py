"""The verdict as lines for a terminal."""

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.series import is_extended


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    """The sentence, then the prediction error on each recording kept aside, base model -> extended model.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    Lines without line ends, in ASCII but for what the summary and the units hold.
    """
    lines = [diagnosis.summary]
    held_out = [recording for recording in diagnosis.recordings if recording.role == "holdout"]
    if not held_out:
        return [*lines, "", "No recording was kept aside: nothing was verified on unseen data."]
    extended = is_extended(diagnosis.recordings)
    lines += [
        "",
        "Prediction error on recordings kept aside (rms, 0.1 s ahead), base"
        + " -> extended" * extended
        + ":",
    ]
    width = max(len(recording.name) for recording in held_out)
    for recording in held_out:
        unit = diagnosis.plant.force_unit if recording.drive == "motion" else diagnosis.plant.position_unit
        change = f"{recording.prediction_rmse_base:.3g}"
        if extended:
            change += f" -> {recording.prediction_rmse_extended:.3g}"
        lines.append(
            f"  {recording.name:<{width}}  {change} {unit}  (noise floor {recording.noise_floor:.3g})"
        )
    return lines
