"""A few hundred points of one held-out recording: enough to see by eye what base and extended model make of it."""

from __future__ import annotations

import numpy as np

_POINTS, _BINS = 600, 120


def trace_of(found) -> dict:
    """Of the `Diagnosis` `found`, the held-out recording that the extended model improves most: time, position and the
    base model's prediction 0.1 s ahead at some points, and the error of both models over the noise in
    short stretches."""
    held = [r for r in found.recordings if r.role == "holdout"]
    if not held:
        return {}
    best = max(held, key=lambda r: r.prediction_rmse_base / max(r.prediction_rmse_extended, 1e-300))
    shown = np.linspace(0, best.t.size - 1, _POINTS).astype(int)
    stretches = np.array_split(np.arange(best.t.size), _BINS)

    def over_noise(predicted: np.ndarray) -> list[float]:
        error = (predicted - best.x) / best.noise_floor
        return [float(f"{np.sqrt(np.mean(error[s] ** 2)):.4g}") for s in stretches]

    return {
        "recording": best.name,
        "t": [float(f"{v:.5g}") for v in best.t[shown]],
        "x": [float(f"{v:.7g}") for v in best.x[shown]],
        "predicted_base": [float(f"{v:.7g}") for v in best.predicted_base[shown]],
        "stretch": [float(f"{best.t[s].mean():.4g}") for s in stretches],
        "error_base": over_noise(best.predicted_base),
        "error_extended": over_noise(best.predicted_extended),
    }
