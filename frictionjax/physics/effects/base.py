"""Effects: physics that the base model leaves out. Orthogonal slots, one abstract class each.

Every strength is zero at the base model, and the model is differentiable there.
"""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.physics.lugre import LuGre


class About(eqx.Module):
    """What people should know of an effect.

    **Attributes:** `sentence` (what it is), `equation`, `shows` (where it shows), `confused_with` (names of
    effects with a similar fingerprint), `split_by` (the experiment that tells it from those), `source`.
    """

    sentence: str = eqx.field(static=True)
    equation: str = eqx.field(static=True)
    shows: str = eqx.field(static=True)
    confused_with: tuple[str, ...] = eqx.field(static=True, default=())
    split_by: str = eqx.field(static=True, default="")
    source: str = eqx.field(static=True, default="")


class AbstractEffect(eqx.Module):
    """One missing effect. Final subclasses are found by `catalogue`; several forms may share a `name`."""

    name: eqx.AbstractClassVar[str]
    about: eqx.AbstractClassVar[About]
    strengths: eqx.AbstractClassVar[tuple[Parameter, ...]]
    nuisances: eqx.AbstractClassVar[tuple[Parameter, ...]]


class AbstractInputEffect(AbstractEffect):
    """Slot: the path from the input to the force. Acts on the whole input sequence, before the plant."""

    @abstractmethod
    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Input `u` (shape (n,), held for `dt` s) as the plant receives it: its mean over each sample."""


class AbstractForceEffect(AbstractEffect):
    """Slot: a force beside the friction, J x'' = km u - F - force."""

    @abstractmethod
    def force(self, friction: LuGre, x: Float[Array, ""], v: Float[Array, ""]) -> Float[Array, ""]:
        """The opposing force, force units, at position `x` and velocity `v`; `friction` gives scales."""


class AbstractLevelEffect(AbstractEffect):
    """Slot: inside the friction law, the steady-state level G."""

    @abstractmethod
    def level(
        self, level: Float[Array, ""], friction: LuGre, x: Float[Array, ""], v: Float[Array, ""]
    ) -> Float[Array, ""]:
        """The level (force units) that replaces `level` at position `x` and velocity `v`; `friction` gives scales."""


class AbstractSpringEffect(AbstractEffect):
    """Slot: the force of LuGre's bristle, which need not be proportional to its deflection."""

    @abstractmethod
    def spring(self, force: Float[Array, ""], friction: LuGre, z: Float[Array, ""]) -> Float[Array, ""]:
        """The force that replaces `force` (sigma0 z at first) at deflection `z` (position units), odd in `z`;
        `friction` gives scales.

        The bristle slips in proportion to this force, dz/dt = v - |v| force/G, so that sliding friction stays G.
        """


class AbstractStateEffect(AbstractEffect):
    """Slot: states of its own that go on from sample to sample, slow against the bristle."""

    states: eqx.AbstractClassVar[int]

    @abstractmethod
    def rates(
        self, friction: LuGre, hidden: Float[Array, " states"], v: Float[Array, ""], spring: Float[Array, ""]
    ) -> Float[Array, " states"]:
        """Time derivatives of the `hidden` states (which start at zero), at velocity `v` and bristle force `spring`;
        `friction` gives scales."""

    @abstractmethod
    def bristle_speed(
        self, friction: LuGre, hidden: Float[Array, " states"], v: Float[Array, ""], spring: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Velocity that the bristles see in place of `v`, position/s; `friction`, `hidden`, `spring` as in `rates`."""


class AbstractBristleEffect(AbstractEffect):
    """Slot: the bristles themselves. Gives a bank of elements in place of the single bristle."""

    count: eqx.AbstractClassVar[int]

    @abstractmethod
    def share_and_yield(self) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
        """Share of the stiffness, and yield deflection over the mean yield deflection, of each added element.

        The single bristle keeps the stiffness that the shares leave.
        """
