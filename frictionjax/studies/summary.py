"""What a Monte Carlo study says: bias, scatter, coverage, power, each with its Monte Carlo standard error.

Formulas: T. P. Morris, I. R. White, M. J. Crowther, "Using simulation studies to evaluate statistical methods",
Statistics in Medicine 38 (2019) 2074-2102, table 6.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from frictionjax.core import InputError
from frictionjax.core.frames import is_dataset, to_xarray

STDERR, TRUE, MCSE = "_stderr", "_true", "_mcse"
"""How the names of standard errors, of true values, and of Monte Carlo standard errors end."""

_With = dict[str, tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]]
"""Name of a statistic -> its values and their Monte Carlo standard errors, shape `(cells,)` each."""


def summarise(
    dataset: Any,
    *,
    over: str | Sequence[str] = "repeat",
    truth: Mapping[str, Any] | None = None,
    quantiles: Sequence[float] = (0.05, 0.5, 0.95),
    level: float = 0.95,
    keep_failed: bool = False,
) -> Any:
    """Summarise the results of a study over its repeats.

    Of each number `NAME` there are `NAME_mean`, `NAME_std` and `NAME_quantile`. Where its true value is known, also
    `NAME_bias` and `NAME_rmse`; where `NAME_stderr` is a result, too, `NAME_coverage`: how often an interval of normal
    theory covers the truth. Of each boolean, `NAME_rate`, such as the power of a test. Each has its Monte Carlo
    standard error beside it, as `NAME_bias_mcse` and so on. `count` is the number of cases behind them.

    **Arguments:**

    - `dataset`: what `run_study` returns.
    - `over`: dimension, or dimensions, that the cases are summarised over: `"repeat"`, or `"case"`.
    - `truth`: name of a result -> its true value: a number, or the name of a coordinate or of another result. Results
        `NAME_true` are used unasked.
    - `quantiles`: which quantiles, in [0, 1].
    - `level`: of the intervals whose coverage is counted.
    - `keep_failed`: whether the numbers of failed cases count; `failed_rate` does not depend on it.

    **Returns:** an xarray `Dataset` over the other dimensions, and `quantile`.

    **Raises:** `InputError` where a dimension or a result is not there, or a level is not in (0, 1).
    """
    over = (over,) if isinstance(over, str) else tuple(over)
    truth = dict(truth or {})
    _check(dataset, over, truth, quantiles, level)
    rows = _Rows(dataset, over, keep_failed)
    names = [str(name) for name in dataset.data_vars if set(over) <= set(dataset[name].dims)]
    beside = {f"{name}{end}" for name in names for end in (STDERR, TRUE)}
    arrays: dict[str, tuple[tuple[str, ...], Any]] = {}
    units: dict[str, str] = {}
    for name in names:
        kind = dataset[name].dtype.kind
        if kind not in "fib" or name in beside:
            continue
        dims, shape = rows.left(name)
        values, used = rows.of(name), rows.used(name)
        if kind == "b":
            found = {"rate": _rate(values, used)}
        else:
            true = truth.get(name, f"{name}{TRUE}" if f"{name}{TRUE}" in dataset else None)
            found = _scatter(values, used) | _against(
                rows, name, true, float(scipy.stats.norm.ppf(0.5 + level / 2.0))
            )
        unit = str(dataset[name].attrs.get("units", "1"))
        for statistic, pair in found.items():
            for label, part in zip((f"{name}_{statistic}", f"{name}_{statistic}{MCSE}"), pair, strict=True):
                arrays[label] = (dims, part.reshape(shape))
                units[label] = "1" if statistic in ("rate", "coverage") else unit
        if kind != "b":
            pair = _quantiles(values, used, np.asarray(quantiles, float))
            for label, part in zip((f"{name}_quantile", f"{name}_quantile{MCSE}"), pair, strict=True):
                arrays[label] = (("quantile", *dims), part.reshape(-1, *shape))
                units[label] = unit
    dims, shape = rows.left("failed")
    arrays["count"] = (dims, rows.used("failed", keep_failed).sum(axis=1).reshape(shape))
    needed = {dimension for dims, _ in arrays.values() for dimension in dims}
    places = {d: dataset[d].values for d in needed - {"quantile"} if d in dataset.coords}
    units |= {d: str(dataset[d].attrs["units"]) for d in places if "units" in dataset[d].attrs}
    levels = {"quantile": np.asarray(quantiles, float)} if "quantile" in needed else {}
    return to_xarray(arrays, places | levels, units, **dataset.attrs)


class _Rows:
    """The results in `dataset` as rows over the dimensions `over`, one for each cell of the others."""

    def __init__(self, dataset: Any, over: tuple[str, ...], keep_failed: bool) -> None:
        self.dataset, self._over, self._keep_failed = dataset, over, keep_failed

    def left(self, name: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """Names and lengths of the other dimensions of the result `name`."""
        dims = tuple(str(d) for d in self.dataset[name].dims if d not in self._over)
        return dims, tuple(self.dataset.sizes[d] for d in dims)

    def of(self, name: str, like: str | None = None) -> Float[np.ndarray, "cells n"]:
        """The result, or the coordinate, `name`, where it has fewer dimensions as often as the result `like`."""
        model = self.dataset[like or name]
        dims, shape = self.left(like or name)
        array = self.dataset[name].astype(float)
        whole = array if array.dims == model.dims else array.broadcast_like(model)
        return whole.transpose(*dims, *self._over).values.reshape(int(np.prod(shape)), -1)

    def used(self, name: str, everything: bool | None = None) -> Bool[np.ndarray, "cells n"]:
        """Which values of the result `name` count; `everything`: those of failed cases, too."""
        finite = np.isfinite(self.of(name))
        if everything is None:
            everything = self._keep_failed or name == "failed"
        return finite if everything else finite & (self.of("failed", like=name) == 0.0)


def _against(rows: _Rows, name: str, true: Any, normal: float) -> _With:
    """The result `name` against its `true` value; `normal`: half the width of an interval, in standard errors."""
    if true is None:
        return {}
    values, used = rows.of(name), rows.used(name)
    errors = values - (rows.of(true, like=name) if isinstance(true, str) else float(true))
    found = _error(errors, used & np.isfinite(errors))
    if f"{name}{STDERR}" in rows.dataset:
        spread = rows.of(f"{name}{STDERR}", like=name)
        inside = (np.abs(errors) <= normal * spread).astype(float)
        found["coverage"] = _rate(inside, used & ~np.isnan(spread) & np.isfinite(errors))
    return found


def _check(
    dataset: Any, over: tuple[str, ...], truth: dict[str, Any], quantiles: Sequence[float], level: float
) -> None:
    if not is_dataset(dataset) or "failed" not in dataset:
        raise InputError(
            f"a {type(dataset).__name__} is no result of a study",
            place="`dataset`",
            cure="Give what `run_study` or `load_study` returns",
        )
    if unknown := [dimension for dimension in over if dimension not in dataset.sizes]:
        raise InputError(
            f"there is no dimension `{unknown[0]}`",
            place="`over`",
            cure=f"Choose from: {', '.join(map(str, dataset.sizes))}",
        )
    for name, value in truth.items():
        for known in (name, value) if isinstance(value, str) else (name,):
            if known not in dataset:
                raise InputError(
                    f"there is no result `{known}`",
                    place="`truth`",
                    cure=f"Choose from: {', '.join(map(str, dataset.variables))}",
                )
    if not 0.0 < level < 1.0 or not all(0.0 <= one <= 1.0 for one in quantiles):
        raise InputError(
            f"`level` is {level} and `quantiles` are {tuple(quantiles)}", cure="Give parts of one"
        )


def _counts(used: Bool[np.ndarray, "cells n"]) -> Int[np.ndarray, " cells"]:
    return used.sum(axis=1)


def _mean(
    values: Float[np.ndarray, "cells n"], used: Bool[np.ndarray, "cells n"]
) -> tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]:
    """Mean, and the standard deviation of the values; NaN where there are too few."""
    n = _counts(used)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(used, values, 0.0).sum(axis=1) / np.where(n > 0, n, np.nan)
        squares = np.where(used, (values - mean[:, None]) ** 2, 0.0).sum(axis=1)
        return mean, np.sqrt(squares / np.where(n > 1, n - 1, np.nan))


def _scatter(values: Float[np.ndarray, "cells n"], used: Bool[np.ndarray, "cells n"]) -> _With:
    n = np.maximum(_counts(used), 1)
    mean, std = _mean(values, used)
    return {"mean": (mean, std / np.sqrt(n)), "std": (std, std / np.sqrt(2.0 * np.maximum(n - 1, 1)))}


def _error(errors: Float[np.ndarray, "cells n"], used: Bool[np.ndarray, "cells n"]) -> _With:
    n = np.maximum(_counts(used), 1)
    bias, std = _mean(errors, used)
    square, spread = _mean(errors**2, used)
    rmse = np.sqrt(square)
    # The error of the mean square, through the square root.
    with np.errstate(invalid="ignore", divide="ignore"):
        rmse_error = np.where(rmse > 0.0, spread / np.sqrt(n) / (2.0 * rmse), 0.0 * spread)
    return {"bias": (bias, std / np.sqrt(n)), "rmse": (rmse, rmse_error)}


def _rate(
    values: Float[np.ndarray, "cells n"], used: Bool[np.ndarray, "cells n"]
) -> tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]:
    rate = _mean(values, used)[0]
    return rate, np.sqrt(rate * (1.0 - rate) / np.maximum(_counts(used), 1))


def _quantiles(
    values: Float[np.ndarray, "cells n"], used: Bool[np.ndarray, "cells n"], parts: Float[np.ndarray, " q"]
) -> tuple[Float[np.ndarray, "q cells"], Float[np.ndarray, "q cells"]]:
    """Quantiles, and half the distance of those one binomial standard deviation above and below."""
    n = _counts(used)
    ordered = np.sort(np.where(used, values, np.inf), axis=1)

    def at(part: Float[np.ndarray, " cells"]) -> Float[np.ndarray, " cells"]:
        place = np.clip(part, 0.0, 1.0) * np.maximum(n - 1, 0)
        low = np.floor(place).astype(int)
        high = np.minimum(low + 1, np.maximum(n - 1, 0))
        first, second = (np.take_along_axis(ordered, k[:, None], axis=1)[:, 0] for k in (low, high))
        with np.errstate(invalid="ignore"):
            return np.where(
                n > 0, np.where(first == second, first, first + (place - low) * (second - first)), np.nan
            )

    found, errors = [], []
    for part in parts:
        step = np.sqrt(part * (1.0 - part) / np.maximum(n, 1))
        found.append(at(np.full(len(n), part)))
        errors.append((at(part + step) - at(part - step)) / 2.0)
    shape = (len(parts), len(n))
    return np.reshape(found, shape), np.reshape(errors, shape)
