"""Position loops of drives and robots: P-PI or PD, with what they feed forward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plants import Plant


@dataclass(frozen=True)
class Loop:
    """One loop as it is set: `gains` in the order the simulator reads them (input units a position unit, s, input
    units), and the shares of acceleration, speed, Coulomb friction and weight that are fed forward.

    A P-PI cascade is a PID law on the position error; what it leaves out of the reference's speed is fed forward with
    the opposite sign: `left_out` (input units a speed, input units a position).
    """

    gains: np.ndarray
    acceleration: float
    speed: float
    coulomb: float
    weight: float
    left_out: tuple[float, float] = (0.0, 0.0)

    def feed(self, plant: Plant, reference: np.ndarray, rate: float) -> np.ndarray:
        """What is added to the input beforehand, one value a sample."""
        v = np.gradient(reference) * rate
        a = np.gradient(v) * rate
        force = self.acceleration * plant.J * a + self.speed * plant.sigma2 * v
        force += self.coulomb * plant.Fc * np.tanh(v / (0.005 * plant.top_speed))
        force += self.weight * plant.gravity * np.sin(reference + plant.gravity_at)
        by_speed, by_place = self.left_out
        return force / plant.motor_constant - by_speed * v - by_place * (reference - reference[0])


def _limit(plant: Plant) -> float:
    """The drive gives twice what its fastest move needs, input units."""
    needs = plant.Fs + plant.gravity + plant.J * plant.acceleration + plant.sigma2 * plant.top_speed
    return 2.0 * needs / plant.motor_constant


def _speed_gain(rng: np.random.Generator, plant: Plant, low: float, high: float) -> float:
    """Bandwidth of the speed loop, 1/s: between `low` and `high` Hz, and less where one step of the encoder would
    make the input jump by more than break-away."""
    quiet = np.sqrt(0.15 * plant.Fs / (plant.J * plant.encoder_step))
    return float(min(2 * np.pi * rng.uniform(low, high), quiet))


def _shares(rng: np.random.Generator, weight: float = 0.0) -> dict[str, float]:
    fed = rng.random() < 0.5
    return {
        "acceleration": rng.uniform(0.7, 1.05),
        "speed": rng.uniform(0.5, 1.0),
        "coulomb": rng.uniform(0.4, 0.9) if fed else 0.0,
        "weight": weight,
    }


def p_pi(rng: np.random.Generator, plant: Plant, low: float, high: float) -> Loop:
    """Position gain, and a PI loop for the speed inside."""
    w = _speed_gain(rng, plant, low, high)
    place, slow = w / rng.uniform(4.0, 6.0), w / rng.uniform(5.0, 10.0)
    kv = plant.J * w / plant.motor_constant
    gains = np.array(
        [kv * (place + slow), kv, rng.uniform(0.1, 0.2) / w, _limit(plant), np.inf, kv * slow * place]
    )
    short = rng.uniform(0.0, 0.3)
    return Loop(gains, **_shares(rng), left_out=(kv * short, kv * slow * short))


def pd(rng: np.random.Generator, plant: Plant, low: float, high: float) -> Loop:
    """PD law tuned on the inertia."""
    w = _speed_gain(rng, plant, low, high)
    damping = rng.uniform(0.7, 1.0)
    kd = plant.J * w / plant.motor_constant
    gains = np.array([kd * w / (2 * damping) ** 2, kd, rng.uniform(0.1, 0.2) / w, _limit(plant), np.inf, 0.0])
    return Loop(gains, **_shares(rng))


def joint_pd(rng: np.random.Generator, plant: Plant, rate: float) -> Loop:
    """PD law at a slow rate: as fast as the rate allows, up to 6 Hz; most of the weight is fed forward."""
    w = 2 * np.pi * min(rate / rng.uniform(22.0, 30.0), 6.0)
    damping = rng.uniform(0.7, 0.9)
    kp, kd = plant.J * w**2 / plant.motor_constant, 2 * damping * plant.J * w / plant.motor_constant
    gains = np.array([kp, kd, rng.uniform(0.1, 0.3) / rate, _limit(plant), np.inf, 0.0])
    return Loop(gains, **_shares(rng, rng.uniform(0.6, 1.0)))


def loop_of(rng: np.random.Generator, plant: Plant, family: str, rate: float) -> Loop:
    """The loop of a machine of a family."""
    if family == "joint":
        return joint_pd(rng, plant, rate)
    low, high = (10.0, 30.0) if family == "industrial" else (8.0, 16.0)
    return (p_pi if rng.random() < 0.5 else pd)(rng, plant, low, high)
