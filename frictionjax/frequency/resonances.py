"""Resonance and antiresonance of a machine's structure, from a frequency response."""

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, Complex, Float

from frictionjax.core import InputError

REACH = 3  # lines on either side of an extremum that the local fit uses


class Resonances(eqx.Module):
    """The strongest resonance and antiresonance of a response in a band.

    **Attributes:**

    - `resonance`: natural frequency of the pole pair at the strongest peak, Hz; None where the band has no peak.
    - `antiresonance`: natural frequency of the zero pair at the deepest dip, Hz; None where it has no dip.
    - `resonance_damping`: damping ratio of the pole pair.
    - `antiresonance_damping`: damping ratio of the zero pair; negative where the zeros are not of minimum phase.
    """

    resonance: float | None = eqx.field(static=True)
    antiresonance: float | None = eqx.field(static=True)
    resonance_damping: float | None = eqx.field(static=True)
    antiresonance_damping: float | None = eqx.field(static=True)


def resonances(
    frequency: ArrayLike, response: ArrayLike, *, band: tuple[float, float] | None = None
) -> Resonances:
    """Resonance and antiresonance of a measured response.

    The peak with the greatest prominence (by how many decibels it stands above the higher of the saddles beside it)
    is the resonance, and so for dips. Between the lines, `(b0 + b1 s + b2 s^2) / (1 + a1 s + a2 s^2)` is fitted to
    the lines next to it: `1 / (2 pi sqrt(a2))` is the resonance, `sqrt(b0 / b2) / (2 pi)` the antiresonance.

    **Arguments:**

    - `frequency`: Hz, ascending, shape `(n,)`.
    - `response`: output unit per input unit there, shape `(n,)`; of an `FRF` or a `BLA`.
    - `band`: lowest and highest frequency to use, Hz; None: all.

    **Returns:** the `Resonances`.

    **Raises:** `InputError` when the shapes differ, the band holds fewer than five lines with a response, or neither a
        peak nor a dip.
    """
    f, G = np.asarray(frequency, float), np.asarray(response, complex)
    if f.ndim != 1 or f.shape != G.shape:
        raise InputError(
            f"`frequency` has the shape {f.shape} and `response` the shape {G.shape}",
            cure="Give one response, of the shape (n,), at the frequencies of the shape (n,).",
        )
    low, high = band if band is not None else (-np.inf, np.inf)
    inside = (f >= low) & (f <= high) & np.isfinite(G) & (G != 0.0)
    f, G = f[inside], G[inside]
    if f.size < 5:
        raise InputError(
            f"`band` from {low} to {high} Hz holds {f.size} lines with a response",
            cure="Widen it to five or more.",
        )
    size = np.log(np.abs(G))
    peak, dip = _extremum(size), _extremum(-size)
    if peak is None and dip is None:
        raise InputError(
            f"the response has neither a peak nor a dip from {f[0]:.4g} to {f[-1]:.4g} Hz",
            cure="Widen `band` until both flanks of one lie inside.",
        )
    up, down = _natural(f, G, peak), _natural(f, 1.0 / G, dip)
    return Resonances(up[0], down[0], up[1], down[1])


def _extremum(size: Float[np.ndarray, " n"]) -> int | None:
    """The inner maximum of greatest prominence."""
    best, prominence = None, 0.0
    for i in range(1, size.size - 1):
        if size[i] < size[i - 1] or size[i] <= size[i + 1]:
            continue
        sides = []
        for flank in (size[:i][::-1], size[i + 1 :]):
            higher = np.flatnonzero(flank > size[i])
            sides.append(np.min(flank[: higher[0]] if higher.size else flank))
        if size[i] - max(sides) > prominence:
            best, prominence = i, size[i] - max(sides)
    return best


def _natural(
    f: Float[np.ndarray, " n"], G: Complex[np.ndarray, " n"], place: int | None
) -> tuple[float | None, float | None]:
    """Natural frequency, Hz, and damping ratio of the poles of `G` next to the line at `place`."""
    if place is None:
        return None, None
    near = slice(max(0, place - REACH), place + REACH + 1)
    s, G = 1j * f[near] / f[place], G[near] / np.abs(G[place])
    weight = np.ones(s.size)
    for _ in range(20):
        # Linear least squares of (b0 + b1 s + b2 s^2) - G (a1 s + a2 s^2) = G, weighted as Sanathanan and Koerner.
        rows = np.stack([s**0, s, s**2, -G * s, -G * s**2], axis=1) * weight[:, None]
        left, right = (
            np.vstack([rows.real, rows.imag]),
            np.concatenate([(weight * G).real, (weight * G).imag]),
        )
        a1, a2 = np.linalg.lstsq(left, right, rcond=None)[0][3:]
        weight = 1.0 / np.maximum(np.abs(1.0 + a1 * s + a2 * s**2), 1e-9)
        weight /= weight.max()
    found = f[place] / np.sqrt(a2) if a2 > 0.0 else np.nan
    if not f[max(place - 2, 0)] <= found <= f[min(place + 2, f.size - 1)]:
        return float(
            f[place]
        ), None  # no pole pair next to the line: it is noise; return the line's own frequency
    return float(found), float(0.5 * a1 / np.sqrt(a2))
