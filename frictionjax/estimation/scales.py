"""Characteristic sizes of a plant: the units of the strengths of effects."""

import numpy as np
from jaxtyping import Float

from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.evidence import Forces
from frictionjax.physics import Drive

_TINY = 1e-100  # its cube is still a number


def friction_scales(drive: Drive, stroke: float, dt: float) -> dict[str, float]:
    """Sizes that follow from the friction of `drive` alone, and the `stroke` (position units) and `dt` (s) themselves,
    by the names that `Parameter.scale` may use."""
    friction = drive.friction
    return {
        "Fc": float(friction.Fc),
        "sigma0": float(friction.sigma0),
        "zs": float(friction.Fs / friction.sigma0),
        "stroke": stroke,
        "dt": dt,
    }


def plant_scales(
    drive: Drive, batch: AbstractBatch | Forces, *, turn: float = 2.0 * np.pi
) -> dict[str, float]:
    """Sizes by the names that `Parameter.scale` may use.

    **Arguments:**

    - `drive`: the fitted base model.
    - `batch`: the recordings.
    - `turn`: a full turn, position units, where the position is an angle.
    """
    friction = drive.friction
    positions = np.asarray(batch.x)
    inside = [positions[row, : batch.lengths[row]] for row in range(len(batch.lengths))]
    low, high = min(x.min() for x in inside), max(x.max() for x in inside)
    Fc, stroke = float(friction.Fc), float(high - low)
    dt = np.asarray(batch.dt)
    # Mean speeds over a twentieth of a second: neither noise nor encoder steps count.
    top = max(_speed(x, float(h)) for x, h in zip(inside, dt, strict=True))
    inputs = None if isinstance(batch, Forces) else batch.inputs
    noise = None if isinstance(batch, Forces) else batch.position_noise
    largest = 1.0 if inputs is None else max(float(np.max(np.abs(np.asarray(inputs)))), _TINY)
    return {
        **friction_scales(drive, stroke, float(np.min(dt))),
        "sigma2": float(friction.sigma2),
        "vs": float(friction.vs),
        "half_stroke": 0.5 * stroke,
        "half_speed": float(np.arcsinh(top / float(friction.vs))),
        "zero": 0.0,
        "one": 1.0,
        "turn": turn,
        "center": float(0.5 * (low + high)),
        "Fc/stroke": Fc / stroke,
        "u": largest,
        "1/u^2": 1.0 / largest**2,
        "Fc/speed^2": Fc / top**2,
        "Fc/speed^3": Fc / top**3,
        "step": 1e-6 * stroke if noise is None else float(np.median(np.asarray(noise))),
    }


def _speed(x: Float[np.ndarray, " n"], dt: float) -> float:
    """Largest mean speed over a twentieth of a second."""
    window = min(max(round(0.05 / dt), 1), x.size - 1)
    return max(float(np.max(np.abs(x[window:] - x[:-window]))) / (window * dt), _TINY)
