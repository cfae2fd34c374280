"""An input that is none: the target of a position loop, which the measured position follows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.recording import Plant
from frictionjax.recordings.units import parse_unit

_LATEST = 0.5  # s: a position that follows its target later is hardly controlled
_SLOPE = 0.02  # of 1: a position that comes as far as its target
_ENOUGH = 50_000  # samples from the start
_SMALLEST = 1e-300
_NEAR = 10  # samples about the largest correlation in which the lag is searched
_LEFT = 0.1  # of the standard deviation of x: what is left of a position that follows


class Following(NamedTuple):
    """How the position follows the input: `late` by so many s, so many times as far (`slope`), but for the part `left`
    of its standard deviation."""

    late: float
    slope: float
    left: float


def following(
    x: Float[np.ndarray, " n"], u: Float[np.ndarray, " n"], sample_rate: float, factor: float = 1.0
) -> Following | None:
    """How the position `x` follows the input `u` times a `factor` as its target; None where it does not.

    A force that bends a spring is followed, too, but as far only by chance.
    """
    u, x = u[:_ENOUGH], x[:_ENOUGH]
    target, moved = factor * (u - u.mean()), x - x.mean()
    if not (np.any(target) and np.any(moved)):
        return None
    latest = min(round(_LATEST * sample_rate), x.size // 4)
    # By NumPy: scipy.signal takes longer to load than a file to read. Zeros keep the end from meeting the start.
    length = 1 << (x.size + latest).bit_length()
    spectrum = np.fft.rfft(moved, length) * np.conj(np.fft.rfft(target, length))
    together = np.fft.irfft(spectrum, length)[: latest + 1]
    # The overlap shrinks with the lag, so that the largest sum comes a little early.
    first = int(np.argmax(together))
    late = min(
        range(first, min(first + _NEAR, latest)), key=lambda lag: _fitted(moved, target, lag)[1], default=0
    )
    slope, left = _fitted(moved, target, late)
    if abs(slope - 1.0) > _SLOPE or left > _LEFT:
        return None
    return Following(late / sample_rate, slope, left)


def _fitted(
    moved: Float[np.ndarray, " n"], target: Float[np.ndarray, " n"], late: int
) -> tuple[float, float]:
    """Slope of what `moved` over the `target` so many samples before, `late`, and what is left of its standard
    deviation."""
    target, moved = target[: target.size - late], moved[late:]
    target, moved = target - target.mean(), moved - moved.mean()
    slope = float(np.vdot(target, moved)) / max(float(np.vdot(target, target)), _SMALLEST)
    return slope, float(np.std(moved - slope * target)) / max(float(np.std(moved)), _SMALLEST)


def said_of_target(
    x: Float[np.ndarray, " n"], u: Float[np.ndarray, " n"], sample_rate: float, plant: Plant
) -> str:
    """A sentence where `u` seems to be the target of the position `x`, with what to record instead; else empty. The
    `plant` says their units."""
    position, given = parse_unit(plant.position_unit), parse_unit(plant.input_unit)
    factor = 1.0
    if position is not None and given is not None and position.powers == given.powers:
        factor = given.factor / position.factor
    found = following(x, u, sample_rate, factor)
    if found is None:
        return ""
    return (
        f"x follows u {1e3 * found.late:.3g} ms later and just as far: u seems to be the target of a position loop, "
        "not what drives the machine. Record the motor's current, torque or voltage as u, and name this column "
        "reference."
    )
