"""The verdict as lines of text for a terminal."""

from typing import Any

from frictionjax.core import Estimate
from frictionjax.core.quantities import in_unit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.series import is_extended


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    """The summary, then the prediction error on each held-out recording, base model -> extended model.

    **Arguments:**

    - `diagnosis`: what `diagnose` found.

    **Returns:**

    Lines without line ends, in ASCII except for the summary and the units.
    """
    lines = [diagnosis.summary, *(diagnosis.check.sentences if diagnosis.check is not None else ())]
    held_out = [recording for recording in diagnosis.recordings if recording.role == "holdout"]
    if not held_out:
        return [*lines, "", "No recording was held out: nothing was verified on other data."]
    extended = is_extended(diagnosis)
    models = "base -> extended model" if extended else "base model"
    lines += ["", f"Prediction error on held-out recordings (rms, 0.1 s ahead), {models}:"]
    width = max(len(recording.name) for recording in held_out)
    for recording in held_out:
        plant = diagnosis.plant
        unit, (base, after, floor) = in_unit(
            plant.shown_force if recording.drive == "motion" else plant.shown_position,
            recording.prediction_rmse_base,
            recording.prediction_rmse_extended,
            recording.noise_floor,
        )
        change = f"{base:.3g} -> {after:.3g}" if extended else f"{base:.3g}"
        lines.append(f"  {recording.name:<{width}}  {change} {unit}  (noise floor {floor:.3g})")
    return lines


def truth_lines(truth: dict[str, Any], diagnosis: Diagnosis) -> list[str]:
    """The true model of a simulated machine beside the one found.

    **Arguments:**

    - `truth`: `missing` (effect names), `base` (parameter name to value, in the units of the case) and, under an
        effect's name, its parameters.
    - `diagnosis`: what `diagnose` found without it.

    **Returns:**

    Lines of three columns: what, truth, found.
    """
    found = ["/".join(effect.effect_class) or effect.effect for effect in diagnosis.missing]
    rows = [("", "truth", "found")]
    rows.append(("missing", ", ".join(truth["missing"]) or "nothing", ", ".join(found) or "nothing"))
    for name, value in truth["base"].items():
        rows.append((name, f"{value:.5g}", _found(diagnosis.extended.get(name))))
    estimates = {effect.effect: effect.parameters for effect in diagnosis.missing}
    for effect in truth["missing"]:
        for name, value in truth.get(effect, {}).items():
            rows.append((f"{effect} {name}", f"{value:.5g}", _found(estimates.get(effect, {}).get(name))))
    widths = [max(len(row[column]) for row in rows) for column in range(2)]
    return [
        f"  {what:<{widths[0]}}  {true:<{widths[1]}}  {estimate}".rstrip() for what, true, estimate in rows
    ]


def _found(estimate: Estimate | None) -> str:
    if estimate is None:
        return ""
    if not estimate.identified:
        return f"{estimate.value:.5g} (not determined)"
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    return f"{estimate.value:.5g} +- {estimate.stderr:.2g}{unit}"
