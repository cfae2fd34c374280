"""Every number the simulator knows, as two flat records: parameters (`Knobs`) and states.

Records rather than classes, since compiled code reads and writes their fields by name. A knob at its default
switches its effect off, so that all defaults together are the base model.
"""

from __future__ import annotations

import numpy as np

from .plants import Plant

MAX_ELEMENTS = 10
MAX_PLAYS = 6
RELAXATIONS = 3

_SCALARS: dict[str, float] = {
    # base model
    "J": 1.0, "s0": 1.0, "s1": 0.0, "s2": 0.0, "fc": 1.0, "fs": 1.0, "vs": 1.0, "km": 1.0, "z0": 1.0,
    # Stribeck curve: exp(-r^exponent), blended with 1 / (1 + r^2) or with 1 / (1 + r)
    "st_exp": 2.0, "st_lorentz": 0.0, "st_hyper": 0.0,
    # Maxwell slip: share of the bristle that plays take over
    "mw_n": 0.0, "mw_share": 0.0,
    # bristle: deflection without slip (share of the sliding one), hardening, softening
    "ep_ratio": 0.0, "nl_hard": 0.0, "nl_soft": 0.0,
    # other forms of the same: yielding along a power, a knee beyond which the bristle is stiffer
    "ep_pow": 0.0, "nl_knee": 1.0, "nl_rise": 0.0,
    # creep: two Kelvin-Voigt compartments; one with a thermally activated dashpot (logarithmic in time)
    "c1": 0.0, "t1": 1.0, "c2": 0.0, "t2": 1.0, "cl": 0.0, "cl_tau": 1.0, "cl_len": 1.0,
    # friction level by direction, place, lag, contact age, time, heat and load
    "dir_c": 0.0, "dir_v": 0.0, "dir_fc": 0.0,
    "pos_a": 0.0, "pos_p": 1.0, "pos_ph": 0.0, "pos_lin": 0.0, "pos_quad": 0.0, "pos_len": 1.0,
    "pos_saw": 0.0, "pos_hill": 0.0, "pos_x": 0.0, "pos_w": 1.0,
    "lag_tau": 0.0, "lag_rise": 1.0, "dwell_b": 0.0, "dwell_t": 1.0, "dwell_d": 1.0, "dwell_kind": 0.0,
    "dwell_pow": 0.2, "warm_c": 0.0, "warm_v": 0.0, "warm_tau": 1.0, "warm_c2": 0.0, "warm_tau2": 1.0,
    "heat_c": 0.0, "heat_v": 0.0, "heat_tau": 1.0, "heat_ref": 1.0,
    "load_mu": 0.0, "load_side": 0.0,
    # parallel forces
    "const": 0.0, "spring": 0.0, "grav": 0.0, "grav_x0": 0.0, "quad": 0.0, "quad_pow": 2.0,
    "const_bend": 0.0, "const_len": 1.0, "spring3": 0.0, "grav2": 0.0, "rip_peak": 0.0,
    "rip1": 0.0, "rip2": 0.0, "rip_p": 1.0, "rip_f1": 0.0, "rip_f2": 0.0,
    # second inertia behind a spring, with half a gap on either side
    "m2": 0.0, "k2": 0.0, "d2": 0.0, "gap": 0.0, "b2": 0.0, "gap_k": 0.0, "k2_hard": 0.0, "k2_len": 1.0,
    # drive
    "delay": 0.0, "out_delay": 0.0, "drive_tau": 0.0, "dead": 0.0, "sat_u": 0.0, "sat_n": 2.0, "sat_hard": 0.0,
    "jitter": 0.0, "drive_twice": 0.0, "dead_soft": 0.0, "sat_side": 0.0, "tr_flat": 0.0,
    "tr1": 0.0, "tr2": 0.0, "tr_p": 1.0, "tr_f1": 0.0, "tr_f2": 0.0,
    # sensor
    "enc1": 0.0, "enc2": 0.0, "enc_p": 1.0, "enc_f1": 0.0, "enc_f2": 0.0,
    "sensor_tau": 0.0, "mains_a": 0.0, "mains_f": 50.0, "mains_ph": 0.0,
    "enc_bent": 0.0, "sensor_twice": 0.0, "mains3": 0.0,
    # damping of the bristle that dies out with speed
    "micro_v": 0.0, "micro_w": 0.0, "micro_tail": 0.0,
    # outside any catalogue
    "bump_a": 0.0, "bump_x": 0.0, "bump_w": 1.0, "spot_a": 0.0, "spot_x": 0.0, "spot_w": 1.0,
    "slack_k": 0.0, "slack_x": 0.0, "ou_std": 0.0, "ou_tau": 1.0,
    "detent_a": 0.0, "detent_p": 1.0, "detent_ph": 0.0, "detent_tau": 1.0,
    "hit_a": 0.0, "hit_p": 1.0, "hit_tau": 1.0, "hit_dir": 1.0,
    "sag_a": 0.0, "sag_tau": 1.0, "sag_u": 1.0, "hys_a": 0.0, "hys_n": 0.0,
    "walk_std": 0.0, "pinch_a": 0.0, "pinch_v": 1.0, "pinch_w": 1.0,
    "pay_share": 0.0, "pay_t": 0.0, "pow4": 0.0, "nth_a": 0.0, "nth_p": 1.0, "nth_n": 2.0,
    "fade_a": 0.0, "fade_tau": 1.0, "vib_a": 0.0, "vib_f": 1.0, "vib_ph": 0.0, "play_b": 0.0,
}  # fmt: skip

_VECTORS: dict[str, int] = {
    "mw_k": MAX_ELEMENTS,
    "mw_a": MAX_ELEMENTS,
    "hys_r": MAX_PLAYS,
    "ve_k": RELAXATIONS,
    "ve_tau": RELAXATIONS,
}

_STATES = (
    "x", "v", "z", "x2", "v2", "xc1", "xc2", "xcl", "lag", "age", "heat", "amp", "ou", "bias", "sag", "pulse",
    "ys", "ys2", "play", "seen", "cell", "amp2",
    # scratch of one substep, kept here so that each is computed once
    "core", "mult", "slow", "visc", "fs_mult", "load", "force", "inertia", "clock",
)  # fmt: skip

KNOB_DTYPE = np.dtype(
    [(name, "f8") for name in _SCALARS] + [(name, "f8", (size,)) for name, size in _VECTORS.items()]
)
_STATE_VECTORS = {"mw": MAX_ELEMENTS, "mw_free": MAX_ELEMENTS, "hys": MAX_PLAYS, "ve": RELAXATIONS}
STATE_DTYPE = np.dtype(
    [(name, "f8") for name in _STATES] + [(name, "f8", (size,)) for name, size in _STATE_VECTORS.items()]
)

# What outlives the pause between two recordings; the machine is homed, and its bristles forget, in between.
SLOW_STATES = ("heat", "ou", "bias", "sag")


def pack(plant: Plant, changes: dict[str, float | np.ndarray]) -> np.ndarray:
    """Parameter record (one element) of a plant with some knobs turned."""
    record = np.zeros(1, KNOB_DTYPE)
    values = dict(_SCALARS)
    values |= {
        "J": plant.J, "s0": plant.sigma0, "s1": plant.sigma1, "s2": plant.sigma2, "fc": plant.Fc,
        "fs": plant.Fs, "vs": plant.vs, "km": plant.motor_constant, "z0": plant.deflection,
    }  # fmt: skip
    record["ve_tau"] = 1.0
    for name, value in (values | changes).items():
        if name in _VECTORS:
            value = np.pad(np.asarray(value, float), (0, _VECTORS[name] - len(value)), mode="edge")
        record[name] = value
    return record


def rest() -> np.ndarray:
    """State record (one element) of a machine at rest in the origin."""
    state = np.zeros(1, STATE_DTYPE)
    for name in ("mult", "slow", "visc", "fs_mult"):
        state[name] = 1.0
    state["age"] = 10.0
    return state
