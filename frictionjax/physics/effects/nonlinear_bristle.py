"""Bristle stiffness that depends on deflection."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSlipEffect, AbstractSpringEffect
from frictionjax.physics.lugre import LuGre

_ABOUT = About(
    sentence="bristle stiffness that depends on deflection (hardening or softening)",
    equation=(
        "F_z = sigma0 z (1 + hardening (sigma0 z/Fs)^2), sigma0 z/sqrt(1 - 2 hardening (sigma0 z/Fs)^2) below zero; "
        "dz/dt = v - |v| F_z/G(v)"
    ),
    shows="presliding near break-away; third harmonic of a presliding sine",
    confused_with=("maxwell_slip", "load_dependence"),
    split_by="presliding sines of several amplitudes below break-away, with and without an offset",
    source="Lampaert, Swevers, Al-Bender 2002; the conjecture that ends Hensen et al. 2002",
)
_HARDENING = (
    # Below -1/2 the bristle could not carry break-away; at -0.4 it deflects to 2.2 times Fs/sigma0.
    Parameter(
        "hardening", "1", "relative rise of stiffness", lower=-0.4, upper=5.0, probes=(0.03, -0.1, 0.5)
    ),
)


def _secant(bend: Float[Array, "*d"], hardening: Float[Array, ""]) -> Float[Array, "*d"]:
    """Secant stiffness over sigma0 at the deflection `bend` over Fs/sigma0. A softening bristle saturates: the force
    of a cubic would fall again at large deflections."""
    softer = hardening < 0.0
    square = bend * bend
    return jnp.where(
        softer,
        1.0 / jnp.sqrt(1.0 - 2.0 * jnp.where(softer, hardening, 0.0) * square),
        1.0 + hardening * square,
    )


class NonlinearBristle(AbstractSpringEffect):
    """F_z = sigma0 z (1 + hardening (sigma0 z/Fs)^2): stiffer with deflection; softer where `hardening` is negative,
    F_z = sigma0 z/sqrt(1 - 2 hardening (sigma0 z/Fs)^2), which is the same to first order.

    **Arguments:**

    - `hardening`: relative rise of the secant stiffness at the break-away deflection Fs/sigma0.
    """

    hardening: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "nonlinear_bristle"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = _HARDENING
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def spring(self, force: Float[Array, "*d"], friction: LuGre, z: Float[Array, "*d"]) -> Float[Array, "*d"]:
        bend = friction.sigma0 * z / friction.Fs
        return force * _secant(bend, self.hardening)


_INVERSIONS = 5  # Newton steps: to the last digit for every admissible hardening


class NonlinearBristleByDeflection(AbstractSpringEffect, AbstractSlipEffect):
    """The same spring, with a bristle that slips in proportion to its deflection, dz/dt = v - |v| z/z_ss.

    With y(f) the deflection over Fs/sigma0 that carries the force f Fs, and b = F_z/G: z/z_ss is y(b)/y(1), the level
    taken at Fs.

    **Arguments:**

    - `hardening`: relative rise of the secant stiffness at the break-away deflection Fs/sigma0.
    """

    hardening: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "nonlinear_bristle"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = _HARDENING
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def spring(self, force: Float[Array, "*d"], friction: LuGre, z: Float[Array, "*d"]) -> Float[Array, "*d"]:
        bend = friction.sigma0 * z / friction.Fs
        return force * _secant(bend, self.hardening)

    def _deflection(self, force: Float[Array, "*d"]) -> Float[Array, "*d"]:
        # Beyond break-away a softening bristle could carry no more: the deflection continues in proportion.
        within = jnp.clip(force, -1.0, 1.0)
        softer = self.hardening < 0.0
        square = within * within
        saturating = within / jnp.sqrt(1.0 + 2.0 * jnp.where(softer, self.hardening, 0.0) * square)
        y = within
        for _ in range(_INVERSIONS):
            slope = jnp.maximum(1.0 + 3.0 * self.hardening * y * y, 0.2)
            y = y - (y * (1.0 + self.hardening * y * y) - within) / slope
        y = jnp.where(softer, saturating, y)
        return y + (force - within)

    def slip(self, bend: Float[Array, "*d"], direction: Float[Array, "*d"]) -> Float[Array, "*d"]:
        return self._deflection(bend) / self._deflection(jnp.ones_like(bend))
