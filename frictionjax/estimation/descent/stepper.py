"""The step of every descent and how its damping goes on (Levenberg-Marquardt), and why a descent ended.

A diagnosis steps from Python, with NumPy: one compiled call a step, whatever the structure (`robust.py`). A fit steps
inside a compiled loop of optimistix (`levenberg_marquardt.py`).
"""

from enum import Enum

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers, numpy_or_jax

_LEAST_CURVATURE = 1e-12  # of a coordinate: one without any is not scaled by it


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


class Stepper(eqx.Module):
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
