"""The prior of a calibration: machines, what acts in them beyond the base model, and experiments.

- **Machine.** Log-uniform: Coulomb friction Fc from 0.2 to 2 N m, break-away deflection Fs/sigma0 from 0.1 to 1 mrad,
  natural frequency in stick from 20 to 80 Hz (with sigma0 it gives J), Stribeck velocity vs from 0.01 to 0.1 rad/s,
  viscous friction at 1 rad/s from 0.03 to 0.3 Fc, unmeasured force from 0.0001 to 0.002 Fc (rms). Uniform: Fs/Fc from
  1.1 to 1.6, damping ratio in stick from 0.1 to 0.6.
- **What acts.** Nothing in a quarter of the machines; else one of the effects that the recordings can show, all with
  the same probability, in one of its forms.
- **Its size.** Log-uniform from the smallest step of its test to ten times that, or twice its largest step; either
  sign, any phase. Times and exponents are one of the values of its test; a period is log-uniform from a twelfth to a
  third of the stroke.
- **Experiments.** One of three families, see `FAMILIES`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from frictionjax.core import Parameter
from frictionjax.diagnosis.intake.coverage import not_shown
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.scales import plant_scales
from frictionjax.excitation import gaussian_noise, point_to_point, prbs, presliding_loop
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects import AbstractEffect, catalogue
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import simulate_imposed
from frictionjax.studies.simulated_recordings import Conditions, conditions_of, recordings_like

NOTHING = 0.25
"""Part of the machines that are the base model alone."""
_STEEPEST = 10.0  # sizes of an effect, over the smallest step of its test
_INSIDE = 0.95  # of its range, that a size takes at most
_FORCE = (1e-4, 2e-3)  # unmeasured, rms over Fc


class Truth(NamedTuple):
    """A machine of the prior, and how it is measured.

    **Attributes:** `family` (of the experiments), `acting` (names of the effects beyond the base model), `form` (of
    that effect; empty without one), `drive`, `conditions`.
    """

    family: str
    acting: tuple[str, ...]
    form: str
    drive: Drive
    conditions: Conditions

    @property
    def strength(self) -> tuple[str, float]:
        """Name and true value of the first strength of the effect; NaN without one."""
        if not self.acting:
            return "", float("nan")
        name = self.drive.effects[-1].strengths[0].name
        return name, float(getattr(self.drive.effects[-1], name))


def drawn_truth(family: str, rng: np.random.Generator) -> Truth:
    """A machine, with experiments of a `family`, drawn by `rng`."""
    drive = drawn_machine(rng)
    force = _log_uniform(rng, *_FORCE) * float(drive.friction.Fc)
    conditions = FAMILIES[family](drive, rng, force)
    if rng.random() < NOTHING:
        return Truth(family, (), "", drive, conditions)
    # What the recordings can show, and the plant's sizes, follow from the machine without the effect.
    plain = case_like(Truth(family, (), "", drive, conditions), rng)
    names = sorted(catalogue().keys() - not_shown(plain).keys())
    name = str(rng.choice(names))
    form = catalogue()[name][int(rng.integers(len(catalogue()[name])))]
    batch = conditions_of(plain.recordings, force=0.0, encoder_step=plain.plant.encoder_step).batch
    effect = drawn_effect(form, plant_scales(drive, batch), rng)
    return Truth(family, (name,), form.__name__, drive.with_effects(effect), conditions)


def case_like(truth: Truth, rng: np.random.Generator) -> Case:
    """What is recorded of the machine of a `truth`, with noise of `rng`.

    **Raises:** `InputError` where the machine runs away.
    """
    deflection = np.zeros(len(truth.conditions.recordings))
    recordings = recordings_like(truth.conditions, truth.drive, deflection, rng)
    step = truth.conditions.encoder_step or None
    return Case(truth.family, Plant(1.0, "rad", "N*m", "N*m", step), recordings)


def drawn_machine(rng: np.random.Generator) -> Drive:
    """A base model of the prior, drawn by `rng`."""
    Fc = _log_uniform(rng, 0.2, 2.0)
    Fs = Fc * rng.uniform(1.1, 1.6)
    sigma0 = Fs / _log_uniform(rng, 1e-4, 1e-3)
    J = sigma0 / (2.0 * np.pi * _log_uniform(rng, 20.0, 80.0)) ** 2
    sigma1 = 2.0 * rng.uniform(0.1, 0.6) * np.sqrt(sigma0 * J)
    vs, sigma2 = _log_uniform(rng, 0.01, 0.1), Fc * _log_uniform(rng, 0.03, 0.3)
    return Drive(J, LuGre(sigma0, sigma1, sigma2, Fc, Fs, vs), 1.0)


def drawn_effect(
    form: type[AbstractEffect], scales: dict[str, float], rng: np.random.Generator
) -> AbstractEffect:
    """An effect of a `form` for a plant of these `scales`, drawn by `rng`."""
    values: dict[str, Any] = {}
    for one in form.nuisances:
        if one.grid == "period":
            values[one.name] = scales["stroke"] * _log_uniform(rng, 1.0 / 12.0, 1.0 / 3.0)
        else:
            values[one.name] = float(rng.choice(np.asarray(one.grid))) * _scale(one, scales)
    strengths = form.strengths
    waves = [one.name.startswith(("sine", "cosine")) for one in strengths]
    turns = np.repeat(rng.uniform(0.0, 2.0 * np.pi, len(strengths)), 2)
    size = 1.0
    for place, one in enumerate(strengths):
        if not (waves[place] and place % 2):  # the two parts of a wave share their size
            steps = np.abs(one.probes)
            least = float(np.min(steps))
            size = _log_uniform(rng, least, max(_STEEPEST * least, 2.0 * float(np.max(steps))))
        part = (np.sin, np.cos)[place % 2](turns[place - place % 2]) if waves[place] else 1.0
        sign = rng.choice([-1.0, 1.0]) if one.lower < 0.0 and not waves[place] else 1.0
        low, high = _INSIDE * one.lower, _INSIDE * one.upper
        values[one.name] = float(np.clip(sign * part * size * _scale(one, scales), low, high))
    return form(**values)


def _bench(drive: Drive, rng: np.random.Generator, force: float) -> Conditions:
    """Noise, loops and sines on a bench: 2 kHz, a fine sensor."""
    n, rate, level = 8000, 2000.0, _break_away(drive)
    t = np.arange(n) / rate
    inputs = {
        "stick": 0.15 * level * np.asarray(prbs(_key(rng), n, rate, 400.0, 1.0)),
        "loud": 0.45 * level * np.asarray(gaussian_noise(_key(rng), n, rate, 300.0, 1.0)),
        "ramps": _ramps(n, rate, level, rng),
        "sines": rng.uniform(1.5, 3.0) * level * np.sin(2.0 * np.pi * rng.uniform(1.0, 3.0) * t),
        "others": rng.uniform(1.5, 3.0) * level * np.sin(2.0 * np.pi * rng.uniform(1.0, 3.0) * t),
        "loops": np.asarray(presliding_loop(n, rate, 0.9 * level, nested=(0.5, 0.25), rest=0.3)),
    }
    noise = _deflection(drive) / _log_uniform(rng, 100.0, 1000.0)
    return _measured(inputs, ("others", "loops"), rate, force, noise=noise)


def _moves(drive: Drive, rng: np.random.Generator, force: float) -> Conditions:
    """Moves and slow reversals of a machine in use: 1 kHz, an encoder whose step is felt."""
    n, rate = 6000, 1000.0
    inputs = {
        "moves": _to_move(drive, n, rate, rng),
        "slow": _ramps(n, rate, _break_away(drive), rng),
        "others": _to_move(drive, n, rate, rng),
    }
    step = _deflection(drive) / _log_uniform(rng, 5.0, 50.0)
    return _measured(inputs, ("others",), rate, force, step=step)


def _poor(drive: Drive, rng: np.random.Generator, force: float) -> Conditions:
    """Two short files: 500 Hz."""
    n, rate = 2500, 500.0
    inputs = {name: _to_move(drive, n, rate, rng) for name in ("moves", "others")}
    noise = _deflection(drive) / _log_uniform(rng, 20.0, 200.0)
    return _measured(inputs, ("others",), rate, force, noise=noise)


FAMILIES: dict[str, Callable[[Drive, np.random.Generator, float], Conditions]] = {
    "bench": _bench,
    "moves": _moves,
    "poor": _poor,
}
"""Families of experiments: of a machine, random numbers, and the unmeasured force (rms, force units)."""


def _measured(
    inputs: dict[str, Float[np.ndarray, " _"]],
    held_out: tuple[str, ...],
    rate: float,
    force: float,
    *,
    noise: float = 0.0,
    step: float = 0.0,
) -> Conditions:
    still = np.zeros(len(next(iter(inputs.values()))))
    recordings = [
        Recording(name, rate, u, still, role="holdout" if name in held_out else "fit")
        for name, u in inputs.items()
    ]
    found = conditions_of(recordings, force=force, encoder_step=step)
    assert isinstance(found.batch, Batch)
    total = np.full(len(recordings), np.hypot(noise, step / np.sqrt(12.0)))
    return eqx.tree_at(lambda one: one.batch.noise, found, total)


def _to_move(drive: Drive, n: int, rate: float, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
    """The input with which the base model makes a few moves, fast and slow, there and back."""
    speeds = float(drive.friction.vs) * np.exp(rng.uniform(np.log(1.0), np.log(20.0), 4))
    times = rng.uniform(0.1, 0.18, 4) * n / rate
    reach = np.cumsum(speeds * times * np.array([1.0, -1.0, 1.0, -1.0]) / 1.875)
    x = np.asarray(point_to_point(n, rate, reach.tolist(), times.tolist(), rests=0.05 * n / rate))
    acceleration = np.gradient(np.gradient(x)) * rate**2
    friction = np.asarray(simulate_imposed(drive, x, rate).friction)
    return friction + float(drive.J) * acceleration


def _ramps(n: int, rate: float, level: float, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Ramps through break-away in both directions with rests and a smaller loop between them."""
    high, low = level * rng.uniform(1.03, 1.2, 2)
    corners = [(0.0, 0.0), (0.05, 0.0), (0.3, high), (0.33, 0.0), (0.42, 0.0), (0.5, -0.5 * level)]
    corners += [(0.6, 0.5 * level), (0.65, 0.0), (0.9, -low), (0.93, 0.0), (1.0, 0.0)]
    times, levels = zip(*corners, strict=True)
    return np.interp(np.arange(n) / n, times, levels)


def _key(rng: np.random.Generator) -> jax.Array:
    return jax.random.key(int(rng.integers(2**31)))


def _break_away(drive: Drive) -> float:
    return float(drive.friction.Fs / drive.motor_constant)


def _deflection(drive: Drive) -> float:
    return float(drive.friction.Fs / drive.friction.sigma0)


def _scale(one: Parameter, scales: dict[str, float]) -> float:
    return one.scale if isinstance(one.scale, float) else scales[str(one.scale)]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
