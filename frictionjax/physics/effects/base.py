"""Effects: physics that the base model leaves out. Orthogonal slots, one abstract class each.

Every strength is zero at the base model, and the model is differentiable there. An effect may fill several slots: a
state that continues from sample to sample (`AbstractStateEffect`), and the friction level that depends on it.
"""

import dataclasses
from abc import abstractmethod
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.display import one_line
from frictionjax.core.safe import real
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.push import Push

Along = Literal["velocity", "position", "since_reversal", "dwell", "input", "input_rate", "time", "frequency"]
"""What the force that a model without an effect lacks is drawn over, so that the effect shows."""


class About(eqx.Module):
    """Description of an effect for users.

    **Attributes:** `sentence` (what it is), `equation`, `shows` (where it shows), `confused_with` (names of
    effects with a similar signature), `split_by` (the experiment that distinguishes it from those), `source`, `needs`
    (what recordings must contain to show it: any of `"sliding"`, `"presliding"`, `"rest"`, `"both directions"`,
    `"clock"`, `"angle"`, `"motor force"`), `one_law` (whether its equation is exact on every machine, so that the right
    effect leaves almost no residual), `of_position` (whether it is a force that is a function of the position alone: a
    machine may have another function than the equation).
    """

    sentence: str = eqx.field(static=True)
    equation: str = eqx.field(static=True)
    shows: str = eqx.field(static=True)
    confused_with: tuple[str, ...] = eqx.field(static=True, default=())
    split_by: str = eqx.field(static=True, default="")
    source: str = eqx.field(static=True, default="")
    needs: tuple[str, ...] = eqx.field(static=True, default=())
    one_law: bool = eqx.field(static=True, default=False)
    of_position: bool = eqx.field(static=True, default=False)


class Now(eqx.Module):
    """The inputs of an effect at one instant: position `x`, velocity `v`, motor force `push` (held over the step),
    force of LuGre's bristle `spring`, and the effect's own states `hidden`, shape `(states,)`."""

    x: Float[Array, ""]
    v: Float[Array, ""]
    push: Float[Array, ""]
    spring: Float[Array, ""]
    hidden: Float[Array, " states"]


TEMPERATURES = 9
"""Instants at which a recording's measured temperature is kept; it is a slow signal."""


class Before(eqx.Module):
    """History before a recording, as far as it is known.

    **Attributes:** `clock` (s since power-on at its first sample), `rest` (s that the machine rested before it), and
    the paths travelled before, `path` (position units, shape `(k,)`), each so many s ago, `age` (shape `(k,)`).
    Of the recording itself: how long it lasts, `duration` (s), and the `temperature` measured in it, in K above that of
    the first recording's first sample, at `TEMPERATURES` equidistant instants from its first to its last sample.
    """

    clock: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    rest: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    path: Float[Array, "... k"] = eqx.field(converter=real, default_factory=lambda: jnp.zeros(1))
    age: Float[Array, "... k"] = eqx.field(converter=real, default_factory=lambda: jnp.zeros(1))
    duration: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    temperature: Float[Array, "... t"] = eqx.field(
        converter=real, default_factory=lambda: jnp.zeros(TEMPERATURES)
    )


class AbstractEffect(eqx.Module):
    """One missing effect. `catalogue` finds the final subclasses; several forms may share a `name`.

    A slot, or an effect that differs from its slot, says `along` what the missing force shows it.
    """

    along: ClassVar[Along] = "velocity"
    name: eqx.AbstractClassVar[str]
    about: eqx.AbstractClassVar[About]
    strengths: eqx.AbstractClassVar[tuple[Parameter, ...]]
    nuisances: eqx.AbstractClassVar[tuple[Parameter, ...]]

    def __repr__(self) -> str:
        return one_line(self)

    def in_turns_of(self, turn: float) -> "AbstractEffect":
        """The same effect for positions of which `turn` are a full turn (2 pi of rad): one that depends on an angle
        has a field of this name."""
        has_angle = any(field.name == "turn" for field in dataclasses.fields(self))
        return dataclasses.replace(self, turn=turn) if has_angle else self

    def silenced(self) -> "AbstractEffect":
        """The same effect with every strength at zero: the base model, without another compilation."""
        return dataclasses.replace(
            self, **{p.name: jnp.zeros_like(getattr(self, p.name)) for p in self.strengths}
        )


class AbstractInputEffect(AbstractEffect):
    """Slot: the path from the input to the force. Acts on the whole input sequence, before the plant."""

    along: ClassVar[Along] = "input"

    @abstractmethod
    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"] | Push:
        """Input `u` (shape (n,), held for `dt` s) as it acts on the plant: held, or a `Push` of input units where it
        changes within a sample."""


class AbstractSensorEffect(AbstractEffect):
    """Slot: the path from the position to the measurement."""

    along: ClassVar[Along] = "frequency"

    @abstractmethod
    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        """Output of the sensor for a `position` (position units) `t` s after the first sample; `hidden`: the effect's
        own states, shape `(states,)`."""


class AbstractForceEffect(AbstractEffect):
    """Slot: a force added to the friction, J x'' = km u - F - force."""

    @abstractmethod
    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        """The opposing force, force units, for what is `now`; `friction` gives scales."""


class AbstractLevelEffect(AbstractEffect):
    """Slot: inside the friction law, the steady-state level G."""

    @abstractmethod
    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        """The level (force units) that replaces `level` for what is `now`; `friction` gives scales."""


class AbstractSpringEffect(AbstractEffect):
    """Slot: the force of LuGre's bristle, which need not be proportional to its deflection."""

    along: ClassVar[Along] = "since_reversal"

    @abstractmethod
    def spring(self, force: Float[Array, "*d"], friction: LuGre, z: Float[Array, "*d"]) -> Float[Array, "*d"]:
        """The force that replaces `force` (sigma0 z at first) at deflection `z` (position units), odd in `z`;
        `friction` gives scales.

        The bristle slips in proportion to this force, dz/dt = v - |v| force/G, so that sliding friction stays G.
        """


class AbstractSlipEffect(AbstractEffect):
    """Slot: how LuGre's bristle slips, dz/dt = v - |v| slip."""

    along: ClassVar[Along] = "since_reversal"

    steep: ClassVar[bool] = True
    """Whether the slip may rise more steeply with the bend than LuGre's: long steps then need more care."""

    @abstractmethod
    def slip(self, bend: Float[Array, "*d"], direction: Float[Array, "*d"]) -> Float[Array, "*d"]:
        """Replacement of `bend`, the bristle's force over the level G (1 in steady sliding, where it must stay 1), for
        motion in `direction` (+1 or -1)."""


class AbstractDampingEffect(AbstractEffect):
    """Slot: the damping sigma1 of the bristles."""

    @abstractmethod
    def damping(self, friction: LuGre, v: Float[Array, ""]) -> Float[Array, ""]:
        """Factor on sigma1 at velocity `v`; `friction` gives scales."""


class AbstractStateEffect(AbstractEffect):
    """Slot: states of its own that continue from sample to sample, each relaxing: h' = source - rate h."""

    states: eqx.AbstractClassVar[int]

    @abstractmethod
    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        """`source` and `rate` (1/s, not negative) of the states for what is `now`; `friction` gives scales."""

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        """States at the first sample of a recording, given what was `before`; zero by default.

        `friction` gives scales.
        """
        return jnp.zeros(self.states)


class AbstractCreepEffect(AbstractStateEffect):
    """Slot: states in series with the bristles, which changes the velocity of the bristles."""

    along: ClassVar[Along] = "since_reversal"

    @abstractmethod
    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        """Velocity of the machine minus that of the bristles, position/s, for what is `now`; `friction` gives
        scales."""

    @abstractmethod
    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        """Velocity of the machine minus that at which LuGre's bristle slips (|w| in (2)), position/s, for what is
        `now`; `friction` gives scales."""


class AbstractBristleEffect(AbstractEffect):
    """Slot: the bristles themselves. Gives a bank of elements in place of the single bristle."""

    along: ClassVar[Along] = "since_reversal"

    count: eqx.AbstractClassVar[int]

    @abstractmethod
    def share_and_yield(self) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
        """Share of the stiffness, and yield deflection over the mean yield deflection, of each added element.

        The single bristle keeps the stiffness that the shares leave.
        """


class LoadSide(eqx.Module):
    """A second inertia behind an elastic coupling. With d = x2 - x1 and w = d':

        x2'' = a2 - drag x2',   J1 x1'' = km u - F - J2 a2,   a2 = -stiffness dz(d) - damping w (in contact)

    J1 = (1 - ratio) J, J2 = ratio J; dz(d) is d beyond half the gap on either side, else 0. Without a gap there is
    always contact; the flanks of a gap push and never pull.

    **Attributes:** `ratio` (J2/J), `stiffness` (over J2, 1/s^2), `damping` (over J2, 1/s), `half_gap` (position
    units), `drag` (viscous friction of the load itself over J2, 1/s).
    """

    ratio: Float[Array, ""]
    stiffness: Float[Array, ""]
    damping: Float[Array, ""]
    half_gap: Float[Array, ""]
    drag: Float[Array, ""]


LOAD_DRAG = Parameter(
    "drag",
    "1/s",
    "viscous friction of the load over its inertia",
    "log",
    lower=1e-3,
    upper=100.0,
    grid=(1.0,),
)
"""Friction of the load itself, the same parameter for every second inertia."""


class AbstractLoadEffect(AbstractEffect):
    """Slot: an inertia of its own behind the motor's, of which it has the part `ratio` of the whole. A drive has one
    at most. `chaotic`: whether its contacts make the motion chaotic, and its derivatives useless."""

    along: ClassVar[Along] = "frequency"

    chaotic: ClassVar[bool] = False
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "ratio",
            "1",
            "load inertia over the whole",
            lower=0.0,
            upper=0.9,
            probes=(0.02, 0.3),
            other_start=0.3,
        ),
    )

    @abstractmethod
    def load_side(self) -> LoadSide:
        """The second inertia and its coupling."""
