"""Fig. 5 and 6: break-away by a ramp and two sines, measured on a twin against LuGre with the identified parameters."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Progress, silent
from frictionjax.frequency import SKResult
from frictionjax.paper.experiments.identification import Identified
from frictionjax.paper.experiments.rig import SAMPLE_RATE, Twin, measure
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate

RAMP = 0.02  # V/s, ours: the paper's slope is lost
RAMP_SECONDS = 2.3
PARTS = (0.1, 0.25, 0.5, 0.75, 0.9, 0.95)
"""Parts of the static friction at which the displacements on the ramp are compared."""

SINES = {"small": (20.0, 0.01, 10), "large": (0.5, 0.035, 3)}
"""Frequency (Hz), amplitude (V) and periods of the two sines of Fig. 6; numbers of periods are ours."""


class ValidationResponse(eqx.Module):
    """One experiment, measured and predicted.

    **Attributes:**

    - `t`: time, s, shape `(n,)`.
    - `u`: applied voltage, V, shape `(n,)`.
    - `measured`: angle as the twin's encoder gives it, rad, shape `(n,)`.
    - `paper`: angle of LuGre with the stiffness of the paper's method, rad, shape `(n,)`.
    - `extrapolated`: angle of LuGre with the stiffness at zero amplitude, rad, shape `(n,)`.
    """

    t: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    paper: Float[np.ndarray, " n"]
    extrapolated: Float[np.ndarray, " n"]


class Validation(eqx.Module):
    """The time-domain experiments on one twin.

    **Attributes:**

    - `twin`: the machine.
    - `drive`: LuGre with the paper's estimates: the second-order fit at 0.01 V.
    - `drive_extrapolated`: the same with the stiffness at zero amplitude, and inertia and damping of the lowest level.
    - `ramp`, `small`, `large`: break-away, 20 Hz at 0.01 V, and 0.5 Hz at 0.035 V.
    - `ramp_ratio`, `ramp_ratio_extrapolated`: measured over predicted displacement on the ramp at each of `PARTS` of
      the static friction, shape `(6,)`.
    - `peak`: name of a sine to half of the peak-to-peak displacement of its last periods: measured, paper,
      extrapolated, rad.
    - `break_away`: when the arm has moved by 5 mrad, s: measured, paper, extrapolated.
    - `mismatch`: root mean square of measured minus predicted displacement over that of the measured one, for both
      sines and both models, `"small"`, `"large"`, `"small_extrapolated"`, `"large_extrapolated"`.
    """

    twin: Twin
    drive: Drive
    drive_extrapolated: Drive
    ramp: ValidationResponse
    small: ValidationResponse
    large: ValidationResponse
    ramp_ratio: Float[np.ndarray, " parts"]
    ramp_ratio_extrapolated: Float[np.ndarray, " parts"]
    peak: dict[str, tuple[float, float, float]] = eqx.field(static=True)
    break_away: tuple[float, float, float] = eqx.field(static=True)
    mismatch: dict[str, float] = eqx.field(static=True)

    def ratio(self, sine: str, model: str = "paper") -> float:
        """Measured over predicted peak; `sine` is "small" or "large", `model` is "paper" or "extrapolated"."""
        return self.peak[sine][0] / self.peak[sine][1 if model == "paper" else 2]


def validate(identified: Sequence[Identified], *, progress: Progress = silent) -> tuple[Validation, ...]:
    """Run the experiments of Fig. 5 and 6 on each twin and compare them with LuGre and its identified parameters.

    A presliding FRF determines inertia, stiffness and damping only. Viscous friction and the Stribeck curve are known:
    the paper has them from sliding experiments of an earlier study.

    **Arguments:**

    - `identified`: from `identify`.
    - `progress`: called as the work goes on.

    **Returns:** a `Validation` for each machine.
    """
    signals = {"ramp": RAMP * np.arange(round(RAMP_SECONDS * SAMPLE_RATE)) / SAMPLE_RATE}
    for name, (frequency, amplitude, periods) in SINES.items():
        t = np.arange(round(periods / frequency * SAMPLE_RATE)) / SAMPLE_RATE
        signals[name] = amplitude * np.sin(2.0 * np.pi * frequency * t)
    machines = [one.twin for one in identified]
    runs = {}
    for i, (name, u) in enumerate(signals.items()):
        progress("measuring break-away and sines", 0.5 * i / len(signals))
        runs[name] = measure(machines, np.tile(u[:, None], (1, len(machines))), seed=100 + i).x
    # Both models of every machine, side by side: LuGre as the paper identifies it, and at zero amplitude.
    models = [_drive(one.twin, one.fit, one.fit.stiffness.value) for one in identified]
    models += [_drive(one.twin, one.fits[0], one.zero_amplitude.stiffness.value) for one in identified]
    together = jax.tree.map(lambda *parts: jnp.stack(parts), *models)
    predicted = {}
    for i, (name, u) in enumerate(signals.items()):
        progress("predicting break-away and sines", 0.5 + 0.5 * i / len(signals))
        predicted[name] = np.asarray(_predict(together, jnp.asarray(u)))
    progress("break-away and sines compared", 1.0)
    count = len(identified)
    return tuple(
        _validation(
            one,
            (models[i], models[count + i]),
            {
                name: ValidationResponse(
                    t=np.arange(u.size) / SAMPLE_RATE,
                    u=u,
                    measured=runs[name][:, i],
                    paper=predicted[name][i],
                    extrapolated=predicted[name][count + i],
                )
                for name, u in signals.items()
            },
        )
        for i, one in enumerate(identified)
    )


@eqx.filter_jit
def _predict(drives: Drive, u: Float[Array, " n"]) -> Float[Array, "models n"]:
    return jax.vmap(lambda drive: simulate(drive, u, SAMPLE_RATE).x)(drives)


def _validation(
    one: Identified, models: tuple[Drive, Drive], responses: dict[str, ValidationResponse]
) -> Validation:
    twin = one.twin
    ramp = responses["ramp"]
    ratios = np.array([_on_the_ramp(ramp, part * twin.static_voltage) for part in PARTS])
    peak, mismatch = {}, {}
    for name, (frequency, _, periods) in SINES.items():
        loops = [
            folded(x, frequency, skip=max(1, periods - 8))
            for x in (responses[name].measured, responses[name].paper, responses[name].extrapolated)
        ]
        peak[name] = tuple(0.5 * float(np.ptp(loop)) for loop in loops)
        for label, loop in (("", loops[1]), ("_extrapolated", loops[2])):
            mismatch[name + label] = float(np.std(loops[0] - loop) / np.std(loops[0]))
    return Validation(
        twin=twin,
        drive=models[0],
        drive_extrapolated=models[1],
        ramp=ramp,
        small=responses["small"],
        large=responses["large"],
        ramp_ratio=ratios[:, 0],
        ramp_ratio_extrapolated=ratios[:, 1],
        peak=peak,
        break_away=tuple(_breaks_away(x) for x in (ramp.measured, ramp.paper, ramp.extrapolated)),  # type: ignore
        mismatch=mismatch,
    )


def _drive(twin: Twin, fit: SKResult, stiffness: float) -> Drive:
    friction = LuGre(stiffness, fit.damping.value - twin.sigma2, twin.sigma2, twin.Fc, twin.Fs, twin.vs)
    return Drive(fit.J.value, friction, twin.motor_constant)


def _on_the_ramp(ramp: ValidationResponse, volt: float) -> tuple[float, float]:
    """Measured over both predicted displacements where the ramp passes `volt`, averaged over 10 ms."""
    at = int(volt / RAMP * SAMPLE_RATE)
    near = slice(at - 50, at + 51)
    x = np.mean(ramp.measured[near])
    return float(x / np.mean(ramp.paper[near])), float(x / np.mean(ramp.extrapolated[near]))


def folded(x: Float[np.ndarray, " n"], frequency: float, *, skip: int) -> Float[np.ndarray, " period"]:
    """One period of a displacement: the mean over whole periods, smoothed over a hundredth of one, without its mean.

    **Arguments:**

    - `x`: displacement, rad, shape `(n,)`, a whole number of periods.
    - `frequency`: of the sine, Hz.
    - `skip`: periods to leave out at the beginning.

    **Returns:** the displacement, rad, shape `(period,)`.
    """
    period = round(SAMPLE_RATE / frequency)
    loop = np.mean(x[skip * period :].reshape(-1, period), axis=0)
    width = max(1, period // 100)
    smooth = np.convolve(np.concatenate([loop, loop[: width - 1]]), np.full(width, 1.0 / width), "valid")
    return smooth - np.mean(smooth)


def _breaks_away(x: Float[np.ndarray, " n"]) -> float:
    beyond = np.flatnonzero(x > 5e-3)
    return float(beyond[0] / SAMPLE_RATE) if beyond.size else float("nan")
