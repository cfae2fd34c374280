"""Waves: periodic functions of position or time, and the fields of the effects that are such waves."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real

Parts = tuple[Float[Array, "..."], Float[Array, "..."]]
"""Sine and cosine part of a wave."""


def wave(turns: Float[Array, "..."], *parts: Parts) -> Float[Array, "..."]:
    """Sum of sine_k sin(2 pi k turns) + cosine_k cos(2 pi k turns) over the `parts` (sine_k, cosine_k), k = 1, 2, ...

    **Arguments:** `turns`: the argument in periods of the first one.
    """
    angle = 2.0 * jnp.pi * turns
    terms = [
        sine * jnp.sin(k * angle) + cosine * jnp.cos(k * angle)
        for k, (sine, cosine) in enumerate(parts, start=1)
    ]
    return sum(terms[1:], terms[0])


class AbstractWave(eqx.Module):
    """An effect that is a wave along the position.

    **Arguments:** `sine`, `cosine`: parts of the wave; `period`: position units.
    """

    along: ClassVar[Literal["position"]] = "position"

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    def wave(self, x: Float[Array, "..."]) -> Float[Array, "..."]:
        """Height of the wave at position `x`."""
        return wave(x / self.period, (self.sine, self.cosine))


class AbstractWaveWithOvertone(eqx.Module):
    """An effect that is a wave along the position with a second harmonic.

    **Arguments:** `sine`, `cosine`: parts of the wave; `sine2`, `cosine2`: those at half the period; `period`: position
    units.
    """

    along: ClassVar[Literal["position"]] = "position"

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    def wave(self, x: Float[Array, "..."]) -> Float[Array, "..."]:
        """Height of the wave at position `x`."""
        return wave(x / self.period, (self.sine, self.cosine), (self.sine2, self.cosine2))


class AbstractWaveWithOvertones(eqx.Module):
    """An effect that is a wave along the position with four harmonics.

    **Arguments:** `sine`, `cosine`: parts of the wave; those with a number k: at the k-th part of the period; `period`:
    position units.
    """

    along: ClassVar[Literal["position"]] = "position"

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine3: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine3: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine4: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine4: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    def wave(self, x: Float[Array, "..."]) -> Float[Array, "..."]:
        """Height of the wave at position `x`."""
        first, second = (self.sine, self.cosine), (self.sine2, self.cosine2)
        third, fourth = (self.sine3, self.cosine3), (self.sine4, self.cosine4)
        return wave(x / self.period, first, second, third, fourth)


def wave_strengths(
    unit: str,
    meaning: str,
    *,
    scale: float | str = 1.0,
    limit: float = float("inf"),
    probe: float = 0.02,
    harmonics: int = 1,
) -> tuple[Parameter, ...]:
    """The strengths of a wave: `sine` and `cosine`, and `sine2` and `cosine2` and so on for further `harmonics`.

    **Arguments:**

    - `unit`, `scale`: as in `Parameter`.
    - `meaning`: of a part, such as "amplitude".
    - `limit`: largest absolute value of a part.
    - `harmonics`: how many, four at most.
    - `probe`: the finite step at which a part is tried, in units of `scale`.
    """
    numbered = (
        ("", ""),
        ("2", " at half the period"),
        ("3", " at a third of it"),
        ("4", " at a quarter of it"),
    )
    return tuple(
        Parameter(
            f"{part}{number}",
            unit,
            f"{part} {meaning}{where}",
            scale=scale,
            lower=-limit,
            upper=limit,
            probes=(probe,),
        )
        for number, where in numbered[:harmonics]
        for part in ("sine", "cosine")
    )
