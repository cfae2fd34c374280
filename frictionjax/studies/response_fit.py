"""The second-order system from a frequency response, two ways, written so that `jax.vmap` runs it over many draws."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from frictionjax.frequency import FRF
from frictionjax.frequency.sanathanan_koerner import FREEDOM
from frictionjax.frequency.second_order import Lines, denominator, sampled_response, sensitivity, start
from frictionjax.frequency.windows import averaging, window_values
from frictionjax.studies.gauss_newton import ENOUGH, inverse, step

SK_STEPS = 12
ML_STEPS = 10


class ResponseFit(NamedTuple):
    """A fit of `1 / (J s^2 + damping s + stiffness)`.

    **Attributes:**

    - `values`: J, stiffness and damping, shape `(3,)`.
    - `stderr`: their standard errors, shape `(3,)`.
    - `converged`: whether the last step was below a small part of the standard errors.
    """

    values: Float[Array, " 3"]
    stderr: Float[Array, " 3"]
    converged: Bool[Array, ""]


class Band(NamedTuple):
    """The bins from `low` to `high`, Hz, of responses averaged over `segments` Hann segments, half overlapped.

    Each of `segment` samples at `sample_rate`, Hz.
    """

    low: float
    high: float
    segment: int
    segments: int
    sample_rate: float


def fit_response(frf: FRF, band: Band) -> tuple[ResponseFit, ResponseFit]:
    """Fit `frf` on `band` by the iteration of Sanathanan and Koerner, and by maximum likelihood.

    Both weigh each bin by one over its variance, taken from the coherence and smoothed over neighbours. Sanathanan and
    Koerner solve `|D_before|^-1 (H D - 1) = 0` for the next denominator `D` until it stays; maximum likelihood takes
    the steps of Gauss and Newton on `H - 1 / D` from there.
    """
    lines, scale, wider, freedom = _lines(frf, band)

    def koerner(a: Float[Array, " 4"], _: None) -> tuple[Float[Array, " 4"], Float[Array, " 4"]]:
        D = denominator(a, lines.omega)
        # `start` weighs by |H| what is to be weighed by one over the last denominator.
        weight = lines.weight / jnp.maximum(jnp.abs(D * lines.response), 1e-12)
        new = start(lines._replace(weight=weight), jnp.zeros(()), True)
        return new, new - a

    first = start(lines, jnp.zeros(()), True)
    a, moves = jax.lax.scan(koerner, first, None, length=SK_STEPS)
    cost, normal, _ = _evaluate(a[:3], lines)
    length = moves[-1, :3] @ normal @ moves[-1, :3]
    sk = _read(a[:3], cost, normal, scale, wider, freedom, lines, length)
    # In parts of what Sanathanan and Koerner found, so that a step of 0.5 is a long one.
    unit = jnp.where(jnp.abs(a[:3]) > 1e-9, a[:3], 1e-9)

    def newton(part: Float[Array, " 3"], _: None) -> tuple[Float[Array, " 3"], None]:
        normal, gradient = _evaluate(part, lines)[1:]
        return part + unit * step(normal * unit[:, None] * unit[None, :], gradient * unit), None

    part, _ = jax.lax.scan(newton, a[:3], None, length=ML_STEPS)
    cost, normal, gradient = _evaluate(part, lines)
    left = gradient @ inverse(normal) @ gradient
    return sk, _read(part, cost, normal, scale, wider, freedom, lines, left)


def _lines(frf: FRF, band: Band) -> tuple[Lines, Float[Array, " 3"], float, float]:
    frequency = np.arange(band.segment // 2 + 1) * (band.sample_rate / band.segment)
    bins = np.flatnonzero((frequency >= band.low) & (frequency <= band.high))
    hop = band.segment - band.segment // 2
    average = averaging(window_values("hann", band.segment), hop, band.segments)
    # As `fit_sk` does: so many neighbours share their variance that it rests on enough degrees of freedom.
    own = 2.0 * max(average.effective - 1.0, 0.5)
    half = min(int(np.ceil((FREEDOM * average.bin_correlation / own - 1.0) / 2.0)), (bins.size - 1) // 2)
    near = np.abs(np.arange(bins.size)[:, None] - np.arange(bins.size)[None, :]) <= half
    freedom = max(own * max(1.0, (2 * half + 1) / average.bin_correlation), 6.0)
    variance = jnp.asarray(near / near.sum(axis=1, keepdims=True)) @ frf.std[bins] ** 2
    response = frf.response[bins]
    size = jnp.max(jnp.abs(response))
    unit = 2.0 * np.pi * frequency[bins[-1]]
    lines = Lines(
        jnp.asarray(2.0 * np.pi * frequency[bins] / unit),
        response / jax.lax.complex(size, jnp.zeros_like(size)),
        size / jnp.sqrt(variance + (1e-9 * size) ** 2),
        jnp.asarray(2.0 * np.pi * band.sample_rate / unit),
    )
    scale = 1.0 / (size * jnp.asarray(unit ** np.arange(3.0)))
    return lines, scale, average.bin_correlation / (1.0 - 4.0 / freedom), freedom


def _evaluate(
    part: Float[Array, " 3"], lines: Lines
) -> tuple[Float[Array, ""], Float[Array, "3 3"], Float[Array, " 3"]]:
    a = jnp.append(part, 0.0)
    columns = sensitivity(a, lines, True, False)
    weight = jax.lax.complex(lines.weight, jnp.zeros_like(lines.weight))
    miss = weight * (lines.response - sampled_response(a, lines, True))
    normal = jnp.real(jnp.conj(columns).T @ columns)
    return jnp.sum(jnp.abs(miss) ** 2), normal, jnp.real(jnp.conj(columns).T @ miss)


def _read(
    part: Float[Array, " 3"],
    cost: Float[Array, ""],
    normal: Float[Array, "3 3"],
    scale: Float[Array, " 3"],
    wider: float,
    freedom: float,
    lines: Lines,
    left: Float[Array, ""],
) -> ResponseFit:
    excess = jnp.maximum(1.0, (1.0 - 2.0 / freedom) * cost / (2 * lines.omega.size - 3))
    stderr = scale * jnp.sqrt(wider * excess * jnp.diagonal(inverse(normal)))
    order = np.array([2, 0, 1])
    return ResponseFit((scale * part)[order], stderr[order], left < ENOUGH * excess)
