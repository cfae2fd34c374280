"""`identifiability`: what the data hold, and in words what they do not: which directions are null, and what mends it.

A direction c of the logarithms (strengths: over their typical size), of largest component 1, is null when c'Ic < 1:
its parameter may change by its own size before the noise is reached. Directions with a reason in the physics are
looked for first, then single parameters, then the smallest groups that are held only together.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.information.fisher import Information, inverse_information, scaled_to_ones
from frictionjax.information.null_directions import NullSearch
from frictionjax.information.planned import MOTOR

_PART = 1e-4  # of its largest component: smaller ones are rounding


class NullDirection(eqx.Module):
    """A change of the parameters that the data do not see.

    **Attributes:**

    - `weights`: name -> part in it, the largest 1: relative change of a positive parameter, change over its typical
        size of a strength.
    - `sentence`: which it is, and which data to add.
    """

    weights: dict[str, float] = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


class Identifiability(eqx.Module):
    """What experiments hold and what they do not.

    **Attributes:**

    - `held`: name -> least standard deviation (Cramer-Rao), relative where positive, else in the strength's own unit.
    - `combinations`: the same, relative, for sums and ratios that are held where their members are not.
    - `lost`: names of the parameters that are not held; no number is given for them.
    - `directions`: the null directions found, a `NullDirection` each.
    """

    held: dict[str, float] = eqx.field(static=True)
    combinations: dict[str, float] = eqx.field(static=True)
    lost: tuple[str, ...] = eqx.field(static=True)
    directions: tuple[NullDirection, ...] = eqx.field(static=True)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is not held and why, one sentence for each cause; empty when every parameter is held."""
        return tuple(dict.fromkeys(direction.sentence for direction in self.directions))


def identifiability(information: Information) -> Identifiability:
    """Which parameters `information` holds, and the null directions in words, each with the data to add.

    A parameter is held when its Cramer-Rao bound is below its own value (for a strength: below its typical size).

    **Arguments:**

    - `information`: of planned experiments (`fisher_information`), or of a fit's covariance (`information_of`).

    **Returns:**

    An `Identifiability`.

    **Raises:**

    `InputError` when the information is not a finite, symmetric matrix of variances without a negative direction.
    """
    _check(information.scaled)
    names, search = information.names, NullSearch(information)
    search.known_directions()
    search.single_parameters()
    search.groups()
    search.rest()
    held = {name: value for name, value in information.std.items() if np.isfinite(value)}
    lost = tuple(name for name in names if name not in held)
    directions = tuple(
        NullDirection({n: float(w) for n, w in zip(names, c, strict=True) if abs(w) > _PART}, sentence)
        for c, sentence in zip(search.found, search.sentences, strict=True)
    )
    combinations = {name: float(np.sqrt(value)) for name, value in search.combinations.items() if value < 1.0}
    return Identifiability(held, combinations, lost, directions)


def information_of(
    names: Sequence[str],
    values: Sequence[float],
    covariance: Float[np.ndarray, "p p"],
    *,
    scale: Sequence[float] | None = None,
) -> Information:
    """Information that a covariance matrix in physical units stands for: for a report on a fit.

    I = C^-1, in the logarithms of positive parameters.

    **Arguments:**

    - `names`: of the `p` parameters.
    - `values`: estimates, each in its unit; positive, save strengths of effects.
    - `covariance`: of the estimates, shape `(p, p)`, in their units.
    - `scale`: for a strength of an effect its typical size in its own unit, for a positive parameter 0; None: all are
        positive.

    **Returns:**

    An `Information`.

    **Raises:**

    `InputError` when the lengths differ, a positive parameter is not, or the covariance is not finite or not a
    positive definite matrix: a parameter at the end of its range has a variance of zero and must be left out.
    """
    value, matrix = np.asarray(values, dtype=float), np.asarray(covariance, dtype=float)
    size = np.zeros(value.size) if scale is None else np.asarray(scale, dtype=float)
    count = len(names)
    if value.shape != (count,) or size.shape != (count,) or matrix.shape != (count, count):
        problem = f"{count} names, values {value.shape}, scale {size.shape} and covariance {matrix.shape}"
        raise InputError(problem, place="`covariance`", cure="Give one of each for every parameter.")
    logs = size == 0.0
    if not np.all(np.isfinite(value)) or not np.all(size >= 0.0) or np.any(value[logs] <= 0.0):
        bad = ", ".join(
            f"{n} = {v:g}" for n, v, log in zip(names, value, logs, strict=True) if log and not v > 0
        )
        problem = f"not positive: {bad}" if bad else "not all are finite"
        raise InputError(problem, place="`values`", cure="Leave it out, or give it a `scale`.")
    own = np.where(logs, value, size)
    relative = matrix / np.outer(own, own)
    _check(relative)
    if np.any(np.diag(relative) <= 0.0):
        bad = ", ".join(n for n, v in zip(names, np.diag(relative), strict=True) if not v > 0.0)
        raise InputError(
            f"no variance for {bad}", place="`covariance`", cure="Leave it out: nothing is known of it."
        )
    units = tuple("{force}" if name in _FORCES else "" for name in names)
    unit = np.where(logs, 1.0, size)
    inverse = inverse_information(relative) / np.outer(unit, unit)
    return Information(tuple(names), units, tuple(logs.tolist()), value, unit, inverse[None])


_FORCES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", MOTOR.name)


def _check(matrix: np.ndarray) -> None:
    """A matrix of variances or of information has no negative direction."""
    cure = "Give the matrix of `fisher_information`, or the covariance of a fit that converged."
    if not np.all(np.isfinite(matrix)):
        raise InputError("the matrix is not finite", place="`information`", cure=cure)
    _, scaled = scaled_to_ones(matrix)
    if np.max(np.abs(scaled - scaled.T)) > 1e-8 or np.min(np.linalg.eigvalsh(scaled)) < -1e-8:
        raise InputError(
            "the matrix is not symmetric, or has a negative direction", place="`information`", cure=cure
        )
