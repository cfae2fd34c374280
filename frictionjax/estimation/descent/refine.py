"""From the right valley to its bottom: prediction errors of a Kalman filter, with the noise that is really there.

In turn: the noise of each recording by the likelihood, then the parameters by Levenberg-Marquardt, until neither moves.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from frictionjax.estimation.descent.levenberg_marquardt import STRIDE, equal_curvature, levenberg_marquardt
from frictionjax.estimation.evidence import (
    Forces,
    Noise,
    Observed,
    Positions,
    filtered_on_all,
    scored_from_the_start,
)
from frictionjax.estimation.objective.posterior import Posterior

# Unmeasured force over Coulomb friction: what is allowed at first, while the parameters are still coming; then
# candidates for what is likely; then candidates over the last one found. All of one number: one compiled program.
AT_FIRST = np.array([0.005, 0.01, 0.02, 0.04, 0.08])
LIKELY = np.array([1e-6, 1e-4, 1e-3, 1e-2, 1e-1])
NEXT = np.array([0.1, 0.3, 0.6, 1.0, 2.5])
STEPS = 5  # of Levenberg-Marquardt in a round; the first only looks around
ROUNDS = 12
STILL = 0.5  # of the cost, a log-likelihood: less is no news
SHORT = 1.0  # standard deviations of a coordinate, were all others known: so short a round was the last,
ALIKE = np.log(1.2)  # if the likeliest noise also stays within this factor
# A recording that asks for so many times the least unmeasured force may have a wrong model.
_APART, _USUAL = 30.0, 1e-3  # the second: of Coulomb friction, less is not worth a thought
_LESS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)  # unmeasured force over Coulomb friction, in turn, to find out
LONG = 6.0  # times the units of the solver: so near the bottom next to no damping is needed
CLOSE = 0.05  # of a unit: steps converge quadratically here, and the last one leaves far less
_WORSE = 3  # rounds that cost more than the one before, until it is given up
_FAR = 60  # steps through a valley that bends, where no noise has to be found on the way
_SHORTER = 4.0  # times shorter units, and so sixteen times the damping, after a round whose steps all fail


class Refined(eqx.Module):
    """The bottom of the valley.

    **Attributes:** `posterior` (with the evidence as weighed at last), `vector`, `noise` of the recordings of position
    (None without any), `cost` (minus the log-likelihood with the noise, but for a constant), `converged`.
    """

    posterior: Posterior
    vector: Float[Array, " q"]
    noise: Noise | None
    cost: float
    converged: bool

    @property
    def apart(self) -> bool:
        """Whether one recording asks for far more unmeasured force than another: its part of the model may be wrong."""
        if self.noise is None:
            return False
        push, level = np.asarray(self.noise.push), float(self.posterior.drive_of(self.vector).friction.Fc)
        return is_apart(push, level)


def is_apart(push: Float[np.ndarray, " r"], level: float) -> bool:
    """Whether one of the unmeasured forces `push` is far above another, and above what is usual at Coulomb friction
    `level`."""
    return bool(np.max(push) > _APART * max(float(np.min(push)), _USUAL * level))


class _Present(eqx.Module):
    posterior: Posterior
    vector: Float[Array, " q"]
    noise: Noise | None
    unit: Float[Array, " q"] | None


def refine(
    forgiving: Posterior, vector: Float[Array, " q"], *, substeps: int, known: Bool[np.ndarray, " r"]
) -> Refined:
    """Go to the bottom of the valley that `vector` is in.

    **Arguments:**

    - `forgiving`: the posterior that `settle` went down; its `Observed` evidence becomes `Positions`.
    - `vector`: where to start, shape `(q,)`.
    - `substeps`: integration steps per sample.
    - `known`: recordings of position whose noise is given, shape `(r,)`.
    """
    first = _Present(forgiving, vector, None, None)
    if forgiving.has_positions:
        first, _ = _descended(_weighed(first, _of_friction(first, AT_FIRST), substeps, known))
    elif any(isinstance(one, Forces) for one in forgiving.evidence):
        for _ in range(2):
            first = _far_down(_weighed(first, None, substeps, known))
    found = _to_the_bottom(first, LIKELY, substeps, known)
    if found.apart and found.noise is not None:
        # Parameters that only one recording shows may be far off and look like an unmeasured force there. Allowed less
        # and less of it, all alike, the recordings must follow the model; the likelihood judges which of the two holds.
        present = _Present(forgiving, vector, None, None)
        for part in _LESS:
            ratios = _of_friction(present, np.full(NEXT.size, part))
            present, _ = _descended(_weighed(present, ratios, substeps, known))
        again = _to_the_bottom(present, NEXT, substeps, known)
        if again.cost < found.cost - STILL:
            return again
    return found


def _to_the_bottom(present: _Present, parts: Float[np.ndarray, " k"], substeps: int, known) -> Refined:
    """Noise and parameters in turn, until neither moves; `parts` of Coulomb friction are the first candidates."""
    last, worse, retried, converged = np.inf, 0, False, False
    best, least = present, np.inf
    for number in range(ROUNDS):
        around = _around(present) if number > 0 or parts is NEXT else _of_friction(present, parts)
        moved, cost = _descended(_weighed(present, around, substeps, known))
        if bool(jnp.all(moved.vector == present.vector)) and not retried and number < ROUNDS - 1:
            # Every step failed: at the bottom, or where the valley bends too much for next to no damping.
            last, retried = min(last, cost), True
            shorter = None if moved.unit is None else moved.unit / _SHORTER
            present = _Present(moved.posterior, moved.vector, moved.noise, shorter)
            continue
        if cost < least:
            best, least, retried = moved, cost, False
        converged = abs(last - cost) < STILL or _at_rest(present, moved)
        # Other weights may cost a round what the next ones win back.
        worse += cost > last
        if converged or worse > _WORSE:
            break
        present, last = moved, cost
    return Refined(best.posterior, best.vector, best.noise, float(least), converged)


def _at_rest(before: _Present, after: _Present) -> bool:
    """Whether a round has moved next to nothing: the weights of one more would be the same."""
    if after.unit is None or (after.noise is not None and before.noise is None):
        return False
    far = np.abs(np.asarray(after.vector - before.vector)) * STRIDE * LONG / np.asarray(after.unit)
    if np.max(far) > SHORT:
        return False
    if before.noise is None or after.noise is None:
        return True
    return bool(np.all(np.abs(np.log(after.noise.best) - np.log(before.noise.best)) < ALIKE))


def _around(present: _Present) -> Float[np.ndarray, "r k"] | None:
    """Candidates about the likeliest ratios: where a parabola through those tried has its top."""
    return None if present.noise is None else np.asarray(present.noise.best)[:, None] * NEXT[None]


def _of_friction(present: _Present, parts: Float[np.ndarray, " k"]) -> Float[np.ndarray, "r k"] | None:
    """Candidate ratios for an unmeasured force of so many `parts` of Coulomb friction."""
    for one in present.posterior.evidence:
        if isinstance(one, Observed | Positions):
            level = float(present.posterior.drive_of(present.vector).friction.Fc)
            return level / np.asarray(one.batch.noise)[:, None] * parts[None]
    return None


def _weighed(present: _Present, ratios, substeps: int, known) -> _Present:
    """The same place, with every noise as likely as can be there."""
    posterior, vector = present.posterior, present.vector
    drive, evidence, noise = posterior.drive_of(vector), list(posterior.evidence), present.noise
    for index, one in enumerate(evidence):
        z0 = posterior.deflections_of(vector, index)
        if isinstance(one, Forces):
            evidence[index] = one.with_noise_of(drive, z0)
        elif isinstance(one, Observed | Positions):
            batch = scored_from_the_start(one.batch) if isinstance(one, Observed) else one.batch
            evidence[index], noise = filtered_on_all(
                drive, z0, batch, jnp.asarray(ratios), jnp.asarray(known), substeps
            )
    weighed = eqx.tree_at(lambda p: p.evidence, posterior, tuple(evidence))
    return _Present(weighed, vector, noise, present.unit)


def _far_down(present: _Present) -> _Present:
    """Many damped steps down, and ranges about where they lead: the robust cost may have left a parameter that hardly
    shows beside the forgiving noise at an end of its range."""
    posterior = present.posterior
    unit = equal_curvature(posterior, present.vector)
    end = levenberg_marquardt(posterior, present.vector, unit, _FAR, tolerance=CLOSE)
    vector = posterior.within(end.vector)
    return _Present(eqx.tree_at(lambda p: p.start, posterior, vector), vector, present.noise, None)


def _descended(present: _Present) -> tuple[_Present, float]:
    """A few steps down; and minus the log-likelihood, noise included, by which rounds are compared."""
    posterior, unit = present.posterior, present.unit
    if unit is None:
        unit = LONG * equal_curvature(posterior, present.vector)
    end = levenberg_marquardt(posterior, present.vector, unit, STEPS, tolerance=CLOSE)
    total = float(end.cost) + float(posterior.log_deviation)
    vector = posterior.within(end.vector)
    return _Present(posterior.reaching(vector), vector, present.noise, LONG * end.unit), total
