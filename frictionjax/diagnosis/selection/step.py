"""A step: one round of the selection with its models."""

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.diagnosis.table import ModelComparison


class Step(eqx.Module):
    """One round of the selection.

    **Attributes:** `before` (model without the candidates; better than the one the round began with when a refit led to
    a better one), `trials` (every test), `refits` (the short list, best first), `compared` (each of them against
    `before`), `floor` (power of each block), `force` (unmeasured force over Coulomb friction), `accepted` (or None),
    `rivals` (names that the recordings cannot tell from the accepted one), `together` (whether the model without them
    is at the noise everywhere once it is fitted to all recordings), `dropped` (why an effect that might have been
    accepted was not, after all; "" where none was), `least_share` (of the misfit, that a candidate must explain).
    """

    before: Model
    trials: list[Trial]
    refits: list[Refitted]
    compared: list[ModelComparison]
    floor: np.ndarray
    force: float
    accepted: Refitted | None
    rivals: tuple[str, ...] = eqx.field(static=True)
    together: bool = eqx.field(static=True, default=False)
    dropped: str = eqx.field(static=True, default="")
    least_share: float = eqx.field(static=True, default=0.0)
