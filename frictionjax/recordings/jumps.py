"""Jumps of a measured position that no machine makes: an angle that wraps, and a sensor that stood still meanwhile."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.recordings.regimes import runs
from frictionjax.recordings.signals import noise_std
from frictionjax.recordings.units import turn_of

_WITHIN = 1.001  # turns: a position that wraps stays within one
_FAST = 0.25  # of a turn in one sample: then jumps and motion cannot be separated
_STANDING = 5  # samples of one value, at least, before a jump
_FEW = 5.0  # quanta: a jump of no more is the sensor's resolution
_NOISE = 6.0 * 2.0**0.5  # times the noise: six standard deviations of a difference
_CATCHING_UP = (0.7, 1.4)  # what a jump may be over the motion that was missed


class Standing(eqx.Module):
    """Where a position stands still while the machine moves on, and then jumps.

    **Attributes:** the sample of the `first` jump, how many there are, `count`, and for how many samples the `longest`
    stands.
    """

    first: int = eqx.field(static=True)
    count: int = eqx.field(static=True)
    longest: int = eqx.field(static=True)


def unwrapped(x: Float[np.ndarray, " n"], unit: str) -> tuple[Float[np.ndarray, " n"], int, int]:
    """An angle `x` without its jumps by full turns, in the position `unit`, how many jumps there were, and the sample
    of the first; the same `x` and 0 where it does not wrap.

    Only a position that stays within one turn, and moves by less than a quarter of it in every other sample, is
    unwrapped.
    """
    turn = turn_of(unit)
    if turn is None or x.size < 2 or np.ptp(x) > _WITHIN * turn:
        return x, 0, 0
    steps = np.abs(np.diff(x))
    jumps = steps > 0.5 * turn
    if not jumps.any() or np.max(steps[~jumps], initial=0.0) > _FAST * turn:
        return x, 0, 0
    return np.unwrap(x, period=turn), int(np.count_nonzero(jumps)), int(np.argmax(jumps)) + 1


def standing(x: Float[np.ndarray, " n"]) -> Standing | None:
    """Where `x` stands still for some samples and then jumps by about what the machine moved meanwhile, by its speed
    before and after; None where it never does."""
    steps = np.diff(x)
    sizes = np.abs(steps)
    moved = sizes[sizes > 0.0]
    if moved.size == 0:
        return None
    found, least = [], max(_FEW * float(moved.min()), _NOISE * noise_std(x))
    for begin, end in runs(sizes == 0.0):
        length = end - begin
        if length < _STANDING or end >= steps.size or begin < length:
            continue
        jump = sizes[end]
        before, after = steps[begin - length : begin], steps[end + 1 : end + 1 + length]
        if after.size < _STANDING or jump < least:
            continue
        # A machine that moves through: at one speed, in one direction, before and after.
        missed = (length + 1) * 0.5 * abs(float(np.mean(before)) + float(np.mean(after)))
        ahead = np.sign(np.mean(before)) == np.sign(np.mean(after)) == np.sign(steps[end])
        low, high = _CATCHING_UP
        if ahead and low * missed < jump < high * missed:
            found.append((end + 1, length))
    if not found:
        return None
    return Standing(found[0][0], len(found), max(length for _, length in found))
