"""Writes the demo's case: recordings, case.toml, and the true parameters in a folder `sealed`."""

import dataclasses
import json
from pathlib import Path

import numpy as np
from jaxtyping import Float

from frictionjax.core.progress import Progress, silent
from frictionjax.demo.arm import Arm, draw_arm
from frictionjax.demo.experiments import PlannedExperiment, plan
from frictionjax.demo.motion import SAMPLE_RATE, move

PAUSE = 10.0  # s between recordings, for the clock that they share


def _run(
    arm: Arm, experiments: tuple[PlannedExperiment, ...], rng: np.random.Generator
) -> list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]:
    """Voltage and measured position of each experiment; all are run side by side and cut to their own lengths."""
    n = max(e.signal.size for e in experiments)
    closed = np.array([e.loop == "closed" for e in experiments])
    # A shorter experiment is padded: an open loop with zero voltage, a closed one with its last reference.
    asked = np.stack(
        [
            np.pad(e.signal, (0, n - e.signal.size), mode="edge" if e.loop == "closed" else "constant")
            for e in experiments
        ],
        axis=1,
    )
    # Gains of a servo of about 10 Hz and 0.7 damping on this inertia.
    w = 2.0 * np.pi * 10.0
    motion = move(
        arm,
        np.where(closed, 0.0, asked),
        reference=np.where(closed, asked, 0.0),
        noise=arm.noise * rng.standard_normal(asked.shape),
        kp=np.where(closed, arm.J * w**2 / arm.motor_constant, 0.0),
        kd=np.where(closed, 1.4 * arm.J * w / arm.motor_constant, 0.0),
    )
    return [
        (motion.u[: e.signal.size, i], motion.measured[: e.signal.size, i]) for i, e in enumerate(experiments)
    ]


def _csv(u: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"]) -> str:
    rows = zip((np.arange(u.size) / SAMPLE_RATE).tolist(), u.tolist(), x.tolist(), strict=True)
    return "t,u,x\n" + "".join(f"{t:.4f},{volt:.9g},{position:.10g}\n" for t, volt, position in rows)


def _toml(name: str, arm: Arm, experiments: tuple[PlannedExperiment, ...]) -> str:
    lines = [
        f'name = "{name}"',
        "",
        "[plant]",
        f"motor_constant = {arm.motor_constant}  # N*m/V, from the drive's data sheet",
        'position_unit = "rad"',
        'force_unit = "N*m"',
        'input_unit = "V"',
        f"encoder_step = {arm.encoder_step}  # rad",
    ]
    start = 0.0
    for e in experiments:
        lines += ["", "[[recording]]", f'file = "{e.name}.csv"', f'role = "{e.role}"', f'loop = "{e.loop}"']
        lines += [f"start_time = {start}  # s since power-on"]
        start += e.signal.size / SAMPLE_RATE + PAUSE
    return "\n".join(lines) + "\n"


def _truth(arm: Arm, seed: int) -> str:
    numbers = dataclasses.asdict(arm)
    base = {name: numbers[name] for name in ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")}
    truth: dict = {"seed": seed, "missing": [], "base": base}
    if arm.share > 0.0:
        truth["missing"] = ["maxwell_slip"]
        # Largest over smallest yield; the fitting side has a parameter of another meaning under the name `spread`.
        numbers["yield_ratio"] = numbers["spread"]
        truth["maxwell_slip"] = {name: numbers[name] for name in ("share", "elements", "yield_ratio")}
    return json.dumps(truth, indent=1) + "\n"


def write_demo_case(
    directory: str | Path, *, seed: int = 2002, base: bool = False, progress: Progress = silent
) -> Path:
    """Run the demo's experiments on an arm like the paper's, and write them as a case.

    The arm shows what the paper's Fig. 5 and 6(b) show: at small torque it is the spring that a frequency response
    measures, at large torque it moves further than a LuGre model of it. The cause is in `sealed/truth.json`, which the
    diagnosis does not read.

    **Arguments:**

    - `directory`: where to write; made if it is not there. Files of the same names are overwritten.
    - `seed`: draws the arm, the noise that excites it and the noise of its encoder; the same seed gives the same
        files.
    - `base`: whether friction is a plain LuGre bristle, so that nothing is missing.
    - `progress`: called as the work goes on.

    **Returns:** the path of `case.toml`. Beside it are one CSV file a recording (columns `t` in s, `u` in V, `x` in
    rad, 2 kHz) and the folder `sealed`.

    **Raises:** `RuntimeError` when JAX computes in float32.
    """
    directory = Path(directory)
    rng = np.random.default_rng(seed)
    arm = draw_arm(rng, base=base)
    experiments = plan(arm, rng)
    progress("running the demo's experiments", 0.0)
    recordings = _run(arm, experiments, rng)
    (directory / "sealed").mkdir(parents=True, exist_ok=True)
    for i, (experiment, (u, x)) in enumerate(zip(experiments, recordings, strict=True)):
        progress(f"writing {experiment.name}.csv", 0.6 + 0.4 * i / len(experiments))
        (directory / f"{experiment.name}.csv").write_text(_csv(u, x), encoding="utf-8")
    (directory / "sealed" / "truth.json").write_text(_truth(arm, seed), encoding="utf-8")
    case = directory / "case.toml"
    case.write_text(_toml("demo-arm", arm, experiments), encoding="utf-8")
    progress("demo case written", 1.0)
    return case
