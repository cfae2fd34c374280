"""The noise floor: the prediction errors of a perfect model, which measurement noise and an unmeasured force leave.

Measurement noise gives standardised innovations of unit power everywhere. A small random force on the machine adds
power where the machine is free to move, and little where it sticks; how much is found by adding such a force to the
recorded input and simulating the innovations. Its size is the one at which the simulated and the observed powers of the
blocks agree, at a robust quantile.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.evidence.pace import with_evidence
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.objective.posterior import Posterior

_DRAWS = 4
_SMALL = 1e-4  # of Coulomb friction: small enough for a linear response, far above rounding
_SMOOTH = 5  # blocks over which the response is averaged
_HALVINGS = 30
_BEYOND = 1e100  # in noise levels: the largest difference of two runs that is squared


class Answer(eqx.Module):
    """How the innovations respond to measurement noise and to an unmeasured force.

    **Attributes:** `gain`: mean power of the standardised innovations in each block for a white force of the size of
    Coulomb friction, shape `(r, b)`; `growth`: the same for the sensor's noise, at least 1: more where the motion is
    unstable and noise grows in the observer, as in slow sliding. Of `d` draws, the power in each block of noise alone,
    `noise`, and of that force alone, `force`, and the mean of their product, `product`, shape `(d, r, b)`: a block has
    few independent samples, so its power scatters.
    """

    gain: Float[np.ndarray, "r b"]
    growth: Float[np.ndarray, "r b"]
    noise: Float[np.ndarray, "d r b"]
    force: Float[np.ndarray, "d r b"]
    product: Float[np.ndarray, "d r b"]

    def powers(self, size: float, quiet: Float[np.ndarray, "r 1"] | float) -> Float[np.ndarray, "d r b"]:
        """Power of each block of each draw, for noise of the power `quiet` and a force `size` (over Fc)."""
        grown = quiet * self.growth
        return grown * self.noise + 2.0 * size * np.sqrt(grown) * self.product + size**2 * self.force


def answer_to_force(posterior: Posterior, vector: Float[Numbers, " q"], *, rule: Rule = Rule()) -> Answer:
    """How the innovations of the `posterior` at `vector` respond to a small white force, constant over each sample, and
    to noise.

    Where the motion is imposed the force itself is measured, so that it appears in full everywhere.
    """
    batch, drive, evidence = posterior.batch, posterior.drive_of(vector), posterior.recordings
    scored = np.asarray(batch.block_count) > 0
    rng = np.random.default_rng(20020301)
    if batch.imposed:
        whole = (float(drive.friction.Fc) / np.asarray(batch.noise))[:, None] ** 2 * scored
        noise = np.repeat(1.0 * scored[None], _DRAWS, axis=0)
        return Answer(whole, np.ones_like(whole), noise, noise * whole, 0.0 * noise)
    assert isinstance(evidence, Observed)
    plain = posterior.errors_at([vector])[0]
    draws, grown, together = [], [], []
    for _ in range(_DRAWS):
        change = np.nan_to_num(_force_response(posterior, vector, plain, _SMALL, rng) / _SMALL)
        noise = evidence.noise_alone(rng)
        noisier = with_evidence(posterior, evidence.with_noise(rng.standard_normal(batch.x.shape)))
        response = np.nan_to_num(noisier.errors_at([vector])[0] - plain)
        grown.append(batch.block_mean(response**2))
        together.append(batch.block_mean(response * change))
        products = (noise**2, change**2, noise * change)
        draws.append([batch.block_mean(product) for product in products])
    noise, force, product = (np.array(some) for some in zip(*draws, strict=True))
    # One block in which the break-away came earlier must not dominate the mean over its neighbours.
    gain = _smooth(capped(force.mean(axis=0), rule))
    growth = beyond_chance(_smooth(np.mean(grown, axis=0)), np.asarray(batch.block_count), rule)
    if not np.any(evidence.varies):
        return Answer(gain, growth, noise, force, product)
    # A filter that knows the machine is no observer of a free mass: its noise is what the machine answers with.
    varies, own = np.asarray(evidence.varies)[:, None], _smooth(capped(np.mean(grown, axis=0), rule))
    own = np.where(own > 0.0, own, 1.0)
    return Answer(
        gain,
        np.where(varies, own, growth),
        np.where(varies, np.array(grown) / own, noise),
        force,
        np.where(varies, np.array(together) / np.sqrt(own), product),
    )


def _smooth(power: Float[np.ndarray, "r b"]) -> Float[np.ndarray, "r b"]:
    """The `power` of each block averaged over its neighbours."""
    kernel = np.ones(_SMOOTH) / _SMOOTH
    return np.stack([np.convolve(row, kernel, mode="same") for row in power])


def beyond_chance(
    growth: Float[np.ndarray, "r b"], count: Float[np.ndarray, "r b"], rule: Rule
) -> Float[np.ndarray, "r b"]:
    """The `growth` of the noise in each block of `count` samples, 1 where the `rule` takes it for chance: a power
    of n samples has the standard error sqrt(2/n)."""
    samples = np.maximum(_DRAWS * _SMOOTH * count, 1.0)
    return np.where(growth > 1.0 + rule.floor.chance * np.sqrt(2.0 / samples), growth, 1.0)


def capped(mean: Float[np.ndarray, "r b"], rule: Rule) -> Float[np.ndarray, "r b"]:
    """The `mean` response of each block, at most that many times their median that the `rule` allows."""
    return np.minimum(mean, rule.floor.cap * np.median(mean[mean > 0])) if np.any(mean > 0) else mean


def gap_force(force: float, rule: Rule) -> float:
    """The unmeasured force (over Fc) by which a machine with a gap is tested for chaos: `force`, or that of the `rule`
    where it is larger."""
    return max(force, rule.floor.gap_force)


def is_predictable(spread: Float[np.ndarray, "r b"], rule: Rule) -> Bool[np.ndarray, "r b"]:
    """Whether two runs differ by so little in each block that it counts, by the `rule`; `spread` is the power of their
    difference."""
    return spread < rule.floor.unpredictable


def scatter(
    posterior: Posterior, vector: Float[Numbers, " q"], size: float, *, draws: int = _DRAWS
) -> Float[np.ndarray, "r b"]:
    """Power of the difference, in each block, shape `(r, b)`, between two runs of the `posterior` at `vector` with
    different unmeasured forces of the `size` (over Fc), in the mean of `draws`.

    Of a machine with chaotic contacts even a perfect model leaves that much, since it knows neither the force nor where
    in its gap the load starts.
    """
    rng, plain = np.random.default_rng(20020302), posterior.errors_at([vector])[0]
    changes = [_force_response(posterior, vector, plain, size, rng) for _ in range(draws)]
    # The difference of two runs, or its square, may overflow.
    bounded = [np.clip(np.nan_to_num(change, nan=np.inf), -_BEYOND, _BEYOND) for change in changes]
    powers = [posterior.batch.block_mean(change**2) for change in bounded]
    return _smooth(np.mean(powers, axis=0))


def predictable(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    size: float,
    *,
    draws: int = _DRAWS,
    rule: Rule = Rule(),
) -> tuple[Posterior, bool]:
    """The `posterior` without the blocks in which an unmeasured force of the `size` (over Fc) changes the innovations
    at `vector`, in the mean of `draws`, by more than the `rule` allows; and whether there are any.

    Such a force makes a break-away earlier or later, and all errors that follow have that one cause: a fit that counts
    them as independent is biased by it. Powers and misfits still include all blocks.
    """
    near = is_predictable(scatter(posterior, vector, size, draws=draws), rule)
    scored = np.asarray(posterior.batch.block_count) > 0
    kept = np.where(near, 1.0, 0.0).ravel()
    some = bool(np.any(scored & ~near))
    return eqx.tree_at(lambda p: p.weights, posterior, (np.asarray(posterior.weights[0]) * kept,)), some


def _force_response(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    plain: Float[Numbers, "r n"],
    size: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "r n"]:
    """Change of the innovations `plain` by a white force of the `size` (over Fc) that is constant over each sample."""
    drive = posterior.drive_of(vector)
    force = size * float(drive.friction.Fc) / float(drive.motor_constant)
    disturbed = posterior.recordings.with_input(force * rng.standard_normal(posterior.batch.x.shape))
    return with_evidence(posterior, disturbed).errors_at([vector])[0] - plain


def quietness(
    power: Float[np.ndarray, "r b"], answer: Answer, posterior: Posterior
) -> Float[np.ndarray, "r 1"]:
    """Power of the measurement noise in each recording over its first estimate, at most 1, shape `(r, 1)`.

    The first estimate comes from fourth differences, which count motion at frequencies near that of sampling as noise.
    Where the block `power` that a model leaves is lower in half of the blocks, so is the noise. `answer` and the
    `posterior` are those of `answer_to_force`.
    """
    scored = np.asarray(posterior.batch.block_count) > 0
    quiet = np.ones((scored.shape[0], 1))
    for row, mask in enumerate(scored):
        if np.any(mask):
            alone = (answer.growth * answer.noise)[:, row, mask]
            quiet[row] = min(1.0, float(np.median(power[row, mask]) / np.median(alone)))
    return quiet


def force_noise(
    power: Float[np.ndarray, "r b"],
    answer: Answer,
    posterior: Posterior,
    quiet: Float[np.ndarray, "r 1"] | float = 1.0,
    *,
    rule: Rule = Rule(),
) -> float:
    """Standard deviation of the unmeasured force over Coulomb friction that explains the block `power` of shape
    `(r, b)`, from the fitted recordings; `quiet` is the power of the measurement noise in each.

    Each block gives its own estimate of the power of the force. The result is the size at which the simulated blocks of
    `answer` give the same, at a quantile below the median: an effect raises some of the blocks.
    """
    scored = (np.asarray(posterior.batch.block_count) > 0) & (np.asarray(posterior.fitted[0])[:, None] > 0)
    gain = np.where(scored, answer.gain, 0.0)
    informative = gain > rule.floor.answering * gain.max()
    if not np.any(informative):
        return 0.0

    def estimate(power: Float[np.ndarray, "*d r b"]) -> float:
        each = (power - quiet * answer.growth) / np.where(informative, gain, 1.0)
        return float(np.quantile(each[..., informative], rule.floor.quantile))

    observed, low, high = estimate(power), 0.0, rule.floor.largest_force
    if observed <= estimate(answer.powers(low, quiet)):
        return 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if estimate(answer.powers(middle, quiet)) < observed else (low, middle)
    return high


def floor_of(
    size: float, answer: Answer, quiet: Float[np.ndarray, "r 1"] | float = 1.0
) -> Float[np.ndarray, "r b"]:
    """Power of each block, shape `(r, b)`, that noise of the power `quiet` and an unmeasured force of the `size` (over
    Fc) leave, by the responses of `answer`."""
    return quiet * answer.growth + size**2 * answer.gain


def colour(
    power: Float[np.ndarray, "r b"],
    floor: Float[np.ndarray, "r b"],
    posterior: Posterior,
    *,
    rule: Rule = Rule(),
) -> Float[np.ndarray, "r 1"]:
    """Factor on the `floor` of each recording by which the colour of its noise may raise it, shape `(r, 1)`: the median
    over the blocks of the `power` that a model leaves over the floor, at least 1 and at most what the `rule` allows.

    Noise is distinguished from motion by fourth differences, which respond to the highest frequencies alone: noise of
    lower frequencies leaves more power in the innovations than white noise with the same fourth differences.
    """
    factor = np.ones((power.shape[0], 1))
    for row, scored in enumerate(np.asarray(posterior.batch.block_count) > 0):
        if np.any(scored):
            factor[row] = np.clip(np.median((power / floor)[row, scored]), 1.0, rule.floor.colour)
    return factor
