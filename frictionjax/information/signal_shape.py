"""A multisine as a function of the amplitudes and phases of its lines, of constant rms or peak."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from frictionjax.core import InputError

# The backward pass through a run keeps every step of every sensitivity: 0.2 GB and 0.1 s for 4000 samples.
_MOST_SAMPLES = 16384
_SILENT = 1e-9  # of the largest line: a smaller one carries no sine


def lines_of(
    u: Float[np.ndarray, " n"],
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """The lines of `u`, their amplitudes and phases, or an error."""
    if u.size > _MOST_SAMPLES:
        raise InputError(
            f"it has {u.size} samples",
            place="`start`",
            cure=f"Give a period of at most {_MOST_SAMPLES}: at a lower sample rate, or a shorter one.",
        )
    spectrum = np.fft.rfft(u) * 2.0 / u.size
    magnitude = np.abs(spectrum)
    present = magnitude > _SILENT * np.max(magnitude)
    if not np.any(present):
        raise InputError("it is zero throughout", place="`start`", cure="Give one that `multisine` makes.")
    if present[0] or (u.size % 2 == 0 and present[-1]):
        which = "a mean" if present[0] else "a line at half of the sample rate"
        raise InputError(
            f"it has {which}", place="`start`", cure="Remove it, or give one that `multisine` makes."
        )
    lines = np.flatnonzero(present)
    return lines, magnitude[lines], np.angle(spectrum[lines])


def size_of(u: Float[np.ndarray, " n"], rms: float | int | None, peak: float | int | None) -> float:
    """The rms or the peak that is kept constant, input units."""
    if rms is not None and peak is not None:
        raise InputError("both are given", place="`rms`, `peak`", cure="Give one: the other follows from it.")
    size = peak if peak is not None else float(np.sqrt(np.mean(u**2))) if rms is None else rms
    if not (np.isfinite(size) and size > 0.0):
        which = "`rms`" if peak is None else "`peak`"
        raise InputError(f"it is {size}", place=which, cure="Give a positive number, in input units.")
    return float(size)


class SignalShape(eqx.Module):
    """A signal as a function of the logarithms of its amplitudes and of its phases, of constant rms or peak."""

    silence: Float[Array, " n"]
    lines: Int[Array, " m"]
    size: Float[Array, ""]
    by_peak: Bool[Array, ""]

    def scaled(self, theta: Float[Array, " m2"]) -> tuple[Float[Array, " m"], Float[Array, " n"]]:
        """Amplitudes, shape `(m,)`, and signal, shape `(n,)`."""
        count, n = self.lines.shape[0], self.silence.shape[0]
        a, phase = jnp.exp(theta[:count]), theta[count:]
        wave = jax.lax.complex(a * jnp.cos(phase), a * jnp.sin(phase))
        w = jnp.fft.irfft(jnp.zeros(n // 2 + 1, complex).at[self.lines].set(wave), n) * (n / 2.0)
        now = jnp.where(self.by_peak, jnp.max(jnp.abs(w)), jnp.sqrt(jnp.sum(a * a) / 2.0))
        return a * (self.size / now), w * (self.size / now)

    def signal(self, theta: Float[Array, " m2"]) -> Float[Array, " n"]:
        """The signal alone."""
        return self.scaled(theta)[1]
