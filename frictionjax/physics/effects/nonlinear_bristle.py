"""Bristle stiffness that depends on deflection."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSpringEffect
from frictionjax.physics.lugre import LuGre


class NonlinearBristle(AbstractSpringEffect):
    """F_z = sigma0 z (1 + hardening (sigma0 z / Fs)^2): stiffer when bent, or softer where `hardening` is negative.

    **Arguments:**

    - `hardening`: relative rise of the secant stiffness at the break-away deflection Fs/sigma0.
    """

    hardening: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "nonlinear_bristle"
    about: ClassVar[About] = About(
        sentence="bristle stiffness that depends on deflection (hardening or softening)",
        equation="F_z = sigma0 z (1 + hardening (sigma0 z / Fs)^2), dz/dt = v - |v| F_z / G(v)",
        shows="presliding near break-away; third harmonic of a presliding sine",
        confused_with=("maxwell_slip", "load_dependence"),
        split_by="presliding sines of several amplitudes below break-away, with and without an offset",
        source="Lampaert, Swevers, Al-Bender 2002; the conjecture that ends Hensen et al. 2002",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        # Below -4/27 the bristle could not carry break-away.
        Parameter(
            "hardening", "1", "relative rise of stiffness", lower=-0.12, upper=5.0, probes=(0.03, -0.1, 0.5)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def spring(self, force: Float[Array, ""], friction: LuGre, z: Float[Array, ""]) -> Float[Array, ""]:
        bend = friction.sigma0 * z / friction.Fs
        return force * (1.0 + self.hardening * bend * bend)
