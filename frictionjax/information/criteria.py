"""The value of an experiment: D, D_s and A optimality (Atkinson, Donev, Tobias 2007, ch. 10) with a weak prior.

An information matrix I is represented by rows R with R'R = I throughout: a QR of R resolves a direction that is 1e-16
of another, where the matrix itself loses those below 1e-8 to rounding.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from frictionjax.core import InputError
from frictionjax.core.safe import real
from frictionjax.information.fisher import PRIOR, Information, scaled_to_ones

Kind = Literal["D", "A", "parameter"]
"""All parameters (D, nats), those asked for (parameter, nats), or their mean relative variance (A)."""


class Criterion(eqx.Module):
    """A measure of information that is finite for any experiment, and larger for a better one.

    With R'R = I + prior^-2 (coordinates in units of `scale`) and the parameters that are asked for last in the QR,
    D is the sum of log|R_ii| over all parameters, "parameter" that over those asked for (minus half the logarithm of
    the determinant of their covariance, D_s), and A minus their mean variance. All fields are arrays: one compiled
    program serves every criterion.

    **Attributes:**

    - `order`: places of the `p` parameters, those asked for last, shape `(p,)`.
    - `asked`: 1 for those that count and 0 for the others, in this order, shape `(p,)`.
    - `scale`: what counts as a large step of each coordinate, shape `(p,)`.
    - `by_variance`: whether it is A.
    """

    order: Int[Array, " p"]
    asked: Float[Array, " p"]
    scale: Float[Array, " p"]
    by_variance: Bool[Array, ""]

    def __call__(self, rows: Float[Array | np.ndarray, "m p"]) -> Float[Array, ""]:
        """Value for the information R'R of `rows`, shape `(m, p)`, coordinates of `Information`; nats, save for A."""
        unit = jnp.eye(self.order.shape[0])
        scaled = jnp.concatenate([rows * self.scale[None, :], unit / PRIOR])
        root = jnp.linalg.qr(scaled[:, self.order], mode="r")
        variances = jnp.sum(jsl.solve_triangular(root, unit) ** 2, axis=1)
        mean = jnp.sum(self.asked * variances) / jnp.sum(self.asked)
        return jnp.where(self.by_variance, -mean, jnp.sum(self.asked * jnp.log(jnp.abs(jnp.diag(root)))))


class Question(NamedTuple):
    """What an experiment is to determine: the `kind` of criterion, and the names `of` the parameters (None: all)."""

    kind: Kind
    of: tuple[str, ...] | None

    def criterion(self, names: tuple[str, ...], scale: Float[np.ndarray, " p"]) -> Criterion:
        """The `Criterion` for parameters called `names`, with their `scale`, shape `(p,)`."""
        asked = names if self.of is None else self.of
        last = [names.index(name) for name in asked]
        order = [place for place in range(len(names)) if place not in last] + last
        counts = np.arange(len(names)) >= len(names) - len(last)
        return Criterion(jnp.asarray(order), real(counts), real(scale), jnp.asarray(self.kind == "A"))

    def in_words(self, gain: float, names: tuple[str, ...]) -> str:
        """A `gain` in words, as the end of a sentence that begins with an experiment; `names` are all parameters."""
        if self.kind == "A":
            return f"lowers the mean variance of {', '.join(self.of or names)} by {gain:.3g}"
        return f"adds {gain:.3g} nats" + (f" about {', '.join(self.of)}" if self.of else "")


def question_of(kind: Kind, of: str | Sequence[str] | None, names: tuple[str, ...]) -> Question:
    """The `Question` of this `kind` about the parameters `of` (None: all) among `names`, checked."""
    if kind not in ("D", "A", "parameter"):
        raise InputError(
            f"{kind!r} is not known",
            place="`criterion`",
            cure='Choose "D" (all parameters), "parameter" (those named by `of`) or "A" (their mean variance).',
        )
    asked = names if of is None else (of,) if isinstance(of, str) else tuple(of)
    wrong = [name for name in asked if name not in names]
    if wrong or not asked or len(set(asked)) < len(asked):
        problem = (
            f"no free parameter is called {', '.join(wrong)}" if wrong else "it names none, or one twice"
        )
        raise InputError(problem, place="`of`", cure=f"Name some of {', '.join(names)}, each once.")
    if kind == "D" and of is not None:
        raise InputError(
            'criterion "D" counts all parameters', place="`of`", cure='Leave it out, or choose "parameter".'
        )
    if kind == "parameter" and of is None:
        raise InputError(
            "no parameter is asked for",
            place="`of`",
            cure=f'Name some of {", ".join(names)}, or choose "D" to count all.',
        )
    return Question(kind, None if of is None else asked)


def root_of(matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Rows R, shape `(p, p)`, with R'R the information `matrix`; negative eigenvalues, from rounding, count as zero."""
    size, scaled = scaled_to_ones(matrix)
    values, vectors = np.linalg.eigh(scaled)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size[None, :]


def known_rows(
    known: Information | None, names: tuple[str, ...], values: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "p p"]:
    """Rows of the information `known` before, shape `(p, p)` (zeros for None), about `names` at these `values`."""
    if known is None:
        return np.zeros((len(names), len(names)))
    if known.names != names or not np.allclose(known.values, values, rtol=1e-12, atol=0.0):
        raise InputError(
            f"it is about {', '.join(known.names)}, or its values differ from those of `drive`",
            place="`known`",
            cure=f"Make it with the same `drive` and with `free` = {', '.join(names)}.",
        )
    if not np.all(np.isfinite(known.parts)):
        raise InputError(
            "it is not finite",
            place="`known`",
            cure="Give what `fisher_information` or `information_of` returns.",
        )
    return root_of(known.matrix)


def bounds_in_words(information: Information, asked: Sequence[str] | None = None) -> str:
    """Least standard deviations of the parameters `asked` for (None: all), and the unidentifiable ones, as a phrase."""
    names, std = information.names if asked is None else tuple(asked), information.std
    units = dict(zip(information.names, information.units, strict=True))
    logs = dict(zip(information.names, information.logs, strict=True))
    determined = [
        f"{name} to {100.0 * std[name]:.2g} %"
        if logs[name]
        else f"{name} to {std[name]:.2g} {units[name].replace('{', '').replace('}', '')}".removesuffix(" 1")
        for name in names
        if np.isfinite(std[name])
    ]
    lost = [name for name in names if not np.isfinite(std[name])]
    parts = [f"least standard deviations: {', '.join(determined)}"] if determined else []
    return "; ".join(parts + ([f"not identifiable: {', '.join(lost)}"] if lost else []))
