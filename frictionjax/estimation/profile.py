"""Profile likelihood and parametric bootstrap: intervals beyond the standard error, by many refits side by side."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Key

from frictionjax.core import InputError, Progress, public_verb, reporting, require_x64
from frictionjax.core.arrays import Numbers
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid
from frictionjax.core.frames import to_dataframe, to_xarray
from frictionjax.estimation.constraints import Held
from frictionjax.estimation.descent.levenberg_marquardt import equal_curvature, levenberg_marquardt
from frictionjax.estimation.descent.round import NEAR_TOLERANCE, NEAR_UNITS
from frictionjax.estimation.evidence.base import AbstractMeasurement
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import part_of
from frictionjax.estimation.result import FitResult

_STEPS = 8  # of Levenberg-Marquardt in a refit from near by
_HELD = 1e-3  # standard errors: how closely a profiled parameter is held at its value
_LANES = 4  # refits side by side


class Profile(AbstractDisplayed):
    """The profile likelihood of one parameter.

    **Attributes:**

    - `name`, `value`, `stderr`: the parameter, its estimate and its standard error.
    - `values`: where it was held, in its unit, shape `(k,)`.
    - `deviance`: twice the cost with all others refitted, less that at the estimate, shape `(k,)`.
    - `unit`: of the parameter, as text.
    """

    name: str = eqx.field(static=True)
    value: float = eqx.field(static=True)
    stderr: float = eqx.field(static=True)
    values: Float[np.ndarray, " k"]
    deviance: Float[np.ndarray, " k"]
    unit: str = eqx.field(static=True, default="1")

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Likelihood interval of `level`: where the deviance passes the quantile of chi-square with one degree of
        freedom, by interpolation; infinite where it does not on that side."""
        limit = float(scipy.stats.chi2.ppf(level, 1))
        limits = []
        for side in (-1.0, 1.0):
            inside = (self.values - self.value) * side > 0.0
            order = np.argsort(np.abs(self.values[inside] - self.value))
            far = np.concatenate([[0.0], np.abs(self.values[inside] - self.value)[order]])
            height = np.maximum.accumulate(np.concatenate([[0.0], self.deviance[inside][order]]))
            reach = float(np.interp(np.sqrt(limit), np.sqrt(height), far)) if height[-1] > limit else np.inf
            limits.append(self.value + side * reach)
        return limits[0], limits[1]

    def _display(self) -> Display:
        low, high = self.interval()
        unit = "" if self.unit == "1" else f" {self.unit}"
        title = f"Profile likelihood of {self.name}: {self.value:.6g}, 95 % interval {low:.6g} to {high:.6g}{unit}"
        rows = tuple((f"{v:.6g}", f"{d:.4g}") for v, d in zip(self.values, self.deviance, strict=True))
        return Display(title, (), (TextGrid((self.name, "deviance"), rows),))

    def plot(self, **how: Any) -> Any:
        """Draw the deviance over the parameter, with the parabola of its standard error: `frictionjax.plot`, with `how`
        as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the columns `values` and `deviance`."""
        return to_dataframe({"values": self.values, "deviance": self.deviance})

    def to_xarray(self) -> Any:
        """An xarray Dataset with `deviance` over the values of the parameter, by its name; the estimate and its
        standard error are its attributes `value` and `stderr`."""
        return to_xarray(
            {"deviance": ((self.name,), self.deviance)},
            {self.name: self.values},
            {self.name: self.unit, "deviance": "1"},
            value=self.value,
            stderr=self.stderr,
        )


class Bootstrap(AbstractDisplayed):
    """Refits of data drawn from a fitted model.

    **Attributes:** `names` of the p parameters; `values` of the d refits in physical units, shape `(d, p)`; `estimate`
    that the data were drawn from, shape `(p,)`; `units` of the parameters, as text (empty where they are not known).
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, "d p"]
    estimate: Float[np.ndarray, " p"]
    units: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def stderr(self) -> dict[str, float]:
        """Name -> standard deviation of the refits."""
        return dict(zip(self.names, np.std(self.values, axis=0, ddof=1).tolist(), strict=True))

    @property
    def bias(self) -> dict[str, float]:
        """Name -> mean of the refits less the estimate."""
        return dict(zip(self.names, (np.mean(self.values, axis=0) - self.estimate).tolist(), strict=True))

    @property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance of the refits, shape `(p, p)`."""
        return np.atleast_2d(np.cov(self.values, rowvar=False))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Basic bootstrap interval of the parameter `name` (Davison and Hinkley, Bootstrap Methods, 1997, ch. 5): the
        quantiles of the refits at `level`, mirrored at the estimate."""
        place = self.names.index(name)
        low, high = np.quantile(self.values[:, place], [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
        return float(2.0 * self.estimate[place] - high), float(2.0 * self.estimate[place] - low)

    def _display(self) -> Display:
        rows = tuple(
            (name, f"{value:.6g}", f"{self.stderr[name]:.2g}", f"{self.bias[name]:.2g}")
            for name, value in zip(self.names, self.estimate, strict=True)
        )
        head = ("parameter", "estimate", "standard deviation", "bias")
        if self.units:
            shown = ("" if unit == "1" else unit for unit in self.units)
            head, rows = (*head, "unit"), tuple((*row, unit) for row, unit in zip(rows, shown, strict=True))
        return Display(f"Bootstrap of {self.values.shape[0]} refits", (), (TextGrid(head, rows),))

    def plot(self, **how: Any) -> Any:
        """Draw the refits of each parameter as a histogram, with the estimate and the basic 95 % interval:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a column for each parameter and a row for each refit."""
        units = dict(zip(self.names, self.units, strict=True)) if self.units else {}
        return to_dataframe({name: self.values[:, k] for k, name in enumerate(self.names)}, units)


def _needs(result: FitResult, verb: str) -> tuple[Posterior, Float[Numbers, " q"]]:
    if result.posterior is None or result.vector is None:
        raise InputError(
            f"`{verb}` needs the data of the fit, and a result that was read from a file has none",
            place="`result`",
            cure="Fit again, from the drive of this result.",
        )
    return result.posterior, result.vector


@eqx.filter_jit
def _held(
    posterior: Posterior, vector: Float[Numbers, " q"], means: Float[Numbers, " k"]
) -> tuple[Float[Numbers, " k"], Float[Numbers, " k"]]:
    """Cost, and value of the held parameter, with the last prior at each of `means` and all others refitted."""

    def one(mean: Float[Numbers, ""]) -> tuple[Float[Numbers, ""], Float[Numbers, ""]]:
        there = eqx.tree_at(lambda p: p.constraints.beliefs[-1].mean, posterior, mean)
        end = levenberg_marquardt(
            there,
            vector,
            NEAR_UNITS * equal_curvature(there, vector),
            _STEPS,
            tolerance=NEAR_TOLERANCE,
        )
        own = there.constraints.beliefs[-1]
        value = own.value(there.drive_of(end.vector))
        return end.cost - 0.5 * ((value - own.mean) / own.std) ** 2, value

    return jax.lax.map(one, means, batch_size=_LANES)


def profile_likelihood(
    result: FitResult, name: str, *, values: Float[np.ndarray, " k"] | None = None
) -> Profile:
    """Profile likelihood of one parameter: its value held, all others refitted, the noise as in the fit.

    **Arguments:**

    - `result`: from `fit`.
    - `name`: label of a free parameter.
    - `values`: where to hold it; None: from -3 to 3 standard errors.

    **Returns:**

    A `Profile`.

    **Raises:**

    `InputError` when the result holds no data, the parameter was not free, or has no standard error and no `values`.
    """
    require_x64()
    posterior, vector = _needs(result, "profile_likelihood")
    if name not in result.names:
        raise InputError(
            f"`{name}` was not free in this fit",
            place="`name`",
            cure=f"Choose from {', '.join(result.names)}.",
        )
    place = result.names.index(name)
    estimate = result.parameters[name]
    spread = float(np.sqrt(result.covariance_white[place, place]))
    if values is None:
        if not np.isfinite(estimate.stderr):
            raise InputError(
                f"`{name}` has no standard error to set the range by", place="`values`", cure="Give `values`."
            )
        values = estimate.value + spread * np.array([-3.0, -2.0, -1.3, -0.7, 0.7, 1.3, 2.0, 3.0])
    layout = posterior.constraints.layout
    scale = spread if np.isfinite(spread) else float(np.ptp(values)) / len(values)
    chosen = jnp.zeros(len(layout)).at[place].set(1.0)
    belief = Held(tuple(free.path for free in layout), chosen, estimate.value, _HELD * scale)
    with_belief = eqx.tree_at(
        lambda p: p.constraints.beliefs,
        posterior,
        (*posterior.constraints.beliefs, belief),
        is_leaf=lambda leaf: isinstance(leaf, tuple),
    )
    means = jnp.asarray(np.concatenate([[estimate.value], np.asarray(values, dtype=float)]))
    costs, reached = (np.asarray(a) for a in _held(with_belief, vector, means))
    deviance = 2.0 * (costs[1:] - min(costs[0], float(np.min(costs))))
    return Profile(name, estimate.value, estimate.stderr, reached[1:], deviance, estimate.unit)


@eqx.filter_jit
def _redrawn(
    posterior: Posterior, vector: Float[Numbers, " q"], unit: Float[Numbers, " q"], keys: Key[Array, " d"]
) -> Float[Numbers, "d p"]:
    drive = posterior.drive_of(vector)

    def one(key: Key[Array, ""]) -> Float[Numbers, " p"]:
        drawn = []
        for index, evidence in enumerate(posterior.evidence):
            if not isinstance(evidence, AbstractMeasurement):
                raise TypeError("Only data with a noise model can be drawn.")
            own = jax.random.fold_in(key, index)
            drawn.append(evidence.replica(drive, posterior.deflections_of(vector, index), own))
        there = eqx.tree_at(lambda p: p.evidence, posterior, tuple(drawn))
        end = levenberg_marquardt(there, vector, unit, _STEPS, tolerance=NEAR_TOLERANCE)
        found = there.drive_of(end.vector)
        return jnp.stack([part_of(found, free.path) for free in posterior.constraints.layout])

    return jax.lax.map(one, keys, batch_size=_LANES)


def bootstrap(
    result: FitResult, draws: int, key: Key[Array, ""], *, piece: int = 64, progress: Progress | bool = True
) -> Bootstrap:
    """Parametric bootstrap: data drawn from the fitted model and its noise, and fitted again.

    Noise levels stay as in the fit; the position is not quantised again.

    **Arguments:**

    - `result`: from `fit`.
    - `draws`: how many.
    - `key`: for the noise.
    - `piece`: so many at a time, for the progress.
    - `progress`: called as pieces are done; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    A `Bootstrap`.

    **Raises:**

    `InputError` when the result holds no data, or `draws` is below 2.
    """
    require_x64()
    posterior, vector = _needs(result, "bootstrap")
    if draws < 2:
        raise InputError(f"`draws` is {draws}", place="`draws`", cure="Two are the least; 200 are usual.")
    if not all(isinstance(one, AbstractMeasurement) for one in posterior.evidence):
        raise InputError(
            "the data of this fit have no noise model", place="`result`", cure="Give one from `fit`."
        )
    unit = NEAR_UNITS * equal_curvature(posterior, vector)
    keys = jax.random.split(key, draws)
    piece = min(piece, draws)
    found = []
    with reporting(progress) as report:
        for first in range(0, draws, piece):
            taken = np.minimum(np.arange(first, first + piece), draws - 1)
            some = np.asarray(_redrawn(posterior, vector, unit, keys[taken]))
            found.append(some[: min(piece, draws - first)])
            report("bootstrap", min(first + piece, draws) / draws)
    own = [result.parameters[name] for name in result.names]
    estimate, units = np.array([one.value for one in own]), tuple(one.unit for one in own)
    return Bootstrap(result.names, np.concatenate(found), estimate, units)
