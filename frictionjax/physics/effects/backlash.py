"""A second inertia behind a gap."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import LOAD_DRAG, About, AbstractLoadEffect, Along, LoadSide


class Backlash(AbstractLoadEffect):
    """Part of the inertia sits behind a gap, with a spring and a damper in contact: J1 + J2 = J, J2 = ratio J.

    **Arguments:**

    - `ratio`: J2/J.
    - `gap`: free way from contact to contact, position units.
    - `frequency`: of the load in contact with the motor blocked, Hz.
    - `damping`: damping ratio of the same.
    - `drag`: viscous friction of the load itself over J2, 1/s: it determines when the load crosses the gap.
    """

    ratio: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    gap: Float[Array, "..."] = eqx.field(converter=real, default=1e-4)
    frequency: Float[Array, "..."] = eqx.field(converter=real, default=50.0)
    damping: Float[Array, "..."] = eqx.field(converter=real, default=0.1)
    drag: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    chaotic: ClassVar[bool] = True
    along: ClassVar[Along] = "since_reversal"
    name: ClassVar[str] = "backlash"
    about: ClassVar[About] = About(
        sentence="a second inertia behind a gap (backlash)",
        equation="J2 (x2'' + drag x2') = k dz(x1 - x2) + c (x1' - x2') in contact, dz(d) = d beyond half the gap, or 0",
        shows="after reversals: less inertia while the gap is crossed, then an impact",
        confused_with=("flexible_transmission",),
        split_by="noise of two levels: a spring keeps its frequencies, a gap does not",
        needs=("both directions",),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "gap",
            "{position}",
            "way from contact to contact",
            "log",
            scale="zs",
            grid=(1.0, 5.0, 25.0),
            other_start=5.0,
        ),
        Parameter(
            "frequency",
            "Hz",
            "antiresonance in contact",
            "log",
            lower=3.0,
            upper=400.0,
            grid=(30.0, 80.0, 200.0),
            other_start=200.0,
        ),
        Parameter(
            "damping",
            "1",
            "damping ratio in contact",
            "log",
            lower=1e-3,
            upper=1.0,
            grid=(0.1,),
            other_start=0.2,
        ),
        LOAD_DRAG,
    )

    def load_side(self) -> LoadSide:
        circular = 2.0 * jnp.pi * self.frequency
        return LoadSide(
            ratio=self.ratio,
            stiffness=circular * circular,
            damping=2.0 * self.damping * circular,
            half_gap=0.5 * self.gap,
            drag=self.drag,
        )
