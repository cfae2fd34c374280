"""From the right valley to its bottom: prediction errors of a Kalman filter, with the noise that is really there.

In turn: the noise of each recording by the likelihood, then the parameters by Levenberg-Marquardt, until neither moves.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from frictionjax.estimation.evidence import (
    Forces,
    Noise,
    Observed,
    Positions,
    filtered,
    scored_from_the_start,
)
from frictionjax.estimation.least_squares import STRIDE, equal_curvature, levenberg_marquardt
from frictionjax.estimation.posterior import Posterior

# Unmeasured force over Coulomb friction: what is allowed at first, while the parameters are still coming; then
# candidates for what is likely; then candidates over the last one found. All of one number: one compiled program.
_AT_FIRST = np.array([0.005, 0.01, 0.02, 0.04, 0.08])
_LIKELY = np.array([0.0, 1e-4, 1e-3, 1e-2, 1e-1])
_NEXT = np.array([0.1, 0.3, 0.6, 1.0, 1.7])
_STEPS = 5  # of Levenberg-Marquardt in a round; the first only looks around
_ROUNDS = 8
_STILL = 0.5  # of the cost, a log-likelihood: less is no news
# A recording that asks for so many times the least unmeasured force may have a wrong model.
_APART = 30.0
_LESS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)  # unmeasured force over Coulomb friction, in turn, to find out
_LONG = 6.0  # times the units of the solver: so near the bottom next to no damping is needed
_CLOSE = 0.05  # of a unit: steps converge quadratically here, and the last one leaves far less
_MOVED = 0.25  # standard deviations: a round that moves no parameter further is the last


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
        push = np.asarray(self.noise.push)
        return bool(np.max(push) > _APART * np.min(push) and np.min(push) > 0.0)


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
        first, _ = _descended(_weighed(first, _of_friction(first, _AT_FIRST), substeps, known))
    found = _to_the_bottom(first, _LIKELY, substeps, known)
    if found.apart and found.noise is not None:
        # Parameters that only one recording shows may be far off and look like an unmeasured force there. Allowed less
        # and less of it, all alike, the recordings must follow the model; the likelihood judges which of the two holds.
        present = _Present(forgiving, vector, None, None)
        for part in _LESS:
            ratios = _of_friction(present, np.full(_NEXT.size, part))
            present, _ = _descended(_weighed(present, ratios, substeps, known))
        again = _to_the_bottom(present, _NEXT, substeps, known)
        if again.cost < found.cost - _STILL:
            return again
    return found


def _to_the_bottom(present: _Present, parts: Float[np.ndarray, " k"], substeps: int, known) -> Refined:
    """Noise and parameters in turn, until neither moves; `parts` of Coulomb friction are the first candidates."""
    last, converged = np.inf, False
    for number in range(_ROUNDS):
        around = _around(present) if number > 0 or parts is _NEXT else _of_friction(present, parts)
        moved, cost = _descended(_weighed(present, around, substeps, known))
        # A coordinate's unit is so many of its standard deviations, were all others known.
        far = float(jnp.max(jnp.abs(moved.vector - present.vector) / moved.unit)) * _LONG * STRIDE
        gained = last - cost
        if cost < last:
            present, last = moved, cost
        if gained < _STILL or (np.isfinite(gained) and far < _MOVED):
            converged = True
            break
    return Refined(present.posterior, present.vector, present.noise, float(last), converged)


def _around(present: _Present) -> Float[np.ndarray, "r k"] | None:
    """Candidates about the likeliest ratios: where a parabola through those tried has its top."""
    return None if present.noise is None else np.asarray(present.noise.best)[:, None] * _NEXT[None]


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
            evidence[index], noise = filtered(
                drive, z0, batch, jnp.asarray(ratios), jnp.asarray(known), substeps
            )
    weighed = eqx.tree_at(lambda p: p.evidence, posterior, tuple(evidence))
    return _Present(weighed, vector, noise, present.unit)


def _descended(present: _Present) -> tuple[_Present, float]:
    """A few steps down; and minus the log-likelihood, noise included, by which rounds are compared."""
    posterior, unit = present.posterior, present.unit
    if unit is None:
        unit = _LONG * equal_curvature(posterior, present.vector)
    vector, cost, _ = levenberg_marquardt(posterior, present.vector, unit, _STEPS, tolerance=_CLOSE)
    total = float(cost) + sum(float(one.log_deviation) for one in posterior.evidence)
    return _Present(posterior, posterior.within(vector), present.noise, unit), total
