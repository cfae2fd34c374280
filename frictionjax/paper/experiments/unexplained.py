"""The question that the paper leaves open, answered by `diagnose`: why does a machine move further than LuGre?"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Progress, silent
from frictionjax.diagnosis import Diagnosis, diagnose
from frictionjax.paper.experiments.rig import Twin, measure, twins
from frictionjax.recordings import Case, Plant, Recording

RATE = 2000.0  # Hz: what a diagnosis needs, and a fifth of the rig's
FINER = 8.0  # ours: how many times finer than the rig's the encoder of a diagnosis is
_BANDWIDTH = 10.0  # Hz, of the controller that makes the moves
ANSWERS = {
    "LuGre": None,
    "non-local memory": "maxwell_slip",
    "creep": "creep",
    "softening bristle": "nonlinear_bristle",
}
"""The effect that a LuGre model of each twin lacks, by its name in the catalogue; None for nothing."""


def rigid(twin: Twin) -> Twin:
    """The twin without its transmission and its delay, so that it differs from LuGre by its friction alone."""
    return replace(twin, arm_share=0.0, delay=0)


def case_of(twin: Twin, *, finer: float = FINER, seed: int = 0) -> Case:
    """Six recordings to fit and two held-out ones, of the twin without its transmission.

    Two noises, ramps with holds, sines of several amplitudes and two frequencies, moves and a sweep under a
    controller; held out are nested loops with a sine, and other moves.

    **Arguments:**

    - `twin`: the machine; only its friction differs from a `Drive` with LuGre.
    - `finer`: how many times finer than the rig's its encoder is.
    - `seed`: of the excitation and of the encoder's noise.

    **Returns:** the `Case`.
    """
    machine = replace(rigid(twin), encoder_step=twin.encoder_step / finer)
    rng = np.random.default_rng(seed)
    open_loop = {name: machine.static_voltage * u for name, u in _voltages(rng).items()}
    closed_loop = _references()
    recordings = []
    loops: tuple[tuple[Literal["open", "closed"], dict], ...] = (("open", open_loop), ("closed", closed_loop))
    for loop, signals in loops:
        n = max(signal.size for signal in signals.values())
        asked = np.stack([np.pad(u, (0, n - u.size), mode="edge") for u in signals.values()], axis=1)
        still = np.zeros_like(asked)
        run = measure(
            [machine] * len(signals),
            asked if loop == "open" else still,
            reference=None if loop == "open" else asked,
            bandwidth=0.0 if loop == "open" else _BANDWIDTH,
            seed=seed + (loop == "closed"),
            sample_rate=RATE,
            substeps=15,
        )
        recordings += [
            Recording(
                name=name,
                sample_rate=RATE,
                u=run.u[: signal.size, i],
                x=run.x[: signal.size, i],
                role="holdout" if name.startswith("holdout") else "fit",
                loop=loop,
                start_time=20.0 * (len(recordings) + i),
            )
            for i, (name, signal) in enumerate(signals.items())
        ]
    plant = Plant(
        motor_constant=machine.motor_constant,
        position_unit="rad",
        force_unit="N*m",
        input_unit="V",
        encoder_step=machine.encoder_step,
    )
    return Case(name=twin.name, plant=plant, recordings=tuple(recordings))


class Explained(eqx.Module):
    """The diagnosis of a twin.

    **Attributes:**

    - `twin`: the machine.
    - `answer`: the true missing effect, by its name in the catalogue; None for nothing.
    - `diagnosis`: the result.
    """

    twin: Twin
    answer: str | None = eqx.field(static=True)
    diagnosis: Diagnosis

    @property
    def named(self) -> tuple[str, ...]:
        """The effects that were named, strongest first."""
        return tuple(missing.effect for missing in self.diagnosis.missing)

    @property
    def right(self) -> bool:
        """Whether the effect named first is the true one; where nothing is missing, whether nothing was named."""
        return (self.named[0] if self.named else None) == self.answer


def explain(
    machines: Sequence[Twin] | None = None,
    *,
    finer: float = FINER,
    seed: int = 0,
    progress: Progress = silent,
) -> tuple[Explained, ...]:
    """Diagnose the twins, a minute or two each.

    With the encoder of the rig, creep and non-local memory are named, and the softening bristle is not: its effect is
    too small at an encoder step of about 10 µrad. With one that is eight times finer, all three are.

    **Arguments:**

    - `machines`: twins whose names stand in `ANSWERS`; the three that are not LuGre when absent.
    - `finer`: how many times finer than the rig's the encoder is.
    - `seed`: of all noise.
    - `progress`: called as the work goes on.

    **Returns:** an `Explained` for each machine.
    """
    machines = twins()[1:] if machines is None else tuple(machines)
    found = []
    for i, twin in enumerate(machines):

        def inner(stage: str, fraction: float, i: int = i, twin: Twin = twin) -> None:
            progress(f"{twin.name}: {stage}", (i + fraction) / len(machines))

        inner("measuring", 0.0)
        diagnosis = diagnose(case_of(twin, finer=finer, seed=seed), progress=inner)
        found.append(Explained(twin=twin, answer=ANSWERS[twin.name], diagnosis=diagnosis))
    return tuple(found)


def _voltages(rng: np.random.Generator) -> dict[str, Float[np.ndarray, " _"]]:
    """Inputs of the open loop over the voltage that breaks away."""

    def lines(*corners: tuple[float, float]) -> Float[np.ndarray, " n"]:
        """Straight lines through corners given as (seconds after the one before, level)."""
        times = np.cumsum([0.0, *(seconds for seconds, _ in corners)])
        return np.interp(_time(times[-1]), times, [0.0, *(level for _, level in corners)])

    def sines(*bursts: tuple[float, float, int]) -> Float[np.ndarray, " n"]:
        """Whole periods in turn, given as (frequency, level, periods)."""
        return np.concatenate([a * np.sin(2.0 * np.pi * f * _time(k / f)) for f, a, k in bursts])

    def triangle(*levels: float, rate: float) -> Float[np.ndarray, " n"]:
        steps = np.abs(np.diff([0.0, *levels])) / rate
        return lines((0.2, 0.0), *zip(steps, levels, strict=True))

    n = round(6.0 * RATE)
    ramps = (
        (0.1, 0.0),
        (1.0, 1.08),
        (0.15, 0.0),
        (0.5, 0.0),
        (0.2, 0.75),
        (1.2, 0.75),
        (0.1, 0.0),
        (0.6, 0.0),
    )
    ramps += ((0.5, -0.9), (0.7, -0.9), (0.15, -1.1), (0.15, 0.0), (0.4, 0.0))
    nested = (0.85, -0.85, 0.5, -0.5, 0.25, -0.25, 0.25, -0.5, 0.85, -0.75, 0.4, 0.1, 0.6, -0.2, 0.75, 0.0)
    return {
        "noise_small": 0.12 * np.repeat(rng.choice([-1.0, 1.0], n // 2), 2),
        "noise_large": 0.35 * np.repeat(rng.choice([-1.0, 1.0], n // 2), 2),
        "breakaway": lines(*ramps),
        "stick_sines": sines((1.0, 0.3, 1), (1.0, 0.6, 1), (1.0, 0.9, 2), (10.0, 0.5, 5), (10.0, 0.9, 5)),
        "holdout_stick": np.concatenate(
            [
                triangle(*nested, rate=4.4),
                sines((2.5, 0.6, 2), (0.7, 0.85, 1)),
                lines((0.2, 0.7), (0.6, 0.7), (0.1, 0.0)),
            ]
        ),
    }


def _references() -> dict[str, Float[np.ndarray, " n"]]:
    """Angles for the controller to follow, rad."""

    def moves(*given: tuple[float, float, float]) -> Float[np.ndarray, " n"]:
        """Moves of least jerk, given as (distance, duration, rest after it)."""
        t = _time(6.0)
        start, position = 0.2, np.zeros(t.size)
        for distance, duration, rest in given:
            s = np.clip((t - start) / duration, 0.0, 1.0)
            position += distance * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
            start += duration + rest
        return position

    t, growth = _time(6.0), np.log(6.0 / 0.4) / 6.0
    sweep = 0.25 * 0.16 ** (t / 6.0) * np.sin(2.0 * np.pi * 0.4 * np.expm1(growth * t) / growth)
    first = ((0.3, 0.4, 0.3), (-0.3, 0.25, 0.3), (0.05, 0.4, 0.25), (-0.07, 0.9, 0.3), (0.4, 0.4, 0.3))
    first += ((-0.5, 0.5, 0.35), (0.02, 0.5, 0.3))
    other = ((-0.2, 0.3, 0.35), (0.08, 0.6, 0.25), (0.45, 0.4, 0.35), (-0.04, 0.7, 0.25), (-0.35, 0.45, 0.3))
    return {"moves": moves(*first), "sweep": sweep, "holdout_moves": moves(*other, (0.15, 1.0, 0.3))}


def _time(seconds: float) -> Float[np.ndarray, " n"]:
    return np.arange(round(seconds * RATE)) / RATE
