"""Another form of every effect: what machines of the newer families may have in place of the usual one.

A form is a function of a random stream, a plant and a size, as an effect is; its truth says which form it is. Physical
sizes have names of their own where they do not mean what the usual form's do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .knobs import MAX_ELEMENTS
from .plants import Plant, log_uniform

Drawn = tuple[dict, dict]
Rng = np.random.Generator


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _phase(rng: Rng) -> float:
    return rng.uniform(0, 2 * np.pi)


def maxwell_slip(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Plays whose stiffness falls as a power of their reach, over two decades of it."""
    share = min(0.75 * size, 1.0)
    reach = np.geomspace(0.02, 2.0, MAX_ELEMENTS)
    power = rng.uniform(0.3, 1.0)
    weight = reach**-power / np.sum(reach**-power)
    reach *= plant.deflection / (weight @ reach)
    stiffness = share * plant.sigma0 * weight
    knobs = {"mw_n": MAX_ELEMENTS, "mw_share": share, "mw_k": stiffness, "mw_a": stiffness * reach / plant.Fs}
    return knobs, {"form": "power law", "share": share, "power": power}


def elasto_plastic(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Slip that sets in with a power of what exceeds the elastic share."""
    ratio, power = min(0.65 * size, 0.9), rng.uniform(0.7, 2.5)
    return {"ep_ratio": ratio, "ep_pow": power}, {"form": "power", "elastic_share": ratio, "power": power}


def nonlinear_bristle(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A bristle that becomes stiffer at a knee."""
    knee, rise = rng.uniform(0.2, 0.5), 1.2 * size
    return {"nl_knee": knee, "nl_rise": rise}, {"form": "knee", "at": knee, "rise": rise}


def creep(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Logarithmic in time, beside a compartment that is quick."""
    compliance = 0.2 * size
    length = compliance * plant.deflection / rng.uniform(6.0, 10.0)
    knobs = {"cl": compliance, "cl_len": length, "cl_tau": log_uniform(rng, 20.0, 200.0)}
    knobs |= {"c1": 0.12 * size, "t1": log_uniform(rng, 0.02, 0.1)}
    return knobs, {"form": "logarithmic beside a compartment", **knobs}


def direction_asymmetry(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Coulomb friction alone differs with direction; what static friction adds to it, and viscous friction, do not."""
    part = _sign(rng) * 0.12 * size
    return {"dir_fc": part}, {"form": "Coulomb alone", "coulomb": part}


def constant_load(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A load that differs between the ends of the stroke."""
    force = _sign(rng) * 0.06 * size * plant.Fs
    bend = force * rng.uniform(-0.3, 0.3)
    knobs = {"const": force, "const_bend": bend, "const_len": 0.5 * plant.stroke}
    return knobs, {"form": "bent", "middle_force": force, "bend": bend}


def return_spring(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A spring that hardens along the stroke."""
    stiffness = 0.2 * size * plant.Fs / plant.stroke
    cubic = stiffness * rng.uniform(0.4, 1.2) / plant.stroke**2
    return {"spring": stiffness, "spring3": cubic}, {
        "form": "hardening",
        "at_rest": stiffness,
        "cubic": cubic,
    }


def gravity_pendulum(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A weight on a linkage: its lever arm has a second harmonic."""
    if plant.kind != "rotary":
        raise ValueError("gravity_pendulum needs a rotary machine")
    weight = plant.gravity or 0.25 * size * plant.Fs
    at = plant.gravity_at if plant.gravity else rng.uniform(-0.3, 0.3)
    second = weight * rng.uniform(0.1, 0.25)
    knobs = {"grav": weight, "grav2": second, "grav_x0": at}
    return knobs, {"form": "linkage", "weight": weight, "second": second, "at": at}


def ripple(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Cogging of slots: short pulls to either side, level between them."""
    force = 0.25 * size * plant.Fc
    period = plant.stroke * log_uniform(rng, 0.06, 0.25)
    knobs = {"rip_peak": force, "rip_p": period, "rip_f1": _phase(rng)}
    return knobs, {"form": "slots", "peak": force, "period": period}


def position_dependence(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A saw along the stroke, or more friction over a part of it."""
    if rng.random() < 0.5:
        knobs = {"pos_saw": 0.2 * size, "pos_p": plant.stroke * log_uniform(rng, 0.3, 1.2)}
        return knobs, {"form": "saw", "height": knobs["pos_saw"], "pitch": knobs["pos_p"]}
    knobs = {
        "pos_hill": 0.4 * size,
        "pos_x": rng.uniform(-0.4, 0.4) * plant.stroke,
        "pos_w": rng.uniform(0.15, 0.4) * plant.stroke,
    }
    return knobs, {"form": "hill", "height": 0.4 * size, "place": knobs["pos_x"], "width": knobs["pos_w"]}


def quadratic_drag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Drag with a power of speed that is not 2."""
    power = rng.uniform(1.5, 1.8) if rng.random() < 0.5 else rng.uniform(2.2, 2.7)
    coefficient = 0.5 * size * plant.Fc / plant.top_speed**power
    return {"quad": coefficient, "quad_pow": power}, {"form": "power", "factor": coefficient, "power": power}


def stribeck_shape(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A Stribeck curve that falls with one over speed."""
    weight = min(size, 1.0)
    return {"st_hyper": weight}, {"form": "hyperbola", "weight": weight}


def friction_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A level that follows a rising speed more slowly than a falling one."""
    time, ratio = 0.015 * size, rng.uniform(1.5, 3.0)
    return {"lag_tau": time, "lag_rise": ratio}, {
        "form": "two times",
        "falling": time,
        "rising": time * ratio,
    }


def dwell_strengthening(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A level that grows with a small power of the contact's age."""
    renewal = plant.deflection * log_uniform(rng, 0.3, 2.0)
    power, onset = rng.uniform(0.15, 0.3), log_uniform(rng, 0.05, 0.3)
    # A decade after the onset the level has grown by the share.
    growth = 0.12 * size * plant.Fs / (11.0**power - 1.0)
    knobs = {"dwell_b": growth, "dwell_t": onset, "dwell_d": renewal, "dwell_kind": 2.0, "dwell_pow": power}
    return knobs, {
        "form": "power",
        "factor": growth,
        "power": power,
        "onset": onset,
        "renewal_length": renewal,
    }


def warmup(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Two times: the grease within seconds, the housing within minutes."""
    knobs = {
        "warm_c": 0.12 * size,
        "warm_v": 0.3 * size,
        "warm_tau": log_uniform(rng, 80.0, 200.0),
        "warm_c2": 0.12 * size,
        "warm_tau2": log_uniform(rng, 8.0, 25.0),
    }
    return knobs, {"form": "two times", **knobs}


def load_dependence(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Teeth that rub more when the drive pushes than when it brakes."""
    mu, side = 0.12 * size, rng.uniform(0.4, 0.9)
    return {"load_mu": mu, "load_side": side}, {"form": "by quadrant", "mean": mu, "side": side}


def micro_damping(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Damping of the bristle that dies out slowly with speed."""
    knobs = {"micro_v": plant.vs * log_uniform(rng, 0.3, 1.5), "micro_w": min(size, 1.0), "micro_tail": 1.0}
    return knobs, {"form": "long tail", "at": knobs["micro_v"], "part": knobs["micro_w"]}


def viscoelastic_damping(rng: Rng, plant: Plant, size: float) -> Drawn:
    """One relaxing spring."""
    time, stiffness = log_uniform(rng, 2e-3, 5e-2), 0.25 * size * plant.sigma0
    knobs = {"ve_k": np.array([stiffness, 0.0, 0.0]), "ve_tau": np.array([time, 1.0, 1.0])}
    return knobs, {"form": "one spring", "spring": stiffness, "relaxation": time}


def flexible_transmission(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A coupling that hardens."""
    m2 = 0.35 * size * plant.J
    w, zeta = 2 * np.pi * log_uniform(rng, 25.0, 70.0), log_uniform(rng, 0.01, 0.04)
    stretch = 2.0 * plant.Fs / plant.J / w**2
    hard = rng.uniform(0.3, 1.0)
    knobs = {"m2": m2, "k2": m2 * w**2, "d2": 2 * zeta * m2 * w, "k2_hard": hard, "k2_len": stretch}
    return knobs, {"form": "hardening", "inertia": m2, "frequency": w / (2 * np.pi), "hardening": hard}


def backlash(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Rubber that fills the gap."""
    m2 = rng.uniform(0.25, 0.45) * plant.J
    w, soft = 2 * np.pi * log_uniform(rng, 200.0, 350.0), rng.uniform(0.005, 0.03)
    gap = 1.5 * size * plant.deflection
    knobs = {"m2": m2, "k2": m2 * w**2, "d2": 0.6 * m2 * w, "gap": gap, "gap_k": soft * m2 * w**2}
    return knobs, {"form": "soft", "inertia": m2, "width": 2 * gap, "soft": soft}


def delay(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A delay of the input that differs from sample to sample."""
    jitter = rng.uniform(0.2, 0.5)
    return {"delay": 3e-3 * size, "jitter": jitter}, {"form": "jitter", "mean": 3e-3 * size, "jitter": jitter}


def drive_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Two equal lags, one after the other."""
    return {"drive_tau": 1.25e-3 * size, "drive_twice": 1.0}, {"form": "second order", "each": 1.25e-3 * size}


def drive_deadzone(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A dead zone with rounded edges."""
    width = 0.05 * size * plant.Fs / plant.motor_constant
    return {"dead_soft": width}, {"form": "rounded", "loss": width}


def drive_saturation(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A hard limit in one direction."""
    limit = plant.Fs / plant.motor_constant * (1.1 + 0.3 * size**-0.4)
    side = _sign(rng)
    return {"sat_u": limit, "sat_hard": 1.0, "sat_side": side}, {
        "form": "one side",
        "limit": limit,
        "side": side,
    }


def encoder_error(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Straight pieces between turning points."""
    amplitude, period = 3.5 * size * plant.encoder_step, plant.encoder_step * log_uniform(rng, 80.0, 400.0)
    knobs = {"enc_bent": amplitude, "enc_p": period, "enc_f1": _phase(rng)}
    return knobs, {"form": "straight pieces", "height": amplitude, "period": period}


def torque_ripple(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A motor constant that dips between its commutations."""
    knobs = {
        "tr_flat": 0.25 * size,
        "tr_p": plant.stroke * log_uniform(rng, 0.06, 0.25),
        "tr_f1": _phase(rng),
    }
    return knobs, {"form": "dips", "depth": knobs["tr_flat"], "period": knobs["tr_p"]}


def sensor_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Two equal filters, one after the other."""
    return {"sensor_tau": 1.25e-3 * size, "sensor_twice": 1.0}, {
        "form": "second order",
        "each": 1.25e-3 * size,
    }


def mains_pickup(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Mains frequency and its third harmonic."""
    knobs = {
        "mains_a": 3.0 * size * plant.encoder_step,
        "mains3": 2.0 * size * plant.encoder_step,
        "mains_f": float(rng.choice([50.0, 60.0])),
        "mains_ph": _phase(rng),
    }
    return knobs, {"form": "third harmonic", "first": knobs["mains_a"], "third": knobs["mains3"]}


FORMS: dict[str, Callable[[Rng, Plant, float], Drawn]] = {
    form.__name__: form
    for form in (
        maxwell_slip, elasto_plastic, nonlinear_bristle, creep, direction_asymmetry, constant_load, return_spring,
        gravity_pendulum, ripple, position_dependence, quadratic_drag, stribeck_shape, friction_lag,
        dwell_strengthening, warmup, load_dependence, micro_damping, viscoelastic_damping, flexible_transmission,
        backlash, delay, drive_lag, drive_deadzone, drive_saturation, encoder_error, torque_ripple, sensor_lag,
        mains_pickup,
    )
}  # fmt: skip
"""Effect -> its other form."""
