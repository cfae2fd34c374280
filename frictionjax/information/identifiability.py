"""`identifiability`: which parameters the data determine, which directions are null, and which data to add.

A direction c of the logarithms (strengths: over their typical size), of largest component 1, is null when c'Ic < 1:
its parameter may change by its own size before the noise is reached. Directions with a physical cause are
searched first, then single parameters, then the smallest groups of which only a combination is identifiable.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Real

from frictionjax.core import InputError, require_x64
from frictionjax.core.safe import real
from frictionjax.estimation import FitResult
from frictionjax.estimation.parameters import Free, pack, part_of, weak_prior
from frictionjax.information.fisher import Information, inverse_information, scaled_to_ones
from frictionjax.information.null_directions import CURES, OTHER, NullSearch, words_of
from frictionjax.information.planned import MOTOR, layout_of, scale_of, values_of
from frictionjax.physics import Drive

_ERRORS = 2.0  # standard errors that must be below the value for a parameter of a fit to be identifiable
_PART = 1e-4  # of its largest component: smaller ones are rounding


class NullDirection(eqx.Module):
    """A change of the parameters with less effect on the data than the noise.

    **Attributes:**

    - `weights`: name -> component, the largest 1: relative change of a positive parameter, change over its typical
        size of a strength.
    - `sentence`: which it is, and which data to add.
    """

    weights: dict[str, float] = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


class Identifiability(eqx.Module):
    """Which parameters experiments determine and which they do not.

    **Attributes:**

    - `identifiable`: name -> least standard deviation (Cramer-Rao), relative where positive, else in the unit of
        the strength.
    - `combinations`: the same, relative, for sums and ratios that are identifiable where their members are not.
    - `unidentifiable`: names of the other parameters; no number is given for them.
    - `directions`: the null directions found, a `NullDirection` each.
    """

    identifiable: dict[str, float] = eqx.field(static=True)
    combinations: dict[str, float] = eqx.field(static=True)
    unidentifiable: tuple[str, ...] = eqx.field(static=True)
    directions: tuple[NullDirection, ...] = eqx.field(static=True)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is not identifiable and why, one sentence for each cause; empty when every parameter is identifiable."""
        return tuple(dict.fromkeys(direction.sentence for direction in self.directions))


def identifiability(given: Information | FitResult) -> Identifiability:
    """Which parameters are identifiable, and the null directions in words, each with the data to add.

    A parameter is identifiable when its Cramer-Rao bound is below its own value (a strength: below its typical size).

    Of a fit, `covariance` is used, without the weak prior of `fit`: the information in the data and the user's own
    priors. Two standard errors must then be below the value, as for `identified`. A parameter at a limit of its
    range, or without a finite variance, is unidentifiable by itself; the others are judged as if it were known. The
    typical size of a strength is that of the fit; for a fit that was read from a file, that of the drive where it has
    one, else the strength's own value.

    **Arguments:**

    - `given`: `Information` of planned experiments (`fisher_information`) or of a covariance (`information_of`); or
        what `fit` found.

    **Returns:**

    An `Identifiability`.

    **Raises:**

    `InputError` when the information or covariance is not a finite, symmetric matrix without a negative direction;
    for a fit also `PrecisionError` unless JAX computes in float64.
    """
    return _of_fit(given) if isinstance(given, FitResult) else _of_information(given)


def _of_information(information: Information) -> Identifiability:
    _check(information.scaled)
    names, search = information.names, NullSearch(information)
    search.known_directions()
    search.single_parameters()
    search.groups()
    search.rest()
    identifiable = {name: value for name, value in information.std.items() if np.isfinite(value)}
    unidentifiable = tuple(name for name in names if name not in identifiable)
    directions = tuple(
        NullDirection({n: float(w) for n, w in zip(names, c, strict=True) if abs(w) > _PART}, sentence)
        for c, sentence in zip(search.found, search.sentences, strict=True)
    )
    combinations = {name: float(np.sqrt(value)) for name, value in search.combinations.items() if value < 1.0}
    return Identifiability(identifiable, combinations, unidentifiable, directions)


def _of_fit(result: FitResult) -> Identifiability:
    require_x64()
    ended = [name for name in result.names if name in result.at_bounds]
    spread = np.stack([np.diag(result.covariance), np.diag(result.covariance_white)])
    finite = np.all((spread > 0.0) & (spread < np.inf), axis=0)
    endless = [n for n, known in zip(result.names, finite, strict=True) if n not in ended and not known]
    places = [i for i, name in enumerate(result.names) if name not in (*ended, *endless)]
    rest, plain, own = Identifiability({}, {}, (), ()), Identifiability({}, {}, (), ()), {}
    if places:
        information = _information_of_fit(result, places)
        plain = _of_information(information)
        rest = _of_information(eqx.tree_at(lambda i: i.parts, information, information.parts / _ERRORS**2))
        unit = np.where(information.logs, information.values, 1.0)
        errors = np.sqrt(np.diag(result.covariance)[places]) / unit
        own = dict(zip(information.names, errors.tolist(), strict=True))
    # The weak prior of the search is narrower where errors count double, so the numbers come from the plain search,
    # and none is below the fit's own.
    identifiable = {
        name: max(plain.identifiable.get(name, value / _ERRORS), own[name])
        for name, value in rest.identifiable.items()
    }
    combinations = {
        name: plain.combinations.get(name, value / _ERRORS) for name, value in rest.combinations.items()
    }
    unidentifiable = tuple(name for name in result.names if name not in identifiable)
    return Identifiability(
        identifiable, combinations, unidentifiable, (*rest.directions, *_ended(ended), *_endless(endless))
    )


def _ended(names: Sequence[str]) -> tuple[NullDirection, ...]:
    """The parameters `names`, which ended at a limit of their range, by their common cure."""
    found = []
    for cure in dict.fromkeys(CURES.get(name, OTHER) for name in names):
        some = [name for name in names if CURES.get(name, OTHER) == cure]
        sentence = (
            f"{words_of(some)} ended at a limit of the admissible range, so the limit sets the value, not the data. "
            f"Widen the `bounds` if they are yours, or add {cure}."
        )
        found += [NullDirection({name: 1.0}, sentence) for name in some]
    return tuple(found)


def _endless(names: Sequence[str]) -> tuple[NullDirection, ...]:
    """The parameters `names`, to which the fit gave no finite variance."""
    if not names:
        return ()
    sentence = f"{words_of(names)} got no finite variance in this fit. Fit again from other starting values."
    return tuple(NullDirection({name: 1.0}, sentence) for name in names)


def _information_of_fit(result: FitResult, places: Sequence[int]) -> Information:
    """Information in the data and the user's priors of a fit, about the free parameters at `places` of its names."""
    drive, names = result.drive, [result.names[i] for i in places]
    layout = layout_of(drive, names)
    logs = np.asarray([one.parameter.transform == "log" for one in layout])
    values, size = values_of(layout, drive), _sizes(result, layout, places)
    if result.posterior is not None:
        layout = [result.posterior.constraints.layout[i] for i in places]
    layout = tuple(eqx.tree_at(lambda f: f.scale, one, real(s)) for one, s in zip(layout, size, strict=True))
    own = np.where(logs, values, size)
    square = np.ix_(places, places)
    white, honest = (
        matrix[square] / np.outer(own, own) for matrix in (result.covariance_white, result.covariance)
    )
    _check(white)
    _check(honest)
    # The prior is part of the white covariance; the factor for model error and correlated errors is applied after it.
    more = np.sqrt(np.diag(honest) / np.diag(white))
    to_free = np.asarray(_slope(layout, drive, jnp.asarray(values), jnp.asarray(own), logs))
    # The prior of a strength, a thousand times its size, is negligible.
    prior = to_free * np.where(logs, np.asarray(weak_prior(layout, 0)), 0.0)[:, None]
    information = _without(inverse_information(white), prior.T @ prior) / np.outer(more, more)
    return Information(
        names=tuple(names),
        units=tuple(one.parameter.unit for one in layout),
        logs=tuple(logs.tolist()),
        values=values,
        scale=size,
        parts=(information / np.outer(size, size))[None],
    )


def _sizes(result: FitResult, layout: Sequence[Free], places: Sequence[int]) -> Float[np.ndarray, " p"]:
    """Typical sizes, shape `(p,)`: 1 for a logarithm; of a strength that of the fit, of the drive, or its own."""
    if result.posterior is not None:
        layout = [result.posterior.constraints.layout[i] for i in places]
        sizes = [1.0 if one.parameter.transform == "log" else float(one.scale) for one in layout]
        return np.asarray(sizes)
    # A file has neither stroke nor sample time. A strength of about zero is unidentifiable by any size below its error.
    layout, errors = tuple(layout), np.sqrt(np.diag(result.covariance)[list(places)])
    sizes = scale_of(layout, result.drive, np.inf, np.inf)
    own = np.maximum(np.abs(values_of(layout, result.drive)), 0.5 * errors)
    return np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, own)


@eqx.filter_jit
def _slope(
    layout: tuple[Free, ...],
    drive: Drive,
    values: Float[Array, " p"],
    own: Float[Array, " p"],
    logs: Bool[Array | np.ndarray, " p"],
) -> Float[Array, "p p"]:
    """Derivative of the free vector of a fit by the logarithms of positive parameters and by strengths over their
    size, shape `(p, p)`."""

    def free(q: Float[Array, " p"]) -> Float[Array, " p"]:
        moved = jnp.where(logs, values * jnp.exp(jnp.where(logs, q, 0.0)), values + own * q)
        machine = eqx.tree_at(lambda d: [part_of(d, one.path) for one in layout], drive, list(moved))
        return pack(layout, machine)

    return jax.jacfwd(free)(jnp.zeros(len(layout)))


def _without(matrix: Float[np.ndarray, "p p"], prior: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """The information `matrix` less that of a `prior`; directions that rounding makes negative are set to zero."""
    size, scaled = scaled_to_ones(matrix)
    values, vectors = np.linalg.eigh(scaled - prior / np.outer(size, size))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size)


def information_of(
    names: Sequence[str],
    values: Real[Array | np.ndarray, "..."] | Sequence[float | int],
    covariance: Real[Array | np.ndarray, "..."],
    *,
    scale: Real[Array | np.ndarray, "..."] | Sequence[float | int] | None = None,
) -> Information:
    """The information of a covariance matrix in physical units, such as that of another program's result.

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
    positive definite matrix: a parameter at a limit of its range has a variance of zero and must be left out.
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
        raise InputError(f"no variance for {bad}", place="`covariance`", cure="Leave it out.")
    units = tuple("{force}" if name in _FORCES else "" for name in names)
    unit = np.where(logs, 1.0, size)
    inverse = inverse_information(relative) / np.outer(unit, unit)
    return Information(tuple(names), units, tuple(logs.tolist()), value, unit, inverse[None])


_FORCES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", MOTOR.name)


def _check(matrix: Float[np.ndarray, "p p"]) -> None:
    """Check that a matrix of variances or of information is finite, symmetric and without a negative direction."""
    cure = "Give the matrix of `fisher_information`, or the covariance of a fit that converged."
    if not np.all(np.isfinite(matrix)):
        raise InputError("the matrix is not finite", place="`information`", cure=cure)
    _, scaled = scaled_to_ones(matrix)
    if np.max(np.abs(scaled - scaled.T)) > 1e-8 or np.min(np.linalg.eigvalsh(scaled)) < -1e-8:
        raise InputError(
            "the matrix is not symmetric, or has a negative direction", place="`information`", cure=cure
        )
