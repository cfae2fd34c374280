"""A second inertia behind a spring."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import LOAD_DRAG, About, AbstractLoadEffect, LoadSide

_TRIED = (10.0, 12.5, 16.0, 20.0, 25.0, 31.5, 40.0, 50.0, 63.0, 80.0, 100.0, 125.0, 160.0, 200.0)
"""Antiresonances, Hz, ten a decade: with the damping of its test, each shows in the test of its neighbours."""


class FlexibleTransmission(AbstractLoadEffect):
    """Part of the inertia sits behind a spring and a damper: J1 + J2 = J, J2 = ratio J.

    **Arguments:**

    - `ratio`: J2/J.
    - `frequency`: of the load with the motor blocked (the antiresonance), Hz.
    - `damping`: damping ratio of the same.
    - `drag`: viscous friction of the load itself over J2, 1/s.
    """

    ratio: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    frequency: Float[Array, "..."] = eqx.field(converter=real, default=45.0)
    damping: Float[Array, "..."] = eqx.field(converter=real, default=0.02)
    drag: Float[Array, "..."] = eqx.field(converter=real, default=0.1)

    name: ClassVar[str] = "flexible_transmission"
    about: ClassVar[About] = About(
        sentence="a second inertia behind an elastic transmission",
        equation="J2 (x2'' + drag x2') = T, T = k (x1 - x2) + c (x1' - x2'), J1 x1'' = km u - F - T, J1 + J2 = J",
        shows="a pair of antiresonance and resonance; ringing of one frequency after fast changes",
        confused_with=("backlash",),
        split_by="noise of two levels: a spring keeps its frequencies, a gap does not",
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "frequency",
            "Hz",
            "antiresonance",
            "log",
            lower=3.0,
            upper=400.0,
            grid=_TRIED,
            other_start=60.0,
        ),
        Parameter(
            "damping",
            "1",
            "damping ratio of the antiresonance",
            "log",
            lower=1e-3,
            upper=1.0,
            # Light damping rings so long that a test at the next frequency shows nothing of it.
            grid=(0.1,),
        ),
        LOAD_DRAG,
    )

    def load_side(self) -> LoadSide:
        circular = 2.0 * jnp.pi * self.frequency
        return LoadSide(
            ratio=self.ratio,
            stiffness=circular * circular,
            damping=2.0 * self.damping * circular,
            half_gap=jnp.zeros_like(self.ratio),
            drag=self.drag,
        )
