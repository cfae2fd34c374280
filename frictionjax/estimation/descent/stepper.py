"""The step of every descent, how its damping goes on (Levenberg-Marquardt), and when and why a descent ends.

Two drivers take these steps. A diagnosis and a single fit step by NumPy (`Stepper.descend`): their simulations are
compiled piece by piece, one program a structure, and a loop around them would be compiled anew for every number and
length of the recordings. Many fits side by side step inside one compiled loop, that of optimistix
(`levenberg_marquardt.py`): under `vmap` there is no Python between two steps. Both ask the same functions: `step`,
`judged` and `after`.
"""

from abc import abstractmethod
from enum import Enum
from typing import NamedTuple, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core.arrays import Numbers, numpy_or_jax
from frictionjax.core.plain_methods import PlainMethods

_LEAST_CURVATURE = 1e-12  # of a coordinate: one without any is not scaled by it
_RELATIVE = 1e-3  # of coordinates and residuals: a smaller change is the last


class Ending(Enum):
    """Why a descent ended; the value is the sentence for a message."""

    AT_REST = ""
    NO_STEP = "The fit stopped where no step lowers the cost although its slope promises more: the cost is rough there."
    STEPS = "The fit stopped while still improving slightly."
    NOT_FINITE = "The fit stopped where derivatives overflow."

    @property
    def number(self) -> int:
        """Its place among all endings: what a compiled descent returns."""
        return list(Ending).index(self)

    @staticmethod
    def of(number: int | Int[Numbers, ""]) -> "Ending":
        """The ending of that `number`."""
        return list(Ending)[int(number)]


class Course(NamedTuple):
    """Where a descent stands between two steps: the `damping` of the next one, whether the last one was `accepted`, how
    many accepted ones in a row were `small`, and the number of the `ending` (that of `STEPS` while it goes on)."""

    damping: Float[Numbers, ""] | float
    accepted: Bool[Numbers, ""] | bool | np.bool
    small: Int[Numbers, ""] | int
    ending: Int[Numbers, ""] | int

    @property
    def ended(self) -> Bool[Numbers, ""] | bool | np.bool:
        """Whether no step follows."""
        return self.ending != Ending.STEPS.number


class AbstractPlace(PlainMethods, eqx.Module):
    """A place of a descent that steps by NumPy, and what was evaluated there."""

    @property
    @abstractmethod
    def cost(self) -> float:
        """What is brought down."""

    @property
    @abstractmethod
    def gradient(self) -> Float[np.ndarray, " q"]:
        """Of the cost, shape `(q,)`."""

    @property
    @abstractmethod
    def hessian(self) -> Float[np.ndarray, "q q"]:
        """Of the cost, by Gauss and Newton, shape `(q, q)`."""

    @property
    @abstractmethod
    def longest(self) -> Float[np.ndarray, " q"] | None:
        """Step in each coordinate, shape `(q,)`; None: as the stepper has it."""

    @abstractmethod
    def moved(self: "Place", step: Float[np.ndarray, " q"]) -> "Place":
        """The place a `step` further, evaluated."""

    @abstractmethod
    def is_near(self: "Place", there: "Place") -> bool:
        """Whether an accepted step from here to `there` is a small one."""

    @abstractmethod
    def is_minimum(self) -> bool:
        """Whether the slope promises next to nothing, where no step lowers the cost."""


Place = TypeVar("Place", bound=AbstractPlace)


class Stepper(PlainMethods, eqx.Module):
    """Damped Gauss-Newton steps, and the damping from step to step.

    **Attributes:**

    - `damping`: at the start.
    - `scaled`: whether the damping of a coordinate is over its curvature at every step (Marquardt); else it is over 1,
        in coordinates that have been scaled before (Levenberg).
    - `easing`: what the damping is divided by after a good step.
    - `raising`: what it is multiplied by after a step that is rejected.
    - `least`, `most`: it never falls below the least; where it would have to exceed the most, no step lowers the cost.
    - `enough`, `good`: parts of the predicted reduction of the cost above which a step is accepted, and is a good one.
    - `longest`: a step in one coordinate, at most.
    - `in_a_row`: so many small steps in a row are the last.
    """

    damping: float = eqx.field(static=True, default=3e-2)
    scaled: bool = eqx.field(static=True, default=True)
    easing: float = eqx.field(static=True, default=5.0)
    raising: float = eqx.field(static=True, default=8.0)
    least: float = eqx.field(static=True, default=1e-6)
    most: float = eqx.field(static=True, default=1e5)
    enough: float = eqx.field(static=True, default=0.0)
    good: float = eqx.field(static=True, default=0.0)
    longest: float = eqx.field(static=True, default=1.5)
    in_a_row: int = eqx.field(static=True, default=2)

    def step(
        self,
        hessian: Float[Numbers, "q q"],
        gradient: Float[Numbers, " q"],
        damping: Float[Numbers, ""] | float,
        longest: Float[np.ndarray, " q"] | float | None = None,
    ) -> Float[Numbers, " q"]:
        """The step from a place where the cost has this `gradient` and Gauss-Newton `hessian`.

        **Arguments:**

        - `hessian`, `gradient`: of the cost, shapes `(q, q)` and `(q,)`.
        - `damping`: of the step.
        - `longest`: in each coordinate, shape `(q,)`; None: as the stepper has it.
        """
        xp = numpy_or_jax(hessian, gradient, damping)
        curvature = xp.diag(hessian) if self.scaled else xp.ones_like(gradient)
        scale = xp.sqrt(xp.maximum(curvature, _LEAST_CURVATURE))
        matrix = hessian / xp.outer(scale, scale) + damping * xp.eye(scale.size)
        step = -xp.linalg.lstsq(matrix, gradient / scale, rcond=1e-12)[0] / scale
        most = self.longest if longest is None else longest
        return xp.clip(step, -most, most)

    def judged(
        self,
        damping: Float[Numbers, ""] | float,
        change: Float[Numbers, ""] | float,
        predicted: Float[Numbers, ""] | float = 0.0,
    ) -> tuple[Bool[Numbers, ""] | bool | np.bool, Float[Numbers, ""]]:
        """Whether a step is accepted, and the damping of the next one.

        **Arguments:**

        - `damping`: of the step.
        - `change`: of the cost by the step, below zero where it is lower; a change that is not finite is rejected.
        - `predicted`: change of the cost by its quadratic model; not needed where `enough` and `good` are zero.
        """
        xp = numpy_or_jax(damping, change, predicted)
        accepted = change < self.enough * predicted
        eased = xp.where(
            change < self.good * predicted, xp.maximum(damping / self.easing, self.least), damping
        )
        return accepted, xp.where(accepted, eased, damping * self.raising)

    @property
    def first(self) -> Course:
        """The course before any step."""
        return Course(self.damping, True, 0, Ending.STEPS.number)

    def after(
        self,
        course: Course,
        change: Float[Numbers, ""] | float,
        predicted: Float[Numbers, ""] | float,
        small: Bool[Numbers, ""] | bool,
    ) -> Course:
        """The course after a step: at rest after enough small ones in a row; ended, too, where no step lowers the cost.
        Works inside transformations.

        **Arguments:**

        - `course`: before it.
        - `change`, `predicted`: as in `judged`.
        - `small`: whether the step is a small one, if it is accepted.
        """
        xp = numpy_or_jax(course, change, predicted, small)
        accepted, damping = self.judged(course.damping, change, predicted)
        count = xp.where(accepted, xp.where(small, course.small + 1, 0), course.small)
        at_rest = accepted & (count >= self.in_a_row)
        ending = xp.where(damping > self.most, Ending.NO_STEP.number, Ending.STEPS.number)
        return Course(damping, accepted, count, xp.where(at_rest, Ending.AT_REST.number, ending))

    def descend(self, place: Place, steps: int) -> tuple[Place, Ending, int]:
        """At most so many `steps` from `place`, by NumPy: where they end, why, and how many were tried."""
        course = self.first
        for number in range(steps + 1):
            if not (np.all(np.isfinite(place.hessian)) and np.all(np.isfinite(place.gradient))):
                return place, Ending.NOT_FINITE, number
            if course.ended or number == steps:
                break
            step = np.asarray(self.step(place.hessian, place.gradient, course.damping, place.longest))
            there = place.moved(step)
            predicted = 0.0
            if self.enough or self.good:
                predicted = float(place.gradient @ step + 0.5 * step @ place.hessian @ step)
            change = there.cost - place.cost
            course = self.after(course, change, predicted, change < 0.0 and place.is_near(there))
            place = there if course.accepted else place
        ending = Ending.of(course.ending)
        if ending is Ending.NO_STEP and place.is_minimum():
            ending = Ending.AT_REST
        return place, ending, number


def is_small_change(
    values: Float[Numbers, " k"], change: Float[Numbers, " k"], tolerance: float
) -> Bool[Numbers, ""]:
    """Whether the `change` to these `values`, in coordinates and in residuals, is one that ends a descent: below the
    `tolerance`, or a thousandth of the value, in each. Works inside transformations."""
    xp = numpy_or_jax(values, change)
    return xp.max(xp.abs(change) / (tolerance + _RELATIVE * xp.abs(values)), initial=0.0) < 1.0
