"""The floor: what a perfect model would leave of the prediction errors: measurement noise and unmeasured force.

Measurement noise gives standardised innovations of unit power everywhere. A small random force on the machine adds
power where the machine is free to answer, and little where it sticks; how much is found by adding such a force to the
recorded one and watching the innovations. Its size is the one at which a robust middle of the blocks of simulated
innovations is that of the blocks that are seen.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.signal import lfilter

from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.objective.joint import Joint
from frictionjax.simulation import innovation_gain

_DRAWS = 4
_SMALL = 1e-4  # of Coulomb friction: small enough for a linear answer, far above rounding
_SMOOTH = 5  # blocks over which the answer is averaged
_HALVINGS = 30
_BEYOND = 1e100  # in noise levels: further apart than any two runs


class Answer(eqx.Module):
    """What noise and force make of the innovations.

    **Attributes:** `gain`: mean power of the standardised innovations in each block for a white force of the size of
    Coulomb friction, shape `(r, b)`. Of `d` draws, the power in each block of noise alone, `noise`, and of that force
    alone, `force`, and the mean of their product, `product`, shape `(d, r, b)`: a block holds few free numbers, and its
    power scatters.
    """

    gain: Float[np.ndarray, "r b"]
    noise: Float[np.ndarray, "d r b"]
    force: Float[np.ndarray, "d r b"]
    product: Float[np.ndarray, "d r b"]

    def powers(self, size: float, quiet: Float[np.ndarray, "r 1"] | float) -> Float[np.ndarray, "d r b"]:
        """Power of each block of each draw, for noise of the power `quiet` and a force `size` (over Fc)."""
        return quiet * self.noise + 2.0 * size * np.sqrt(quiet) * self.product + size**2 * self.force


def answer_to_force(joint: Joint, vector: Float[Array, " q"], *, rule: Rule = Rule()) -> Answer:
    """How the innovations of `joint` at `vector` answer to a small white force, held over each sample, and to noise.

    Where the motion is imposed the force is what is measured, and answers with all of itself everywhere.
    """
    batch, drive = joint.batch, joint.drive(vector)
    scored = np.asarray(batch.block_count) > 0
    rng = np.random.default_rng(20020301)
    if isinstance(batch, ImposedBatch):
        whole = np.asarray(drive.friction.Fc / batch.noise)[:, None] ** 2 * scored
        noise = np.repeat(1.0 * scored[None], _DRAWS, axis=0)
        return Answer(whole, noise, noise * whole, 0.0 * noise)
    assert isinstance(batch, Batch)
    plain = joint.errors([vector])[0]
    draws = []
    for _ in range(_DRAWS):
        change = np.nan_to_num(_parted(joint, vector, plain, _SMALL, rng) / _SMALL)
        noise = _noise_alone(joint, rng)
        products = (noise**2, change**2, noise * change)
        draws.append([np.asarray(batch.block_mean(jnp.asarray(product))) for product in products])
    noise, force, product = (np.array(some) for some in zip(*draws, strict=True))
    kernel = np.ones(_SMOOTH) / _SMOOTH
    # A mean over neighbours is thrown by the one block in which a break-away came sooner.
    mean = capped(force.mean(axis=0), rule)
    return Answer(np.stack([np.convolve(row, kernel, mode="same") for row in mean]), noise, force, product)


def capped(mean: Float[np.ndarray, "r b"], rule: Rule) -> Float[np.ndarray, "r b"]:
    """The `mean` answer of each block, where it is not far above that of the others, by the `rule`."""
    return np.minimum(mean, rule.floor.cap * np.median(mean[mean > 0])) if np.any(mean > 0) else mean


def gap_force(force: float, rule: Rule) -> float:
    """The unmeasured force (over Fc) by which a machine with a gap is tested for chaos: `force`, or more by the
    `rule`."""
    return max(force, rule.floor.gap_force)


def is_predictable(parted: Float[np.ndarray, "r b"], rule: Rule) -> Bool[np.ndarray, "r b"]:
    """Whether two runs that have `parted` by this power in a block are near enough for it to count, by the `rule`."""
    return parted < rule.floor.unpredictable


def scatter(
    joint: Joint, vector: Float[Array, " q"], size: float, *, draws: int = _DRAWS
) -> Float[np.ndarray, "r b"]:
    """Power of each block, shape `(r, b)`, by which two runs of the machine `vector` part under different unmeasured
    forces of the `size` (over Fc), in the mean of `draws`.

    A machine whose contacts are chaotic leaves that much even before the perfect model of it, which is told neither the
    force nor where in its gap the load begins.
    """
    rng, plain = np.random.default_rng(20020302), joint.errors([vector])[0]
    parted = [_parted(joint, vector, plain, size, rng) for _ in range(draws)]
    # Two runs may part beyond what a number, or its square, holds.
    far = [np.clip(np.nan_to_num(change, nan=np.inf), -_BEYOND, _BEYOND) for change in parted]
    powers = [np.asarray(joint.batch.block_mean(jnp.asarray(change**2))) for change in far]
    kernel = np.ones(_SMOOTH) / _SMOOTH
    return np.stack([np.convolve(row, kernel, mode="same") for row in np.mean(powers, axis=0)])


def predictable(
    joint: Joint, vector: Float[Array, " q"], size: float, *, draws: int = _DRAWS, rule: Rule = Rule()
) -> tuple[Joint, bool]:
    """`joint` without the blocks in which an unmeasured force of the `size` (over Fc) makes more of the innovations of
    the model `vector` than the measurement noise does, and whether there are any.

    Such a force brings a break-away forward or back, and all errors that follow are of that one cause: a fit that takes
    them for as many bends to it. Powers and misfits are those of all blocks as before.
    """
    parted = scatter(joint, vector, size, draws=draws)
    scored = np.asarray(joint.batch.block_count) > 0
    near = is_predictable(parted, rule)
    kept = jnp.repeat(jnp.asarray(np.where(near, 1.0, 0.0)), joint.batch.block, axis=1)
    some = bool(np.any(scored & ~near))
    return eqx.tree_at(lambda j: j.setting.weight, joint, joint.setting.weight * kept), some


def _parted(
    joint: Joint,
    vector: Float[Array, " q"],
    plain: Float[Array, "r n"],
    size: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "r n"]:
    """What a white force of the `size` (over Fc), held over each sample, changes in the innovations `plain`."""
    batch, drive = joint.batch, joint.drive(vector)
    assert isinstance(batch, Batch)
    force = size * float(drive.friction.Fc) / float(drive.motor_constant)
    shaken = batch.u + force * jnp.asarray(rng.standard_normal(batch.u.shape))
    other = eqx.tree_at(lambda j: j.setting.batch.u, joint, shaken)
    return np.asarray(other.errors([vector])[0] - plain)


def _noise_alone(joint: Joint, rng: np.random.Generator) -> Float[np.ndarray, "r n"]:
    """Standardised innovations of a free mass that does not move, of white measurement noise (`innovation_gain`)."""
    gains = joint.setting.gains
    pole, level = np.sqrt(1.0 - np.asarray(gains.position)), np.asarray(innovation_gain(gains))
    white = rng.standard_normal(joint.batch.x.shape)
    return np.stack(
        [
            lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * p, p**2], w) / g
            for p, g, w in zip(pole, level, white, strict=True)
        ]
    )


def quietness(power: Float[np.ndarray, "r b"], answer: Answer, joint: Joint) -> Float[np.ndarray, "r 1"]:
    """Power of the measurement noise in each recording over what it was thought to be, at most 1, shape `(r, 1)`.

    Noise is told from motion by its fourth differences. Motion at frequencies near that of sampling passes for noise;
    where a model leaves less than that in half of the blocks, there is less.
    """
    scored = np.asarray(joint.batch.block_count) > 0
    quiet = np.ones((scored.shape[0], 1))
    for row, mask in enumerate(scored):
        if np.any(mask):
            quiet[row] = min(1.0, float(np.median(power[row, mask]) / np.median(answer.noise[:, row, mask])))
    return quiet


def force_noise(
    power: Float[np.ndarray, "r b"],
    answer: Answer,
    joint: Joint,
    quiet: Float[np.ndarray, "r 1"] | float = 1.0,
    *,
    rule: Rule = Rule(),
) -> float:
    """Standard deviation of the unmeasured force over Coulomb friction that the block `power` of shape `(r, b)` asks
    for, from the fitted recordings; `quiet` is the power of the measurement noise in each.

    Each block asks for its own power of the force. That of the whole is the one at which the blocks of `answer` ask for
    the same, at a quantile below the middle: an effect raises some of the blocks.
    """
    scored = (np.asarray(joint.batch.block_count) > 0) & (np.asarray(joint.fitted)[:, None] > 0)
    gain = np.where(scored, answer.gain, 0.0)
    seen = gain > rule.floor.answering * gain.max()
    if not np.any(seen):
        return 0.0

    def asked(power: np.ndarray) -> float:
        return float(
            np.quantile(((power - quiet) / np.where(seen, gain, 1.0))[..., seen], rule.floor.quantile)
        )

    wanted, low, high = asked(power), 0.0, rule.floor.largest_force
    if wanted <= asked(answer.powers(low, quiet)):
        return 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if asked(answer.powers(middle, quiet)) < wanted else (low, middle)
    return high


def floor_of(
    size: float, answer: Answer, quiet: Float[np.ndarray, "r 1"] | float = 1.0
) -> Float[np.ndarray, "r b"]:
    """Power of each block, shape `(r, b)`, that noise of the power `quiet` and an unmeasured force `size` (over Fc)
    leave."""
    return quiet + size**2 * answer.gain


def colour(
    power: Float[np.ndarray, "r b"], floor: Float[np.ndarray, "r b"], joint: Joint, *, rule: Rule = Rule()
) -> Float[np.ndarray, "r 1"]:
    """Factor on the `floor` of each recording by which the colour of its noise may raise it, shape `(r, 1)`: where a
    model leaves a block `power` that is higher in the middle one of all blocks, at least 1."""
    factor = np.ones((power.shape[0], 1))
    for row, scored in enumerate(np.asarray(joint.batch.block_count) > 0):
        if np.any(scored):
            factor[row] = np.clip(np.median((power / floor)[row, scored]), 1.0, rule.floor.colour)
    return factor
