"""Windows, and the equivalent number of independent averages of overlapping segments."""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError

WindowName = Literal["hann", "hamming", "blackman", "boxcar"]

_COSINES = {"hann": (0.5, 0.5), "hamming": (0.54, 0.46), "blackman": (0.42, 0.5, 0.08), "boxcar": (1.0,)}


def window_values(window: WindowName | str | np.ndarray, segment: int) -> Float[np.ndarray, " segment"]:
    """A periodic window `w_k = sum_i (-1)^i a_i cos(2 pi i k / segment)`.

    **Arguments:**

    - `window`: its name (Hann has `a = (1/2, 1/2)`), or its own values.
    - `segment`: its length.

    **Returns:** its values, shape `(segment,)`.

    **Raises:** `InputError` for an unknown name or values of another length.
    """
    if isinstance(window, str):
        if window not in _COSINES:
            raise InputError(
                f"`window` is {window!r}", cure=f"Choose one of {', '.join(_COSINES)}, or give its values."
            )
        angle = 2.0 * np.pi * np.arange(segment) / segment
        return np.sum([(-1) ** i * a * np.cos(i * angle) for i, a in enumerate(_COSINES[window])], axis=0)
    values = np.asarray(window, float)
    if values.shape != (segment,) or not np.any(values):
        raise InputError(
            f"`window` has the shape {values.shape} and `segment` is {segment}",
            cure="Give one value for each sample of a segment, not all of them zero.",
        )
    return values


class Averaging(NamedTuple):
    """How an average over `segments` overlapping segments compares with one over independent numbers.

    **Attributes:**

    - `segments`: number of segments.
    - `effective`: number of independent segments that would leave the same variance in one bin.
    - `bin_correlation`: number of neighbouring bins with the information of one independent bin.
    """

    segments: int
    effective: float
    bin_correlation: float


def averaging(w: Float[np.ndarray, " segment"], step: int, segments: int) -> Averaging:
    """Effective averages and bins for segments that start `step` samples apart.

    Welch (1967): the variance of the average of `K` overlapping segments is `1 / K_eff` of that of one, with
    `K / K_eff = 1 + 2 sum_j (1 - j / K) rho_j`, `rho_j = (sum_k w_k w_(k + j step))^2 / (sum_k w_k^2)^2`.

    A window also correlates neighbouring bins. By Parseval, the variance of a sum over many bins of an average is
    `1 / K` times `1 + 2 sum_j (1 - j / K) r_j / r_0` times `r_0` of what independent bins would have, with
    `r_j = segment sum_k w_k^2 w_(k + j step)^2 / (sum_k w_k^2)^2`; for Hann `r_0 = 35 / 18`.

    **Arguments:**

    - `w`: the window, shape `(segment,)`.
    - `step`: samples from the start of a segment to that of the next.
    - `segments`: number of segments, `K` above.

    **Returns:** the `Averaging`.
    """
    energy = np.sum(w**2)
    one_bin, many_bins = 1.0, w.size * np.sum(w**4) / energy**2
    for j in range(1, min(segments, -(-w.size // step))):
        early, late = w[: w.size - j * step], w[j * step :]
        share = 2.0 * (1.0 - j / segments)
        one_bin += share * (np.sum(early * late) / energy) ** 2
        many_bins += share * w.size * np.sum((early * late) ** 2) / energy**2
    return Averaging(segments, float(segments / one_bin), float(many_bins / one_bin))
