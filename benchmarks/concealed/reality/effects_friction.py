"""Effects inside the friction law and parallel to it."""

from __future__ import annotations

import numpy as np

from .knobs import MAX_ELEMENTS
from .plants import Plant, log_uniform

Drawn = tuple[dict, dict]
Rng = np.random.Generator


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def maxwell_slip(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Plays in parallel with the LuGre bristle, or in its place; in all, the same stiffness and break-away."""
    share = 0.75 * size
    share = 1.0 if share > 0.85 else share
    n = int(rng.integers(4, MAX_ELEMENTS + 1))
    reach = np.sort(np.exp(rng.uniform(np.log(0.1), np.log(2.0), n)))
    weight = rng.dirichlet(np.full(n, 3.0))
    # Yield deflections are scaled so that stiffnesses add to sigma0 and yield forces to Fs.
    reach *= plant.deflection / (weight @ reach)
    stiffness = share * plant.sigma0 * weight
    level = stiffness * reach / plant.Fs
    knobs = {"mw_n": n, "mw_share": share, "mw_k": stiffness, "mw_a": level}
    return knobs, {"share": share, "elements": n, "stiffness": stiffness, "yield_deflection": reach}


def elasto_plastic(rng: Rng, plant: Plant, size: float) -> Drawn:
    """No slip of the bristle below a share of its sliding deflection."""
    ratio = min(0.65 * size, 0.9)
    return {"ep_ratio": ratio}, {"breakaway_ratio": ratio}


def nonlinear_bristle(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Bristle that hardens with the cube of its deflection, or softens; sliding friction is the same."""
    if rng.random() < 0.5:
        return {"nl_hard": 0.4 * size}, {"form": "hardening", "cubic": 0.4 * size}
    return {"nl_soft": 0.45 * size}, {"form": "softening", "coefficient": 0.45 * size}


def creep(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Displacement that goes on under constant force: one or two Kelvin-Voigt compartments, or logarithmic."""
    form = rng.choice(["one compartment", "two compartments", "logarithmic"])
    if form == "one compartment":
        knobs = {"c1": 0.3 * size, "t1": log_uniform(rng, 0.1, 3.0)}
        return knobs, {"form": str(form), "compliance": knobs["c1"], "time": knobs["t1"]}
    if form == "two compartments":
        knobs = {
            "c1": 0.2 * size,
            "t1": log_uniform(rng, 0.05, 0.3),
            "c2": 0.2 * size,
            "t2": log_uniform(rng, 1.0, 8.0),
        }
        return knobs, {"form": str(form), **knobs}
    compliance = 0.3 * size
    length = compliance * plant.deflection / rng.uniform(6.0, 10.0)
    knobs = {"cl": compliance, "cl_len": length, "cl_tau": log_uniform(rng, 20.0, 200.0)}
    return knobs, {"form": str(form), "compliance": compliance, "length": length, "time": knobs["cl_tau"]}


def direction_asymmetry(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Friction level that differs with the sign of velocity; in half of the machines viscous friction as well."""
    knobs = {"dir_c": _sign(rng) * 0.1 * size}
    if rng.random() < 0.5:
        knobs["dir_v"] = _sign(rng) * 0.35 * size
    return knobs, {"level": knobs["dir_c"], "viscous": knobs.get("dir_v", 0.0)}


def constant_load(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A constant force, small enough to rest on."""
    force = _sign(rng) * 0.06 * size * plant.Fs
    return {"const": force}, {"force": force}


def return_spring(rng: Rng, plant: Plant, size: float) -> Drawn:
    """A spring to the origin, below break-away at the end of the stroke."""
    stiffness = 0.3 * size * plant.Fs / plant.stroke
    return {"spring": stiffness}, {"stiffness": stiffness}


def gravity_pendulum(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Unbalance of a rotary axis."""
    if plant.kind != "rotary":
        raise ValueError("gravity_pendulum needs a rotary machine")
    knobs = {"grav": 0.25 * size * plant.Fs, "grav_x0": rng.uniform(-0.3, 0.3)}
    if plant.gravity:
        knobs = {"grav": plant.gravity, "grav_x0": plant.gravity_at}
    return knobs, {"amplitude": knobs["grav"], "x0": knobs["grav_x0"]}


def ripple(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Cogging: a force periodic in position with two harmonics."""
    amplitude = 0.07 * size * plant.Fc
    knobs = {
        "rip1": amplitude,
        "rip2": amplitude * rng.uniform(0.15, 0.5),
        "rip_p": plant.stroke * log_uniform(rng, 0.06, 0.25),
        "rip_f1": rng.uniform(0, 2 * np.pi),
        "rip_f2": rng.uniform(0, 2 * np.pi),
    }
    return knobs, {"amplitudes": np.array([amplitude, knobs["rip2"]]), "period": knobs["rip_p"]}


def position_dependence(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Friction level along the stroke: periodic, or smooth (linear and quadratic)."""
    if rng.random() < 0.5:
        knobs = {
            "pos_a": 0.2 * size,
            "pos_p": plant.stroke * log_uniform(rng, 0.3, 1.2),
            "pos_ph": rng.uniform(0, 2 * np.pi),
        }
        return knobs, {"form": "periodic", "amplitude": knobs["pos_a"], "period": knobs["pos_p"]}
    mix = rng.uniform(0.2, 0.8)
    knobs = {
        "pos_lin": _sign(rng) * 0.3 * mix * size,
        "pos_quad": _sign(rng) * 0.35 * (1 - mix) * size,
        "pos_len": plant.stroke,
    }
    return knobs, {"form": "smooth", "linear": knobs["pos_lin"], "quadratic": knobs["pos_quad"]}


def quadratic_drag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Drag proportional to v |v|."""
    coefficient = 0.4 * size * plant.Fc / plant.top_speed**2
    return {"quad": coefficient}, {"coefficient": coefficient}


def stribeck_shape(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Stribeck curve with an exponent below 2, or with the long tail of a Lorentzian."""
    if rng.random() < 0.65:
        exponent = 2.0 - min(rng.uniform(0.75, 1.2) * size, 1.4)
        return {"st_exp": exponent}, {"form": "exponent", "exponent": exponent}
    weight = min(size, 1.0)
    return {"st_lorentz": weight}, {"form": "lorentzian", "weight": weight}


def friction_lag(rng: Rng, plant: Plant, size: float) -> Drawn:
    """The level follows velocity with a first-order delay."""
    return {"lag_tau": 0.02 * size}, {"time": 0.02 * size}


def dwell_strengthening(rng: Rng, plant: Plant, size: float) -> Drawn:
    """The level grows with the age of the contact: with its logarithm, or up to a bound; slip makes it young again."""
    renewal = plant.deflection * log_uniform(rng, 0.3, 2.0)
    if rng.random() < 0.5:
        decade = 0.08 * size * plant.Fs
        knobs = {"dwell_b": decade / np.log(10), "dwell_t": log_uniform(rng, 0.02, 0.2), "dwell_d": renewal}
        truth = {"form": "logarithmic", "per_decade": decade, "onset": knobs["dwell_t"]}
    else:
        knobs = {
            "dwell_b": 0.2 * size * plant.Fs,
            "dwell_t": log_uniform(rng, 0.2, 2.0),
            "dwell_d": renewal,
            "dwell_kind": 1.0,
        }
        truth = {"form": "saturating", "growth": knobs["dwell_b"], "time": knobs["dwell_t"]}
    return knobs, {**truth, "renewal_length": renewal}


def warmup(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Friction that falls with running time, or with the heat it makes; carried from recording to recording."""
    level, viscous = 0.2 * size, 0.3 * size
    if rng.random() < 0.5:
        knobs = {"warm_c": level, "warm_v": viscous, "warm_tau": log_uniform(rng, 40.0, 150.0)}
        return knobs, {"form": "time", "level": level, "viscous": viscous, "time": knobs["warm_tau"]}
    knobs = {
        "heat_c": level,
        "heat_v": viscous,
        "heat_tau": log_uniform(rng, 30.0, 120.0),
        "heat_ref": 0.04 * plant.Fc * plant.top_speed,
    }
    truth = {"form": "heat", "level": level, "viscous": viscous, "time": knobs["heat_tau"]}
    return knobs, {**truth, "power": knobs["heat_ref"]}


def load_dependence(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Friction that grows with the force the drive transmits."""
    return {"load_mu": 0.12 * size}, {"mu": 0.12 * size}


def micro_damping(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Bristle damping that dies out with speed."""
    knobs = {"micro_v": plant.vs * log_uniform(rng, 0.3, 1.5), "micro_w": min(size, 1.0)}
    return knobs, {"speed": knobs["micro_v"], "share": knobs["micro_w"]}


def viscoelastic_damping(rng: Rng, plant: Plant, size: float) -> Drawn:
    """Relaxing springs beside the bristle's own, over decades of time: loss that hardly depends on frequency."""
    times = np.array([1e-3, 1e-2, 1e-1]) * np.exp(rng.uniform(-0.5, 0.5, 3))
    stiffness = 0.1 * size * plant.sigma0 * rng.uniform(0.7, 1.3, 3)
    return {"ve_k": stiffness, "ve_tau": times}, {"stiffness": stiffness, "time": times}


FRICTION = {
    effect.__name__: effect
    for effect in (
        maxwell_slip,
        elasto_plastic,
        nonlinear_bristle,
        creep,
        direction_asymmetry,
        constant_load,
        return_spring,
        gravity_pendulum,
        ripple,
        position_dependence,
        quadratic_drag,
        stribeck_shape,
        friction_lag,
        dwell_strengthening,
        warmup,
        load_dependence,
    )
}
FRICTION_EXTRA = {effect.__name__: effect for effect in (micro_damping, viscoelastic_damping)}
