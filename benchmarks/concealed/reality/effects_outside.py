"""Physics that no catalogue lists: what a diagnosis should notice and decline to name."""

from __future__ import annotations

import numpy as np

from .plants import Plant, log_uniform

Drawn = tuple[dict, dict]
Rng = np.random.Generator


def friction_bump(rng: Rng, plant: Plant, size: float) -> Drawn:
    """More friction at one spot of the stroke."""
    place, width = rng.uniform(-0.6, 0.6) * plant.stroke, rng.uniform(0.05, 0.12) * plant.stroke
    return {"bump_a": 0.5 * size, "bump_x": place, "bump_w": width}, {
        "height": 0.5 * size,
        "place": place,
        "width": width,
    }


def sticky_spot(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Static friction much higher within a narrow region, sliding friction as elsewhere."""
    place = float(rng.choice([-0.4, 0.0, 0.4])) * plant.stroke
    width = rng.uniform(0.03, 0.08) * plant.stroke
    return {"spot_a": 0.8 * size, "spot_x": place, "spot_w": width}, {"rise": 0.8 * size, "place": place}


def cable_slack(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A cable that pulls on one side of a position and is slack on the other."""
    place = rng.uniform(0.05, 0.5) * plant.stroke
    stiffness = 0.5 * size * plant.Fs / (plant.stroke - place)
    return {"slack_k": stiffness, "slack_x": place}, {"stiffness": stiffness, "place": place}


def stochastic_friction(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Friction level that wanders at random."""
    knobs = {"ou_std": 0.12 * size, "ou_tau": log_uniform(rng, 0.5, 5.0)}
    return knobs, {"std": knobs["ou_std"], "time": knobs["ou_tau"]}


def decaying_detent(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Magnetic detent, periodic in position, that decays after power-on."""
    knobs = {
        "detent_a": 0.15 * size * plant.Fc,
        "detent_p": plant.stroke * log_uniform(rng, 0.06, 0.25),
        "detent_ph": rng.uniform(0, 2 * np.pi),
        "detent_tau": log_uniform(rng, 80.0, 200.0),
    }
    return knobs, {"force": knobs["detent_a"], "period": knobs["detent_p"], "time": knobs["detent_tau"]}


def gear_impacts(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A short pulse of force against the motion at each tooth, in one direction only."""
    knobs = {
        "hit_a": 1.5 * size * plant.Fs,
        "hit_p": plant.stroke * log_uniform(rng, 0.1, 0.3),
        "hit_tau": log_uniform(rng, 2e-3, 6e-3),
        "hit_dir": float(rng.choice([-1.0, 1.0])),
    }
    return knobs, {"force": knobs["hit_a"], "pitch": knobs["hit_p"], "time": knobs["hit_tau"]}


def supply_sag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Motor constant that falls with the recent average of the input."""
    knobs = {
        "sag_a": 0.2 * size,
        "sag_tau": log_uniform(rng, 0.3, 2.0),
        "sag_u": plant.Fs / plant.motor_constant,
    }
    return knobs, {"loss_at_breakaway": knobs["sag_a"], "time": knobs["sag_tau"]}


def drive_hysteresis(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Iron that remembers: part of the input passes through plays (a Preisach operator)."""
    n = int(rng.integers(3, 7))
    radii = np.sort(rng.uniform(0.05, 0.6, n)) * plant.Fs / plant.motor_constant
    return {"hys_a": 0.3 * size, "hys_n": n, "hys_r": radii}, {"share": 0.3 * size, "radii": radii}


def sensor_drift(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Offset of the position sensor that walks at random, on through the pauses."""
    std = 0.03 * size * plant.deflection
    return {"walk_std": std}, {"std_after_1_s": std}


def damping_pinch(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A drag that appears around one speed and goes again above it."""
    knobs = {
        "pinch_a": 0.35 * size * plant.Fc,
        "pinch_v": rng.uniform(0.15, 0.4) * plant.top_speed,
        "pinch_w": 0.07 * plant.top_speed,
    }
    return knobs, {"force": knobs["pinch_a"], "speed": knobs["pinch_v"]}


def payload_added(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Inertia that grows at one moment between power-on and the end."""
    knobs = {"pay_share": 0.4 * size, "pay_t": rng.uniform(40.0, 180.0)}
    return knobs, {"share": knobs["pay_share"], "moment": knobs["pay_t"]}


def steep_drag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Drag with the fourth power of speed."""
    coefficient = 0.8 * size * plant.Fc / plant.top_speed**4
    return {"pow4": coefficient}, {"coefficient": coefficient}


def intermittent_contact(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Rubs in every n-th turn only."""
    n = int(rng.integers(2, 4))
    pitch = plant.stroke * rng.uniform(0.12, 0.3)
    return {"nth_a": 0.5 * size, "nth_p": pitch, "nth_n": float(n)}, {
        "rise": 0.5 * size,
        "pitch": pitch,
        "every": n,
    }


def motor_fade(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Motor constant that falls while the magnets warm up."""
    knobs = {"fade_a": 0.15 * size, "fade_tau": log_uniform(rng, 60.0, 200.0)}
    return knobs, {"loss": knobs["fade_a"], "time": knobs["fade_tau"]}


def floor_vibration(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A neighbouring machine shakes the floor at one frequency."""
    knobs = {
        "vib_a": 0.08 * size * plant.Fs,
        "vib_f": log_uniform(rng, 4.0, 23.0),
        "vib_ph": rng.uniform(0, 2 * np.pi),
    }
    return knobs, {"force": knobs["vib_a"], "frequency": knobs["vib_f"]}


def loose_sensor(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Play between the shaft and the sensor."""
    half = 0.1 * size * plant.deflection
    return {"play_b": half}, {"half_play": half}


RANDOM = ("outside:stochastic_friction", "outside:sensor_drift")
"""What is random at every moment."""

OUTSIDE_EFFECTS = {
    f"outside:{effect.__name__}": effect
    for effect in (
        friction_bump,
        sticky_spot,
        cable_slack,
        stochastic_friction,
        decaying_detent,
        gear_impacts,
        supply_sag,
        drive_hysteresis,
        sensor_drift,
        damping_pinch,
        payload_added,
        steep_drag,
        intermittent_contact,
        motor_fade,
        floor_vibration,
        loose_sensor,
    )
}
