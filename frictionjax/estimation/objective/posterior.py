"""Everything that a fit weighs: all evidence under one loss, the weak prior, and what is known beforehand."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.constraints import Constraints, belief_residuals
from frictionjax.estimation.evidence import AbstractEvidence, Observed, Positions
from frictionjax.estimation.objective.loss import AbstractLoss
from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic, quadratic_of
from frictionjax.estimation.parameters import INSIDE, at_a_bound, pack, unpack
from frictionjax.physics import Drive


class Posterior(AbstractObjective):
    """Minus the logarithm of the posterior density of the free vector, but for a constant.

    The vector has the p free parameters, then the starting deflection (over Fs/sigma0) of each recording, evidence by
    evidence; q in all.

    **Attributes:** `constraints`, `drive` (structure and fixed parameters), `start` (centre of the admissible range and
    of the weak prior), `prior` (its inverse standard deviations), shape `(q,)`, `evidence`, `weights` (of each
    evidence's cost, shape `(b,)` each: one for every block), `loss`.
    """

    constraints: Constraints
    drive: Drive
    start: Float[Array, " q"]
    prior: Float[Array, " q"]
    evidence: tuple[AbstractEvidence, ...]
    weights: tuple[Float[Array, " b"], ...]
    loss: AbstractLoss

    @property
    def parameters(self) -> int:
        """Number of free parameters, p."""
        return len(self.constraints.layout)

    @property
    def has_positions(self) -> bool:
        """Whether any recording is force-driven."""
        return any(isinstance(one, Observed | Positions) for one in self.evidence)

    @property
    def log_deviation(self) -> Float[Array, ""]:
        """What the noise adds to the cost: sum of the logarithms of all standard deviations, weighted as the errors."""
        return sum(
            (weight @ one.log_deviation for one, weight in zip(self.evidence, self.weights, strict=True)),
            start=jnp.zeros(()),
        )

    def drive_of(self, vector: Float[Array, " q"]) -> Drive:
        """The `Drive` of a free vector, shape `(q,)`."""
        count = self.parameters
        free = unpack(self.constraints.layout, self.drive, vector[:count], self.start[:count])
        return self.constraints.tied(free)

    def deflections_of(self, vector: Float[Array, " q"], index: int) -> Float[Array, " rows"]:
        """Starting deflections, over Fs/sigma0, of the recordings of evidence number `index`."""
        first = self.parameters + sum(one.rows for one in self.evidence[:index])
        return vector[first : first + self.evidence[index].rows]

    def within(self, vector: Float[Array, " q"]) -> Float[Array, " q"]:
        """`vector`, shape `(q,)`, with coordinates beyond an end of their range at that end: further out there is no
        slope, and none would ever come back."""
        count = self.parameters
        layout = self.constraints.layout
        free = unpack(layout, self.drive, vector[:count], self.start[:count])
        return jnp.concatenate([pack(layout, free), jnp.clip(vector[count:], -1.0, 1.0)])

    def reaching(self, vector: Float[Array, " q"]) -> "Posterior":
        """The same, but where `vector`, shape `(q,)`, is at an end of a range about the start, it starts there: a
        descent that began far off may have further to go."""
        layout, count = self.constraints.layout, self.parameters
        ends = at_a_bound(layout, vector[:count], self.start[:count], margin=2.0 * INSIDE)
        places = np.array([one.label in ends for one in layout] + [False] * (vector.shape[0] - count))
        return eqx.tree_at(lambda p: p.start, self, jnp.where(places, vector, self.start))

    def errors(self, vector: Float[Array, " q"], index: int) -> Float[Array, "b n"]:
        """Errors over their standard deviations of evidence number `index`, shape `(b, n)`, at `vector`."""
        return self.evidence[index].errors(self.drive_of(vector), self.deflections_of(vector, index))

    def columns(self, vector: Float[Array, " q"], index: int) -> tuple[Array, Array]:
        """The same errors, and their forward-mode derivatives, shape `(q, b, n)`; `vector`, `index` as in `errors`.

        A starting deflection moves its own recording only, so one column serves all of them.
        """
        count, size = self.parameters, vector.shape[0]
        rows = self.evidence[index].rows
        first = count + sum(one.rows for one in self.evidence[:index])
        basis = jnp.eye(count + (rows > 0), size)
        if rows:
            basis = basis.at[count].set(jnp.zeros(size).at[first : first + rows].set(1.0))
        e, columns = jax.vmap(
            lambda way: jax.jvp(lambda q: self.errors(q, index), (vector,), (way,)), out_axes=(None, 0)
        )(basis)
        full = jnp.zeros((size, *e.shape)).at[:count].set(columns[:count])
        if rows:
            shape = (rows, -1, e.shape[1])
            own = jnp.eye(rows)[:, :, None, None] * columns[count].reshape(shape)[None]
            full = full.at[first : first + rows].set(own.reshape(rows, *e.shape))
        return e, full

    def quadratic(self, vector: Float[Array, " q"]) -> Quadratic:
        """The cost near `vector`, shape `(q,)`."""
        total = self._known(vector)
        for index, (evidence, weight) in enumerate(zip(self.evidence, self.weights, strict=True)):
            e, columns = self.columns(vector, index)
            total += quadratic_of(e, columns, evidence.count, self.loss, weight)
        return total

    def _known(self, vector: Float[Array, " q"]) -> Quadratic:
        """The cost of the weak prior and of what is known beforehand."""
        off = (vector - self.start) * self.prior
        total = Quadratic(0.5 * off @ off, off * self.prior, jnp.diag(self.prior**2))
        beliefs = self.constraints.beliefs
        if beliefs:
            residual = belief_residuals(beliefs, self.drive_of(vector))
            slope = jax.jacfwd(lambda q: belief_residuals(beliefs, self.drive_of(q)))(vector)
            total += Quadratic(0.5 * residual @ residual, slope.T @ residual, slope.T @ slope)
        return total


class Near(NamedTuple):
    """What standard errors are made of: the `cost`; its `hessian`, shape `(q, q)`; for each evidence the gradient of
    each block's cost, shape `(b, q)`, and each block's mean square in noise levels, shape `(b,)`."""

    cost: Float[Array, ""]
    hessian: Float[Array, "q q"]
    gradients: tuple[Float[Array, "b q"], ...]
    powers: tuple[Float[Array, " b"], ...]


def near_of(posterior: Posterior, vector: Float[Array, " q"]) -> Near:
    """The cost of `posterior` about `vector`, shape `(q,)`, block by block."""
    total, gradients, powers = posterior._known(vector), [], []
    for index, (evidence, weight) in enumerate(zip(posterior.evidence, posterior.weights, strict=True)):
        e, columns = posterior.columns(vector, index)
        total += quadratic_of(e, columns, evidence.count, posterior.loss, weight)
        power = jnp.sum(e * e, axis=1) / jnp.maximum(evidence.count, 1.0)
        scale = posterior.loss.weight(power) * weight
        gradients.append((jnp.sum(columns * e[None], axis=2) * scale[None]).T)
        powers.append(power)
    return Near(total.cost, total.hessian, tuple(gradients), tuple(powers))


curvature_and_gradients = eqx.filter_jit(near_of)
"""`near_of`, compiled."""
