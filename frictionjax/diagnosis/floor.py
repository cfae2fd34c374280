"""The floor: what a perfect model would leave of the prediction errors: measurement noise and unmeasured force.

Measurement noise gives standardised innovations of unit power everywhere. A small random force on the machine adds
power where the machine is free to answer, and little where it sticks; how much is found by adding such a force to the
recorded one and watching the innovations. Its size is the one that a robust middle of the blocks asks for.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.imposed_batch import ImposedBatch
from frictionjax.estimation.joint import Joint

_DRAWS = 4
_SMALL = 1e-4  # of Coulomb friction: small enough for a linear answer, far above rounding
_SMOOTH = 5  # blocks over which the answer is averaged
_QUANTILE = 0.4  # of the blocks' own estimates: an effect raises blocks, so the middle is too high
_SEEN = 0.1  # of the largest answer: blocks that answer less say nothing of the force
# Of Coulomb friction, at each sample: more than this is no disturbance but physics, and must not raise the floor that
# physics is measured from. (Where an effect acts in all of sliding, the blocks ask for more.)
_LARGEST = 0.005


class Answer(eqx.Module):
    """Power of the standardised innovations in each block for a white force of the size of Coulomb friction, `gain`,
    shape `(r, b)`."""

    gain: np.ndarray


def answer_to_force(joint: Joint, vector: Float[Array, " q"]) -> Answer:
    """How the innovations of `joint` at `vector` answer to a small white force, held over each sample.

    Where the motion is imposed the force is what is measured, and answers with all of itself everywhere.
    """
    batch, drive = joint.batch, joint.drive(vector)
    if isinstance(batch, ImposedBatch):
        whole = np.asarray(drive.friction.Fc / batch.noise)[:, None] ** 2
        return Answer(whole * (np.asarray(batch.block_count) > 0))
    assert isinstance(batch, Batch)
    size = _SMALL * float(drive.friction.Fc) / float(drive.motor_constant)
    plain = joint.errors([vector])[0]
    total = np.zeros(np.asarray(batch.block_count).shape)
    rng = np.random.default_rng(20020301)
    for _ in range(_DRAWS):
        shaken = batch.u + size * jnp.asarray(rng.standard_normal(batch.u.shape))
        other = eqx.tree_at(lambda j: j.setting.batch.u, joint, shaken)
        change = np.asarray(other.errors([vector])[0] - plain) / _SMALL
        squares = np.nan_to_num(change**2).reshape(*total.shape, batch.block)
        total += squares.mean(axis=-1) / _DRAWS
    kernel = np.ones(_SMOOTH) / _SMOOTH
    # A mean over neighbours is thrown by the one block in which a break-away came sooner.
    capped = np.minimum(total, 20.0 * np.median(total[total > 0])) if np.any(total > 0) else total
    return Answer(np.stack([np.convolve(row, kernel, mode="same") for row in capped]))


def force_noise(power: np.ndarray, answer: Answer, joint: Joint) -> float:
    """Standard deviation of the unmeasured force over Coulomb friction that the block `power` of shape `(r, b)` asks
    for, from the fitted recordings."""
    scored = (np.asarray(joint.batch.block_count) > 0) & (np.asarray(joint.fitted)[:, None] > 0)
    gain = np.where(scored, answer.gain, 0.0)
    seen = gain > _SEEN * gain.max()
    if not np.any(seen):
        return 0.0
    own = (power[seen] - 1.0) / gain[seen]
    return float(np.clip(np.sqrt(max(np.quantile(own, _QUANTILE), 0.0)), 0.0, _LARGEST))


def floor_of(size: float, answer: Answer) -> np.ndarray:
    """Power of each block, shape `(r, b)`, that noise and an unmeasured force `size` (over Fc) leave."""
    return 1.0 + size**2 * answer.gain
