"""A measured frequency response of a machine in stick, equation (6)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Key

from frictionjax.core.arrays import Numbers, known
from frictionjax.estimation.data.pieces import Piece
from frictionjax.estimation.evidence.base import AbstractMeasurement
from frictionjax.frequency import FRF
from frictionjax.frequency.second_order import Lines, sampled_response
from frictionjax.physics import Drive


class FrequencyResponse(AbstractMeasurement):
    """The bins of an FRF inside a band, against the drive linearised at rest.

    The response is that of noise: it holds for levels so small that the bristles stay linear.

    **Attributes:** `lines` (frequencies and response), `deviation` of real and imaginary part, shape `(nf,)`, and
    `hold`: whether the input was held between samples.
    """

    lines: Lines
    deviation: Float[Numbers, " nf"]
    hold: bool = eqx.field(static=True)

    @property
    def rows(self) -> int:
        """None: a response has no initial deflection."""
        return 0

    @property
    def samples(self) -> int:
        """0: there are no recordings."""
        return 0

    def pieces(self) -> tuple[Piece, ...]:
        """None: there are no recordings."""
        return ()

    def piece(self, piece: Piece) -> "FrequencyResponse":
        """The same, whatever the `piece`: it is one whole."""
        return self

    @property
    def count(self) -> Float[np.ndarray, " b"]:
        """One number in each block, shape `(2 nf,)`."""
        return np.ones(2 * self.deviation.shape[0])

    @property
    def log_deviation(self) -> Float[Numbers, " b"]:
        """Logarithms of the deviations of real and imaginary parts, shape `(2 nf,)`."""
        xp, (deviation,) = known(self.deviation)
        return xp.tile(xp.log(deviation), 2)

    def errors(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "b n"]:
        """Real and imaginary parts of modelled less measured response over their deviation, shape `(2 nf, 1)`; for
        the `drive` at rest; `z0` is empty."""
        friction = drive.friction
        damping = friction.sigma1 + friction.sigma2
        coefficients = jnp.stack([friction.sigma0, damping, drive.J, 0.0 * drive.J])
        gain: Complex[Array, ""] = drive.motor_constant.astype(complex)
        error = gain * sampled_response(coefficients, self.lines, self.hold) - self.lines.response
        error = error / self.deviation.astype(complex)
        return jnp.concatenate([jnp.real(error), jnp.imag(error)])[:, None]

    def replica(self, drive: Drive, z0: Float[Numbers, " rows"], key: Key[Array, ""]) -> "FrequencyResponse":
        """The response of `drive` with noise drawn with `key`; `z0` is empty."""
        error = self.errors(drive, z0)[:, 0]
        model = self.lines.response + self.deviation * jax.lax.complex(*jnp.split(error, 2))
        parts = jax.random.normal(key, (2, self.deviation.shape[0]))
        drawn = model + self.deviation * jax.lax.complex(parts[0], parts[1])
        return eqx.tree_at(lambda e: e.lines.response, self, drawn)


def make_response(frf: FRF, band: tuple[float, float], *, hold: bool) -> FrequencyResponse:
    """The bins of `frf` from `band[0]` to `band[1]` Hz in which the input has power; `hold` as in
    `FrequencyResponse`."""
    frequency, std = np.asarray(frf.frequency), np.asarray(frf.std)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & np.isfinite(std) & (std > 0.0)
    omega = 2.0 * np.pi * frequency[inside]
    # Neighbouring bins of a window are correlated: together they count as fewer.
    deviation = std[inside] * np.sqrt(float(frf.bin_correlation))
    return FrequencyResponse(
        Lines(
            omega=jnp.asarray(omega),
            response=jnp.asarray(np.asarray(frf.response)[inside]),
            weight=jnp.asarray(1.0 / deviation),
            sample_omega=jnp.asarray(2.0 * np.pi * float(frf.sample_rate)),
        ),
        jnp.asarray(deviation),
        hold,
    )
