"""The next experiment: the one that distinguishes effects which the recordings leave possible, and its duration.

Some simple experiments are simulated as free runs of both fitted models, and the rival is refitted to each: the
difference that remains, over the sensor's noise, is the d' of the experiment (information.discrimination). d' grows
with the square root of its duration.
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError, Progress
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.verdict import NextExperiment
from frictionjax.information import rank_for_discrimination

_SECONDS = 4.0  # of each candidate

_RATE = 1000.0  # Hz, at most

_WANTED = 5.0  # d' at which the effects are distinguished

_STEPS = 3  # of the rival's refit

_LONGEST = 3600.0  # s: a longer experiment is not proposed


def plain_experiments(break_away: float, sample_rate: float) -> dict[str, Float[np.ndarray, " n"]]:
    """Experiments in words -> input of 4 s at `sample_rate` Hz, scaled by `break_away` (the input at which the machine
    breaks away)."""
    t = np.arange(round(_SECONDS * sample_rate)) / sample_rate
    rng = np.random.default_rng(5)

    def line(*corners: tuple[float, float]) -> Float[np.ndarray, " n"]:
        times, levels = zip(*corners, strict=True)
        return np.interp(t, times, levels)

    def noise(level: float) -> Float[np.ndarray, " n"]:
        white = rng.standard_normal(t.size)
        spectrum = np.fft.rfft(white)
        spectrum[np.fft.rfftfreq(t.size, 1.0 / sample_rate) > 150.0] = 0.0
        shaped = np.fft.irfft(spectrum, t.size)
        return level * shaped / np.std(shaped)

    loops = line(
        *((0.0, 0.0), (0.3, 0.9), (0.9, -0.9), (1.3, 0.5), (1.6, -0.5), (1.8, 0.25)),
        *((2.0, -0.25), (2.3, 0.9), (2.9, -0.9), (3.4, 0.6), (3.7, 0.0), (4.0, 0.0)),
    )
    hold = line((0.0, 0.0), (0.1, 0.0), (0.12, 0.6), (2.0, 0.6), (2.02, 0.0), (4.0, 0.0))
    ramps = line(
        (0.0, 0.0), (1.0, 1.08), (1.05, 0.0), (2.0, 0.0), (2.5, -1.08), (2.55, 0.0), (3.5, 1.08), (3.55, 0.0)
    )
    named = {
        "nested triangles of force below break-away (0.9, 0.5, 0.25 of it)": loops,
        "a force held at 0.6 of break-away for 2 s, then released": hold,
        "noise of a tenth of break-away (rms)": noise(0.1),
        "noise of a third of break-away (rms)": noise(0.33),
        "slow ramps through break-away in both directions, with rests between": ramps,
        "a sine of twice break-away at 2 Hz": 2.0 * np.sin(2.0 * np.pi * 2.0 * t),
    }
    return {name: break_away * signal for name, signal in named.items()}


def next_experiment(accepted: Refitted, rival: Refitted) -> NextExperiment | None:
    """The simple experiment that best distinguishes the `accepted` model from the `rival`, both as fitted; None where
    none does within an hour.

    **Raises:** `InputError` where there is nothing to design: two forms of one effect, runs that overflow, or motions
    that are imposed.
    """
    if accepted.model.posterior.batch.imposed:
        raise InputError(
            "the motion is imposed, and the standard experiments apply a force",
            cure="Impose slower and faster motions, small loops inside large ones, and rests.",
        )
    drive = accepted.model.judgement.drive
    batch = accepted.model.posterior.batch
    rate = min(1.0 / float(np.max(np.asarray(batch.dt))), _RATE)
    # Not always the last one: where it kept its place beside what came later, the order is that of both.
    own, its = accepted.own_effect, rival.own_effect
    without = dataclasses.replace(drive, effects=tuple(one for one in drive.effects if one is not own))
    break_away = float(drive.friction.Fs) / float(drive.motor_constant)
    candidates = {name: jnp.asarray(u) for name, u in plain_experiments(break_away, rate).items()}
    noise = float(np.median(np.asarray(batch.noise)))
    ranked = rank_for_discrimination(
        without, own, its, candidates, rate, noise, refit_steps=_STEPS, progress=False
    )
    best = ranked.best
    seconds = _SECONDS * max((_WANTED / best.d_prime) ** 2, 1.0) if best.d_prime > 0.0 else np.inf
    if not seconds < _LONGEST:
        return None
    between = (accepted.effect, rival.effect)
    sentence = (
        f"To distinguish {between[0]} from {between[1]}: {best.name}, {seconds:.0f} s (one pass of {_SECONDS:.0f} s "
        f"separates them by {best.d_prime:.1f} standard deviations of the sensor's noise)."
    )
    return NextExperiment(
        between, best.name, best.d_prime, seconds, np.asarray(candidates[best.name]), rate, sentence
    )


def experiments_for(
    steps: Sequence[Step], progress: Progress
) -> tuple[dict[str, NextExperiment], tuple[str, ...]]:
    """The experiments that distinguish what the `steps` named from the closest of its class.

    **Arguments:** the `steps` of a selection; `progress`, called for each experiment.

    **Returns:** named effect -> its experiment; and, in sentences, why there is none for the others.
    """
    found, failed = {}, []
    for step in steps:
        if step.accepted is None or not step.rivals:
            continue
        rival = next(r for r in step.refits if r.effect in step.rivals)
        progress(
            f"designing an experiment that distinguishes {step.accepted.effect} from {rival.effect}", 0.97
        )
        pair = f"{step.accepted.effect} from {rival.effect}"
        try:
            designed = next_experiment(step.accepted, rival)
        except InputError as error:
            failed.append(f"No experiment was designed that distinguishes {pair}: {error}")
            continue
        if designed is None:
            failed.append(f"None of the standard experiments distinguishes {pair} within an hour.")
        else:
            found[step.accepted.effect] = designed
    return found, tuple(failed)
