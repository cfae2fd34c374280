"""tables.json: every number of the study beside its reference value, finite or null."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from frictionjax.core.json import plain_json
from frictionjax.frequency import SKResult
from frictionjax.paper.experiments import (
    BAND,
    PARTS,
    PUBLISHED,
    RAMP,
    REFERENCE_A5,
    Explained,
    Identified,
    Linearised,
    MotorBench,
    Paper,
    Presliding,
    Validation,
)
from frictionjax.studies import LevelSweep
from frictionjax.studies.estimator_comparison import EstimatorComparison

LOST = (
    "Table I: the numbers used are those of Canudas de Wit et al. (1995), whose presliding experiment is the same.",
    "Table II and the counts of the encoder: the twin's 655 360 counts a turn of the arm are ours.",
    "Table III and the estimates of inertia, stiffness and damping: nothing to compare with; the twins' are ours.",
    "The slopes of the ramps of Fig. 2 and 5: ours.",
    "Whether the noise levels are rms or peak: PRBS makes them the same.",
)
"""What is illegible or missing in our copy of the paper, as sentences."""


def tables(
    paper: Paper, explained: Sequence[Explained] = (), bench: MotorBench | None = None
) -> dict[str, Any]:
    """Everything as JSON: strict types, and None for what is not finite.

    **Arguments:**

    - `paper`: from `reproduce`.
    - `explained`: from `explain`; may be empty.
    - `bench`: from `motor_bench`, if it was asked for.

    **Returns:** a dictionary for `json.dumps(..., allow_nan=False)`.
    """
    content = {
        "schema": "frictionjax.paper/1",
        "paper": "Hensen, van de Molengraft, Steinbuch, IEEE Trans. Control Systems Technology 10(2), 2002",
        "lost": LOST,
        "fig2": _presliding(paper.presliding),
        "linearisation": _linearised(paper.linearised),
        "table3": _sweep(paper.sweep),
        "fig4": {one.twin.name: _identified(one) for one in paper.identified},
        "fig5_fig6": {one.twin.name: _validation(one) for one in paper.validations},
        "estimators": None if paper.comparison is None else _comparison(paper.comparison),
        "diagnoses": {one.twin.name: _explained(one) for one in explained},
        "motor_bench": None if bench is None else _bench(bench),
        "seconds": paper.seconds,
    }
    return plain_json(content)


def _presliding(found: Presliding) -> dict[str, Any]:
    return {
        "virgin_displacement_m": {"value": found.virgin, "reference": found.virgin_expected},
        "largest_distance_to_closed_form_m": found.branch_error,
        "x_after_cycle_m": {"value": found.x_after_cycle, "reference": 0.0},
        "z_after_cycle_m": {"value": found.z_after_cycle, "reference": 0.0},
        "seconds_for_two_cycles": found.t[-1],
    }


def _linearised(found: Linearised) -> dict[str, Any]:
    at = np.argmin(np.abs(found.bend - 0.5))
    return {
        "natural_frequency_Hz": {"value": found.natural_frequency, "reference": 50.329},
        "damping_ratio": {"value": found.damping_ratio, "reference": 0.50063},
        "stiffness_N_per_m": {"value": found.stiffness, "reference": 1e5},
        "damping_N_s_per_m": {"value": found.damping, "reference": 1e5**0.5 + 0.4},
        "one_matrix_at_the_zero_state": found.unique_at_rest,
        "bent_bristle": {
            "bend": found.bend[at],
            "stiffness_left_right": [found.stiffness_left[at], found.stiffness_right[at]],
            "damping_left_right": [found.damping_left[at], found.damping_right[at]],
        },
    }


def _sweep(found: LevelSweep) -> dict[str, Any]:
    reference = {
        kind: [{"level": row[0], "stiffness": row[place]} for row in REFERENCE_A5]
        for place, kind in ((1, "prbs"), (2, "gaussian"))
    }
    return {
        "plant": "Table I",
        "rows": found.table(),
        "reference": reference,
        "zero_amplitude": {
            kind: {
                "stiffness": zero.stiffness,
                "reference": found.true_stiffness,
                "relative_error": zero.stiffness.value / found.true_stiffness - 1.0,
                "message": zero.message,
            }
            for kind, zero in ((kind, found.zero_amplitude(kind, upto=0.26)) for kind in found.excitations)
        },
    }


def _identified(one: Identified) -> dict[str, Any]:
    twin, zero = one.twin, one.zero_amplitude
    return {
        "twin_ours": {name: getattr(twin, name) for name in twin.__dataclass_fields__},
        "transmission_Hz": {"antiresonance": twin.antiresonance, "resonance": twin.resonance},
        "band_Hz": BAND,
        "truth": {"J": twin.J, "stiffness": twin.sigma0, "damping": twin.sigma1 + twin.sigma2},
        "levels": [
            {
                "rms_V": level,
                "rms_over_static": level / twin.static_voltage,
                "with_delay": _fit(fit),
                "without_delay": _fit(plain_fit),
                "low_frequency_coherence": np.mean(np.asarray(frf.coherence)[3:8]),
            }
            for level, frf, fit, plain_fit in zip(
                one.levels, one.frfs, one.fits, one.without_delay, strict=True
            )
        ],
        "zero_amplitude": {
            "stiffness": zero.stiffness,
            "reference": twin.sigma0,
            "message": zero.message,
            "warnings": zero.warnings,
        },
    }


def _fit(fit: SKResult) -> dict[str, Any]:
    names = ("J", "stiffness", "damping", "delay", "natural_frequency", "damping_ratio")
    return {name: getattr(fit, name) for name in names} | {
        "residual_norm": fit.residual_norm,
        "misfit": fit.misfit,
        "converged": fit.converged,
        "warnings": fit.warnings,
    }


def _validation(one: Validation) -> dict[str, Any]:
    models = ("measured", "paper", "extrapolated")
    return {
        "stiffness": {
            "paper": one.drive.friction.sigma0,
            "extrapolated": one.drive_extrapolated.friction.sigma0,
            "reference": one.twin.sigma0,
        },
        "ramp_V_per_s": RAMP,
        "displacement_twin_over_model": [
            {"part_of_static_friction": part, "paper": paper, "extrapolated": better}
            for part, paper, better in zip(PARTS, one.ramp_ratio, one.ramp_ratio_extrapolated, strict=True)
        ],
        "break_away_s": dict(zip(models, one.break_away, strict=True)),
        "peak_displacement_rad": {
            name: dict(zip(models, peak, strict=True)) for name, peak in one.peak.items()
        },
        "peak_twin_over_model": {
            name: {model: one.ratio(name, model) for model in models[1:]} for name in one.peak
        },
        "relative_rms_error": one.mismatch,
    }


def _explained(one: Explained) -> dict[str, Any]:
    return {
        "truth": one.answer,
        "named": one.named,
        "right": one.right,
        "verdict": one.diagnosis.verdict,
        "summary": one.diagnosis.summary,
        "missing": [
            {
                "effect": missing.effect,
                "class": missing.effect_class,
                "p_value": missing.p_value,
                "confidence": missing.confidence,
                "parameters": missing.parameters,
            }
            for missing in one.diagnosis.missing
        ],
        "prediction_rmse_rad": {
            fit.name: {
                "role": fit.role,
                "base": fit.prediction_rmse_base,
                "extended": fit.prediction_rmse_extended,
            }
            for fit in one.diagnosis.recordings
        },
        "seconds": one.diagnosis.seconds,
    }


def _comparison(found: EstimatorComparison) -> dict[str, Any]:
    return {
        "plant": "Table I",
        "draws": found.converged.shape[2],
        "sentences": found.sentences,
        "seconds": found.seconds,
        "rows": found.rows,
    }


def _bench(found: MotorBench) -> dict[str, Any]:
    values = {name: {"value": getattr(found, name), "reference": value} for name, value in PUBLISHED.items()}
    return values | {
        "lines": found.bla.frequency.size,
        "periods": found.bla.periods,
        "odd_p_value": found.bla.odd.p_value,
        "even_p_value": found.bla.even.p_value,
    }
