"""Effects of structure, drive, timing and sensor."""

from __future__ import annotations

import numpy as np

from .plants import Plant, log_uniform

Drawn = tuple[dict, dict]
Rng = np.random.Generator


def flexible_transmission(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Part of the inertia sits behind a spring; motor and sensor are on the side that rubs."""
    m2 = 0.35 * size * plant.J
    w = 2 * np.pi * log_uniform(rng, 45.0, 110.0)
    zeta = log_uniform(rng, 0.01, 0.04)
    knobs = {"m2": m2, "k2": m2 * w**2, "d2": 2 * zeta * m2 * w}
    return knobs, {"load_inertia": m2, "antiresonance": w / (2 * np.pi), "damping_ratio": zeta}


def backlash(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Part of the inertia sits behind a gap with stiff flanks."""
    m2 = rng.uniform(0.25, 0.45) * plant.J
    w = 2 * np.pi * log_uniform(rng, 200.0, 350.0)
    gap = 1.5 * size * plant.deflection
    knobs = {
        "m2": m2,
        "k2": m2 * w**2,
        "d2": 2 * rng.uniform(0.2, 0.4) * m2 * w,
        "gap": gap,
        "b2": m2 / log_uniform(rng, 0.5, 2.0),
    }
    return knobs, {"load_inertia": m2, "gap": 2 * gap, "contact_frequency": w / (2 * np.pi)}


def delay(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Pure delay, of the input or of the measured position."""
    if rng.random() < 0.6:
        return {"delay": 3e-3 * size}, {"form": "input", "time": 3e-3 * size}
    return {"out_delay": 3e-3 * size}, {"form": "output", "time": 3e-3 * size}


def drive_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """First-order lag between input and force."""
    return {"drive_tau": 2.5e-3 * size}, {"time": 2.5e-3 * size}


def drive_deadzone(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Input without effect around zero."""
    width = 0.05 * size * plant.Fs / plant.motor_constant
    return {"dead": width}, {"half_width": width}


def drive_saturation(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Gain that falls with the input: gradually, or with a hard limit above break-away."""
    unit = plant.Fs / plant.motor_constant
    if rng.random() < 0.6:
        n, loss = rng.uniform(1.5, 3.0), 0.2 * size
        # The loss is what is missing at one and a half times break-away.
        scale = 1.5 * unit / ((1 - loss) ** -n - 1) ** (1 / n)
        return {"sat_u": scale, "sat_n": n}, {"form": "soft", "input": scale, "power": n, "loss": loss}
    limit = unit * (1.1 + 0.3 * size**-0.4)
    return {"sat_u": limit, "sat_hard": 1.0}, {"form": "hard", "input": limit}


def encoder_error(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Sub-divisional error of the encoder: two harmonics of its grating period."""
    amplitude = 3.0 * size * plant.encoder_step
    knobs = {
        "enc1": amplitude,
        "enc2": amplitude * rng.uniform(0.2, 0.6),
        "enc_p": plant.encoder_step * log_uniform(rng, 80.0, 400.0),
        "enc_f1": rng.uniform(0, 2 * np.pi),
        "enc_f2": rng.uniform(0, 2 * np.pi),
    }
    return knobs, {"amplitudes": np.array([amplitude, knobs["enc2"]]), "period": knobs["enc_p"]}


def torque_ripple(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Motor constant that varies periodically with position: a ripple proportional to the input."""
    knobs = {
        "tr1": 0.1 * size,
        "tr2": 0.1 * size * rng.uniform(0.2, 0.5),
        "tr_p": plant.stroke * log_uniform(rng, 0.06, 0.25),
        "tr_f1": rng.uniform(0, 2 * np.pi),
        "tr_f2": rng.uniform(0, 2 * np.pi),
    }
    return knobs, {"amplitudes": np.array([knobs["tr1"], knobs["tr2"]]), "period": knobs["tr_p"]}


def sensor_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """First-order filter in the position sensor."""
    return {"sensor_tau": 2.5e-3 * size}, {"time": 2.5e-3 * size}


def mains_pickup(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Mains frequency in the measured position."""
    knobs = {
        "mains_a": 4.0 * size * plant.encoder_step,
        "mains_f": float(rng.choice([50.0, 60.0])),
        "mains_ph": rng.uniform(0, 2 * np.pi),
    }
    return knobs, {"amplitude": knobs["mains_a"], "frequency": knobs["mains_f"]}


DRIVE = {
    effect.__name__: effect
    for effect in (
        flexible_transmission,
        backlash,
        delay,
        drive_lag,
        drive_deadzone,
        drive_saturation,
        encoder_error,
    )
}
DRIVE_EXTRA = {effect.__name__: effect for effect in (torque_ripple, sensor_lag, mains_pickup)}
