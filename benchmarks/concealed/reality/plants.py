"""Machines drawn at random: inertia, LuGre friction, motor and position sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PROCESS_NOISE = (0.0, 5e-4, 2e-3)


@dataclass(frozen=True)
class Plant:
    """One machine, in SI units: forces in N or N*m, positions in m or rad.

    `stroke` is the half-range that moves use and `top_speed` the fastest of them. `sensor_noise` is in encoder
    steps (rms) and `process_noise` the rms of a white force, held for one sample, as a share of `Fc`. `acceleration`
    is the largest of the moves' (0: the experiments choose), and `gravity` the weight of a link as a force, with the
    angle `gravity_at` of the origin against hanging (0: no link).
    """

    kind: str
    J: float
    sigma0: float
    sigma1: float
    sigma2: float
    Fc: float
    Fs: float
    vs: float
    motor_constant: float
    encoder_step: float
    sensor_noise: float
    process_noise: float
    stroke: float
    top_speed: float
    acceleration: float = 0.0
    gravity: float = 0.0
    gravity_at: float = 0.0
    input_unit: str = "V"

    @property
    def deflection(self) -> float:
        """Bristle deflection at break-away, Fs / sigma0: the length scale of presliding."""
        return self.Fs / self.sigma0

    @property
    def units(self) -> dict[str, str]:
        """Units as a case file names them."""
        rotary = self.kind == "rotary"
        return {
            "position_unit": "rad" if rotary else "m",
            "force_unit": "N*m" if rotary else "N",
            "input_unit": self.input_unit,
        }

    def base(self) -> dict[str, float]:
        """Parameters of the base model."""
        names = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
        return {name: float(getattr(self, name)) for name in names}


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """One draw whose logarithm is uniform between `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_plant(rng: np.random.Generator, kind: str | None = None) -> Plant:
    """Draw a machine; `kind` "rotary" or "linear" forces the sort, everything else stays random."""
    drawn = "rotary" if rng.random() < 0.5 else "linear"
    rotary = (kind or drawn) == "rotary"
    J = log_uniform(rng, 0.01, 0.1) if rotary else log_uniform(rng, 3.0, 30.0)
    natural = 2 * np.pi * log_uniform(rng, 25.0, 80.0)
    sigma0 = J * natural**2
    sigma1 = 2 * log_uniform(rng, 0.2, 0.8) * J * natural
    # Coulomb force over inertia, an acceleration, is what makes machines of one sort alike whatever their size.
    Fc = J * (log_uniform(rng, 10.0, 30.0) if rotary else log_uniform(rng, 1.2, 4.0))
    Fs = Fc * rng.uniform(1.1, 1.6)
    stroke = log_uniform(rng, 0.7, 1.4) if rotary else log_uniform(rng, 0.06, 0.12)
    top_speed = stroke * log_uniform(rng, 3.0, 6.0)
    return Plant(
        kind="rotary" if rotary else "linear",
        J=J,
        sigma0=sigma0,
        sigma1=sigma1,
        sigma2=log_uniform(rng, 0.05, 0.3) * Fc / top_speed,
        Fc=Fc,
        Fs=Fs,
        vs=log_uniform(rng, 0.01, 0.05) * top_speed,
        motor_constant=log_uniform(rng, 4.0, 40.0) if rotary else log_uniform(rng, 10.0, 100.0),
        encoder_step=Fs / sigma0 / log_uniform(rng, 250.0, 2500.0),
        sensor_noise=rng.uniform(0.35, 0.65),
        process_noise=float(rng.choice(PROCESS_NOISE)),
        stroke=stroke,
        top_speed=top_speed,
    )
