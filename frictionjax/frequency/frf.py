"""Frequency response of a machine from noise, as in the paper's Section IV."""

from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Complex, Float

from frictionjax.core import InputError, public_verb, require_x64
from frictionjax.core.display import SIGNALS, AbstractDisplayed, Display, TextGrid, signal_row, value_text
from frictionjax.core.frames import to_dataframe, to_xarray
from frictionjax.frequency.windows import WindowName, averaging, window_values


class FRF(AbstractDisplayed):
    """A measured frequency response function.

    **Attributes:**

    - `frequency`: Hz, shape `(nf,)`.
    - `response`: output unit per input unit, shape `(nf,)`; zero where the input has no power.
    - `coherence`: part of the output's power that the input explains linearly, in [0, 1], shape `(nf,)`.
    - `std`: standard deviation of the magnitude of `response`, absolute, in its unit, shape `(nf,)`; that of its real
        and of its imaginary part too. Infinite where the input has no power.
    - `averages_effective`: equivalent number of independent segments in the average, shape `()`.
    - `sample_rate`: samples per second, Hz, shape `()`.
    - `bin_correlation`: how many neighbouring bins have the information of one independent number, shape `()`;
        1 for bins that are independent.
    """

    frequency: Float[Array, "*batch nf"]
    response: Complex[Array, "*batch nf"]
    coherence: Float[Array, "*batch nf"]
    std: Float[Array, "*batch nf"]
    averages_effective: Float[Array, "*batch"]
    sample_rate: Float[Array, "*batch"]
    bin_correlation: Float[Array, "*batch"]

    @property
    def phase_std(self) -> Float[Array, "*batch nf"]:
        """Standard deviation of the phase of `response`, rad, shape `(nf,)`.

        `std / |response|`, for a small one; infinite where there is no response.
        """
        size = jnp.abs(self.response)
        return jnp.where(size > 0.0, self.std / jnp.where(size > 0.0, size, 1.0), jnp.inf)

    def _display(self) -> Display:
        title = (
            f"FRF of {self.frequency.shape[-1]} frequencies, {value_text(self.averages_effective)} effective averages, "
            f"{value_text(self.sample_rate)} Hz"
        )
        ratio = "output/input"
        rows = [("frequency", self.frequency, "Hz"), ("|response|", jnp.abs(self.response), ratio)]
        rows += [("coherence", self.coherence, ""), ("std", self.std, ratio)]
        return Display(title, (), (TextGrid(SIGNALS, tuple(signal_row(*row) for row in rows)),))

    def plot(self, **how: Any) -> Any:
        """Draw magnitude, phase and coherence over frequency: `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame over `frequency` (Hz): `response` (complex), `magnitude`, `phase` (rad), `coherence`,
        `std`, `phase_std` (rad)."""
        return to_dataframe({"frequency": self.frequency, **self._columns()}, _UNITS, index="frequency")

    def to_xarray(self) -> Any:
        """An xarray Dataset over `frequency` (Hz), with the columns of `to_dataframe`."""
        arrays = {name: (("frequency",), values) for name, values in self._columns().items()}
        about = {"sample_rate": float(self.sample_rate), "averages_effective": float(self.averages_effective)}
        return to_xarray(arrays, {"frequency": self.frequency}, _UNITS, **about)

    def _columns(self) -> dict[str, Any]:
        return {
            "response": self.response,
            "magnitude": jnp.abs(self.response),
            "phase": jnp.unwrap(jnp.angle(self.response)),
            "coherence": self.coherence,
            "std": self.std,
            "phase_std": self.phase_std,
        }


_UNITS = {"frequency": "Hz", "phase": "rad", "phase_std": "rad", "coherence": "1"}


def estimate_frf(
    u: ArrayLike,
    x: ArrayLike,
    sample_rate: ArrayLike,
    *,
    segment: int = 8192,
    window: WindowName | str | np.ndarray = "hann",
    overlap: float = 0.5,
    detrend: Literal["constant", "linear", "none"] | str = "constant",
) -> FRF:
    """Frequency response from input `u` to output `x` by averaging windowed segments (Welch, H1).

    With `S_ab` the average of `conj(A) B` over the segments' Fourier transforms, the response is `S_ux / S_uu`, the
    coherence `|S_ux|^2 / (S_uu S_xx)`, and the standard deviation of the magnitude
    `|response| sqrt((1 - coherence) / (2 coherence (n - 1)))` (Bendat and Piersol, Random Data, 4th ed., ch. 9, who
    leave out that the response itself takes one degree of freedom), with `n` the effective number of averages:
    overlapping segments are not independent. Segments should be long against the time in which the machine's
    vibration dies: what a window cuts off it biases the response by its square, towards more damping. It
    also counts as noise: at high coherence the standard deviations are then too wide, never too narrow.

    What the input does not explain linearly counts as noise, be it the sensor's or friction's own. Close to zero
    frequency, a coherence that stays below 0.95 without measurement noise is a sign that friction is not linear at
    this level. In a closed loop the sensor's noise is fed back, and H1 is biased where it is strong.

    **Arguments:**

    - `u`: input, shape `(n,)`. `jax.vmap` runs over batches.
    - `x`: output, sampled at the same instants, shape `(n,)`.
    - `sample_rate`: samples per second, Hz.
    - `segment`: samples in a segment; the resolution is `sample_rate / segment`.
    - `window`: `"hann"`, `"hamming"`, `"blackman"`, `"boxcar"` (none), or its values, shape `(segment,)`.
    - `overlap`: part of a segment that it shares with the next, in [0, 1).
    - `detrend`: what is taken off each segment first: its mean, the line through it, or nothing.

    **Returns:** the `FRF`, with `nf = segment // 2 + 1` frequencies.

    **Raises:** `InputError` when `u` and `x` differ in length, hold values that are not finite, or are shorter than
        two segments; `PrecisionError` when JAX computes in float32.
    """
    require_x64()
    u, x = _checked("u", u), _checked("x", x)
    if u.shape != x.shape:
        raise InputError(
            f"`u` holds {u.size} samples and `x` holds {x.size}", cure="Cut both to the same instants."
        )
    if not 0.0 <= overlap < 1.0:
        raise InputError(f"`overlap` is {overlap}", cure="Choose a part of a segment, from 0 to below 1.")
    if detrend not in ("constant", "linear", "none"):
        raise InputError(f"`detrend` is {detrend!r}", cure="Choose constant, linear or none.")
    step = max(1, segment - int(overlap * segment))
    if segment < 4 or u.size < segment + step:
        raise InputError(
            f"`segment` is {segment} samples and the record has {u.size}: an average needs two segments or more",
            cure=f"Choose `segment` from 4 to {int(u.size / (2.0 - overlap))}, better much shorter, or record longer.",
        )
    w = window_values(window, segment)
    average = averaging(w, step, 1 + (u.size - segment) // step)
    return _welch(
        u,
        x,
        jnp.asarray(sample_rate, float),
        jnp.asarray(w),
        step,
        detrend,
        jnp.asarray(average.effective),
        jnp.asarray(average.bin_correlation),
    )


def _checked(name: str, values: ArrayLike) -> Float[Array, " n"]:
    values = jnp.asarray(values, float)
    if values.ndim != 1:
        raise InputError(
            f"`{name}` has the shape {values.shape} and should be a single record",
            cure="Give one record of shape (n,); `jax.vmap` runs over several.",
        )
    # Tracers have no values to check.
    if not isinstance(values, Tracer):
        bad = np.flatnonzero(~np.isfinite(np.asarray(values)))
        if bad.size:
            raise InputError(
                f"`{name}` holds {bad.size} values that are not finite, the first at sample {bad[0]}",
                cure="Cut the record before it, or repair the gap.",
            )
    return values


@eqx.filter_jit
def _welch(
    u: Float[Array, " n"],
    x: Float[Array, " n"],
    sample_rate: Float[Array, ""],
    w: Float[Array, " segment"],
    step: int,
    detrend: str,
    averages: Float[Array, ""],
    bin_correlation: Float[Array, ""],
) -> FRF:
    segments = 1 + (u.size - w.size) // step
    index = step * np.arange(segments)[:, None] + np.arange(w.size)[None, :]
    U, X = (jnp.fft.rfft(_level(signal[index], detrend) * w[None, :], axis=1) for signal in (u, x))
    uu, xx = (jnp.mean(jnp.abs(S) ** 2, axis=0) for S in (U, X))
    ux = jnp.mean(jnp.conj(U) * X, axis=0)
    # Rounding leaves about 1e-30 of the power in a line that was never excited: there is no response to that.
    driven = uu > 1e-24 * jnp.max(uu)
    safe_uu = jnp.where(driven, uu, 1.0)
    response = jnp.where(driven, ux / safe_uu.astype(ux.dtype), jnp.zeros_like(ux))
    explained = jnp.where(driven, jnp.abs(ux) ** 2 / safe_uu, 0.0)
    moved = xx > 0.0
    coherence = jnp.clip(jnp.where(moved, explained / jnp.where(moved, xx, 1.0), 0.0), 0.0, 1.0)
    # |response|^2 (1 - coherence) / coherence, written so that it is finite at zero coherence.
    unexplained = jnp.maximum(xx - explained, 0.0) / safe_uu
    return FRF(
        frequency=jnp.asarray(np.arange(w.size // 2 + 1) / w.size) * sample_rate,
        response=response,
        coherence=coherence,
        std=jnp.where(driven, jnp.sqrt(unexplained / (2.0 * (averages - 1.0))), jnp.inf),
        averages_effective=averages,
        sample_rate=sample_rate,
        bin_correlation=bin_correlation,
    )


def _level(segments: Float[Array, "k segment"], detrend: str) -> Float[Array, "k segment"]:
    """The segments without their mean or without the line of least squares through them."""
    if detrend == "none":
        return segments
    level = segments - jnp.mean(segments, axis=1, keepdims=True)
    if detrend == "constant":
        return level
    time = np.arange(segments.shape[1]) - (segments.shape[1] - 1) / 2.0
    slope = level @ jnp.asarray(time / np.sum(time**2))
    return level - slope[:, None] * jnp.asarray(time)[None, :]
