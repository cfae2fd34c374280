"""A Diagnosis built from synthetic arrays: what the report and the output are tested with, no fit needed."""

import numpy as np

from frictionjax.core import Estimate
from frictionjax.diagnosis.checked import Check, CheckedAnswer, CheckedName
from frictionjax.diagnosis.recording_fit import Horizon, RecordingFit, Unmeasured
from frictionjax.diagnosis.verdict import (
    Candidate,
    Diagnosis,
    MismatchBin,
    MissingEffect,
    Unexplained,
    Within,
)
from frictionjax.recordings import Plant

PLANT = Plant(motor_constant=16.0, position_unit="rad", force_unit="N*m", input_unit="V")
SUMMARY = (
    "Missing from the base model: hysteresis with non-local memory (Maxwell slip). It acts in presliding, above "
    "40 % of break-away, and explains 97 % of what the base model misses on held-out recordings."
)


def fake_recording(
    name: str = "holdout_stick",
    *,
    role: str = "holdout",
    n: int = 4000,
    sample_rate: float = 2000.0,
    repaired: bool = True,
    drive: str = "force",
    seed: int = 0,
) -> RecordingFit:
    """A slow sweep with bursts of base-model error around its reversals; `repaired`: the extended model mends them."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / sample_rate
    phase = 2 * np.pi * 3.0 * t / t[-1]
    x = 2e-3 * np.sin(phase) * (1 + 0.3 * np.sin(0.31 * phase))
    burst = np.exp(-(((t / t[-1] - 0.63) / 0.04) ** 2)) + 0.4 * np.exp(-(((t / t[-1] - 0.25) / 0.02) ** 2))
    shape = burst * np.sin(11 * phase + 0.4)
    noise = 1e-7 * rng.standard_normal((4, n))
    share = 0.03 if repaired else 1.0
    predicted_base, predicted_extended = x + 4e-6 * shape + noise[0], x + 4e-6 * share * shape + noise[1]
    free_base, free_extended = x + 3e-5 * np.cumsum(shape) / n**0.5 + noise[2], x + 1e-6 * shape + noise[3]
    force_noise = 0.004 * rng.standard_normal((2, n))

    def rmse(model):
        return float(np.sqrt(np.mean((model - x) ** 2)))

    return RecordingFit(
        name=name,
        role=role,
        t=t,
        u=0.03 * np.sin(phase + 0.2),
        x=x,
        free_base=free_base,
        free_extended=free_extended,
        predicted_base=predicted_base,
        predicted_extended=predicted_extended,
        residual_force=0.08 * shape + force_noise[0],
        residual_force_extended=0.08 * share * shape + force_noise[1],
        residual_force_std=np.full(n, 0.005),
        noise_floor=1.1e-7,
        free_run_rmse_base=rmse(free_base),
        free_run_rmse_extended=rmse(free_extended),
        prediction_rmse_base=rmse(predicted_base),
        prediction_rmse_extended=rmse(predicted_extended),
        drive=drive,
        force=0.5 * np.sin(phase) if drive == "motion" else None,
        horizons=()
        if drive == "motion"
        else (
            Horizon(1.0 / sample_rate, 1.2e-7, 1.1e-7, 1e-6),
            Horizon(0.1, rmse(predicted_base), rmse(predicted_extended), 1e-4),
            Horizon(float(t[-1]), rmse(free_base), float("inf"), 1e-3),
        ),
        unmeasured_base=Unmeasured(0.08, 0.16, 0.3),
        unmeasured_extended=Unmeasured(0.08 * share, 0.16 * share, 0.3 * share),
    )


def fake_diagnosis(*, n: int = 4000, recordings: tuple[RecordingFit, ...] | None = None) -> Diagnosis:
    """A case whose verdict is `named`, with every field filled and not-finite numbers where they may occur."""
    if recordings is None:
        recordings = (
            fake_recording("noise_small", role="fit", n=n, seed=1),
            fake_recording("breakaway", role="fit", n=n, seed=2),
            fake_recording("holdout_stick", role="holdout", n=n, seed=3),
        )
    base = {
        "J": Estimate(0.026, 1e-5, "kg*m^2"),
        "sigma0": Estimate(2010.0, 4.2, "N*m/rad"),
        "sigma1": Estimate(3.13, 0.02, "N*m*s/rad"),
        "sigma2": Estimate(0.057, float("inf"), "N*m*s/rad", identified=False),
        "Fc": Estimate(0.557, 0.0011, "N*m"),
        "Fs": Estimate(0.770, 0.0016, "N*m"),
        "vs": Estimate(0.0789, 0.0009, "rad/s"),
    }
    extended = base | {
        "sigma0": Estimate(1814.0, 1.9, "N*m/rad"),
        "maxwell_slip.share": Estimate(0.42, 0.01, "1"),
    }
    cells = [("presliding", 0.83, 12.1), ("break-away", 0.14, 6.0), ("sliding", 0.03, 1.3)]
    mismatch = [MismatchBin("regime", label, share, excess, 1.02, 1000) for label, share, excess in cells]
    cells = [(f"{10 * k}-{10 * k + 10} %", 0.02 + 0.01 * k, 1.0 + k) for k in range(12)]
    mismatch += [MismatchBin("since_reversal", label, share, excess) for label, share, excess in cells]
    cells = [("after rests below 10 ms", 0.04, 1.1, 0.4), ("after rests of 0.3 to 1 s", 0.96, 9.0, 0.005)]
    mismatch += [MismatchBin("dwell", label, share, excess, 1.0, 500, p) for label, share, excess, p in cells]
    candidates = (
        Candidate(
            "creep",
            0.3,
            {"compliance": 0.02},
            True,
            "less than the noise",
            0.01,
            -0.02,
            {"compliance": 0.004},
        ),
        Candidate(
            "maxwell_slip",
            1e-12,
            {"share": 0.01},
            True,
            "explains the mismatch on fit and held-out recordings",
            0.97,
            0.95,
            {"share": 0.40},
            {"share": "1"},
        ),
        Candidate("backlash", float("nan"), {}, False, "needs a second encoder or a reversal under load"),
    )
    return Diagnosis(
        case="arm-2024-03",
        plant=PLANT,
        verdict="named",
        summary=SUMMARY,
        missing=(
            MissingEffect(
                "maxwell_slip",
                ("maxwell_slip", "elasto_plastic"),
                0.98,
                1e-12,
                {"share": Estimate(0.42, 0.01, "1")},
                "presliding, first 20 um after a reversal",
                "nested triangles A > B > A below break-away",
                "hysteresis with non-local memory",
            ),
        ),
        unexplained=Unexplained(False, 0.01, ""),
        mismatch=tuple(mismatch),
        base=base,
        extended=extended,
        recordings=recordings,
        candidates=candidates,
        warnings=(
            "noise_small: 0.3 % of the time stamps are jittered by more than 10 % and were resampled.",
        ),
        seconds={"total": 31.2, "compile": 9.0, "fit": 11.0, "name": 6.2},
        within=(
            Within(
                "dwell",
                "after rests longer than 0.3 s",
                "after rests longer than 0.3 s",
                "presliding",
                0.97,
                0.31,
                24.0,
                1.1,
                1e-6,
                True,
            ),
        ),
    )


def fake_check() -> Check:
    """A check of such a case on 12 machines, one of which could not be diagnosed."""
    answers = (
        CheckedAnswer(("maxwell_slip",), "named", ("maxwell_slip",), True, 5),
        CheckedAnswer(("maxwell_slip",), "unknown", (), False, 1),
        CheckedAnswer(("creep",), "named", ("maxwell_slip",), False, 1),
        CheckedAnswer(("creep",), "named", ("creep",), True, 2),
        CheckedAnswer((), "adequate", (), True, 2),
    )
    return Check(11, 1, (CheckedName("maxwell_slip", given=6, right=5, acting=6, found=5),), answers)


def adequate_diagnosis() -> Diagnosis:
    """A case whose base model explains the data: nothing missing, no candidates, no map."""
    recording = fake_recording("only", role="fit", repaired=False)
    return Diagnosis(
        case="bench",
        plant=PLANT,
        verdict="adequate",
        summary="The base model explains these recordings to the noise.",
        missing=(),
        unexplained=Unexplained(False, 0.0, ""),
        mismatch=(),
        base={"J": Estimate(0.026, 1e-5, "kg*m^2")},
        extended={"J": Estimate(0.026, 1e-5, "kg*m^2")},
        recordings=(recording,),
        candidates=(),
        warnings=(),
        seconds={"total": 3.0, "compile": 1.0},
    )
