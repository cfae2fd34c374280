"""Four estimators of the parameters of LuGre friction, compared by Monte Carlo with the Cramer-Rao bound."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core import InputError, Progress, public_verb, reporting, require_x64
from frictionjax.core.display import AbstractDisplayed, Display, records_grid
from frictionjax.core.frames import records, to_dataframe
from frictionjax.studies.estimator_draws import (
    bounds,
    draw,
    in_parts,
    jointly,
    part_width,
    reported,
    respond,
    slowly,
)
from frictionjax.studies.estimator_words import Findings, sentences
from frictionjax.studies.level_sweep import table_one
from frictionjax.studies.lugre_fit import theta_of

ESTIMATORS = ("sk", "frf_ml", "breakaway", "joint")
PARAMETERS = ("J", "sigma0", "sigma1+sigma2", "sigma2", "Fc", "Fs", "vs")
UNITS = ("N*s^2/m", "N/m", "N*s/m", "N*s/m", "N", "N", "m/s")
LEVELS = (1e-4, 1e-3, 1e-2, 1e-1)
"""Noise of the position over the deflection at break-away, Fs / sigma0."""

EXCITATION = 0.1  # rms of the noise experiment over break-away
WIDTH = 128  # draws computed at a time
NORMAL_95 = 1.96


class EstimatorComparison(AbstractDisplayed):
    """The estimates of each estimator on the same draws.

    Arrays have the axes estimator, noise level, draw, parameter, in the order of `estimators` and `parameters`.

    **Attributes:**

    - `estimators`: `"sk"` (Sanathanan-Koerner on the frequency response), `"frf_ml"` (maximum likelihood on it),
        `"breakaway"` (least squares of the full LuGre drive on a ramp), `"joint"` (on the ramp and the noise together).
    - `parameters`, `units`: what is estimated; `sigma1+sigma2` is the damping that presliding shows.
    - `noise`: standard deviation of the position's noise at each level, position units, shape `(k,)`.
    - `truth`: shape `(7,)`.
    - `estimates`, `stderr`: with their standard errors, shape `(4, k, draws, 7)`; NaN where an estimator gives none.
    - `converged`: shape `(4, k, draws)`; statistics are over these draws.
    - `bound`: Cramer-Rao bound of the standard deviation, mean over inputs, shape `(4, k, 7)`: of the same records;
        for the first two, of the noise record with the levels of friction and sigma2 known.
    - `seconds`: running time of all draws, by estimator, s; that of the frequency responses is in both of theirs.
    - `excitation`: rms of the noise experiment over break-away.
    """

    estimators: tuple[str, ...] = eqx.field(static=True)
    parameters: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    noise: Float[np.ndarray, " k"]
    truth: Float[np.ndarray, " p"]
    estimates: Float[np.ndarray, "e k draws p"]
    stderr: Float[np.ndarray, "e k draws p"]
    converged: Bool[np.ndarray, "e k draws"]
    bound: Float[np.ndarray, "e k p"]
    seconds: Mapping[str, float] = eqx.field(static=True)
    excitation: float = eqx.field(static=True)

    def _display(self) -> Display:
        return Display("Comparison of estimators", self.sentences, (records_grid(self.table()),))

    def plot(self, **how: Any) -> Any:
        """Draw the scatter of each estimator over the Cramer-Rao bound: `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the rows of `table`."""
        return to_dataframe(records(self.table()))

    @property
    def bias(self) -> Float[np.ndarray, "e k p"]:
        """Mean error, shape `(4, k, 7)`, in the units of the parameters."""
        return self._over(np.nanmean, self._errors)

    @property
    def std(self) -> Float[np.ndarray, "e k p"]:
        """Standard deviation of the estimates, shape `(4, k, 7)`, in the units of the parameters."""
        return self._over(lambda part, axis: np.asarray(np.nanstd(part, axis=axis, ddof=1)), self._errors)

    @property
    def coverage(self) -> Float[np.ndarray, "e k p"]:
        """Part of the draws whose 95 % interval, 1.96 standard errors to each side, covers the truth, `(4, k, 7)`."""
        inside = np.where(np.isfinite(self._errors), np.abs(self._errors) <= NORMAL_95 * self.stderr, np.nan)
        return self._over(np.nanmean, inside)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The table: see `table`."""
        return self.table()

    def table(self) -> list[dict[str, Any]]:
        """One row for each estimator, noise level and parameter that it gives; numbers are finite or None.

        `bias`, `std` and `crlb` (as a standard deviation) in `unit`; `bias_stderr` is the Monte Carlo error of the
        bias, `ratio` is `std` over `crlb`, `converged` the part of the draws in which the estimator converged, and
        `identified` whether the bound is below half of the value.
        """
        bias, std, coverage = self.bias, self.std, self.coverage
        return [
            {
                "estimator": estimator,
                "noise": float(noise),
                "parameter": parameter,
                "unit": self.units[p],
                "truth": float(self.truth[p]),
                "bias": _number(bias[e, k, p]),
                "bias_stderr": _number(std[e, k, p] / np.sqrt(max(self.converged[e, k].sum(), 1))),
                "std": _number(std[e, k, p]),
                "crlb": _number(self.bound[e, k, p]),
                "ratio": _number(std[e, k, p] / self.bound[e, k, p]),
                "coverage": _number(coverage[e, k, p]),
                "converged": float(np.mean(self.converged[e, k])),
                "identified": bool(self.bound[e, k, p] < 0.5 * self.truth[p]),
            }
            for e, estimator in enumerate(self.estimators)
            for k, noise in enumerate(self.noise)
            for p, parameter in enumerate(self.parameters)
            if np.isfinite(self.bound[e, k, p])
        ]

    @property
    def sentences(self) -> tuple[str, str, str]:
        """Three sentences, made from the numbers, on which estimator to use when."""
        deflection = float(self.truth[5] / self.truth[1])
        draws = self.converged.shape[1] * self.converged.shape[2]
        return sentences(
            Findings(
                noise=self.noise / deflection,
                bias=self.bias / self.truth,
                std=self.std / self.truth,
                bound=self.bound / self.truth,
                coverage=self.coverage,
                converged=np.mean(self.converged, axis=2),
                milliseconds=np.array([1e3 * self.seconds[name] / draws for name in self.estimators]),
                excitation=self.excitation,
            )
        )

    @property
    def _errors(self) -> Float[np.ndarray, "e k draws p"]:
        return np.where(self.converged[..., None], self.estimates - self.truth, np.nan)

    def _over(
        self, statistic: Callable[..., Float[np.ndarray, "e k p"]], values: Float[np.ndarray, "e k draws p"]
    ) -> Float[np.ndarray, "e k p"]:
        """`statistic` over the draws; NaN where there are too few."""
        enough = np.sum(np.isfinite(values), axis=2) > 1
        safe = np.where(enough[:, :, None, :], values, 0.0)
        return np.where(enough, statistic(safe, axis=2), np.nan)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def compare_estimators(
    *,
    draws: int = 500,
    levels: Sequence[float] = LEVELS,
    excitation: float = EXCITATION,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | bool = True,
) -> EstimatorComparison:
    """Compare Sanathanan-Koerner, maximum likelihood on the response, break-away data, and all data together.

    The machine of Table I answers to a binary noise below break-away (2 s at 2 kHz, new in each draw) and breaks away
    under a ramp to twice the static friction (1 s at 1 kHz). White noise is added to both positions; its variance is
    estimated in each draw from the data alone. The two estimators on the frequency response (7 Hann segments of 1024,
    3 to 150 Hz) need no friction model and no start. The two in the time domain start within 10 % of the truth, and
    the last where the third ended. Data and model share one integration scheme: its
    discretisation error is not part of the comparison.

    **Arguments:**

    - `draws`: Monte Carlo draws at each level, at least two.
    - `levels`: standard deviations of the noise over the deflection at break-away, `Fs / sigma0`, shape `(k,)`.
    - `excitation`: rms of the noise experiment over the static friction.
    - `seed`: of the random numbers.
    - `executor`: threads that share the work, such as `ThreadPoolExecutor(2)`.
    - `progress`: called as parts of the work are finished; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:** the `EstimatorComparison`.

    **Raises:** `InputError` for fewer than two draws, or levels that are not positive; `PrecisionError` when JAX
        computes in float32.
    """
    require_x64()
    scale = np.asarray(levels, float)
    if draws < 2 or scale.ndim != 1 or scale.size == 0 or not np.all(scale > 0.0) or not excitation > 0.0:
        raise InputError(
            f"`draws` is {draws}, `levels` are {levels} and `excitation` is {excitation}",
            cure="Give two draws or more, one positive level or more, and a positive excitation.",
        )
    drive = table_one()
    theta = theta_of(drive)
    noise = scale * float(drive.friction.Fs / drive.friction.sigma0)
    force = jnp.asarray(excitation) * drive.friction.Fs
    # The same inputs, starts and noise (but for its size) at every level: levels differ by their noise alone.
    keys = jnp.tile(jax.random.split(jax.random.key(seed), draws), scale.size)
    sigma = jnp.repeat(jnp.asarray(noise), draws)

    with reporting(progress) as report:

        def stage(
            name: str, function: Callable[[Any], Any], lanes: Any, begin: float, end: float
        ) -> tuple[Any, float]:
            return in_parts(
                function, lanes, WIDTH, executor, lambda part: report(name, begin + (end - begin) * part)
            )

        data, _ = stage("draws", lambda lanes: draw(theta, force, *lanes), (keys, sigma), 0.0, 0.05)
        (sk, ml), response_seconds = stage("response", respond, data, 0.05, 0.15)
        (slow, found), slow_seconds = stage("breakaway", lambda lanes: slowly(theta, lanes), data, 0.15, 0.5)
        (both, _), both_seconds = stage(
            "joint", lambda lanes: jointly(theta, lanes), data | {"found": found}, 0.5, 0.97
        )
    few = jax.tree.map(lambda leaf: leaf[: part_width(len(sigma), WIDTH)], data)
    unit_bound = np.sqrt(bounds(theta, few))[np.array([0, 0, 1, 2])]
    unit_bound[:2, 3:] = np.nan

    shape = (scale.size, draws)
    fits = (sk, ml, slow, both)
    return EstimatorComparison(
        estimators=ESTIMATORS,
        parameters=PARAMETERS,
        units=UNITS,
        noise=noise,
        truth=np.asarray(reported(theta)),
        estimates=np.stack([fit.values.reshape(*shape, -1) for fit in fits]),
        stderr=np.stack([fit.stderr.reshape(*shape, -1) for fit in fits]),
        converged=np.stack(
            [(fit.converged & np.all(np.isfinite(fit.stderr[:, :3]), axis=1)).reshape(shape) for fit in fits]
        ),
        bound=unit_bound[:, None, :] * noise[None, :, None],
        seconds=dict(
            zip(ESTIMATORS, (response_seconds, response_seconds, slow_seconds, both_seconds), strict=True)
        ),
        excitation=excitation,
    )
