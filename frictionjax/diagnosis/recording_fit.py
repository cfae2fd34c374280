"""Nouns of one recording: how far each model is off in it, and how much force each lacks."""

from dataclasses import dataclass
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Unmeasured:
    """The random force, constant over each sample, that a model needs beside it to explain its prediction errors.

    **Attributes:** `force` (root mean square, force units), `of_coulomb` (over Coulomb friction), `of_applied` (over
    the root mean square of the applied force, or of the measured one where the motion is imposed).
    """

    force: float
    of_coulomb: float
    of_applied: float


@dataclass(frozen=True)
class Horizon:
    """How far two models are off when they predict the position `seconds` ahead from what was measured until then; over
    the whole recording, from its first sample.

    **Attributes:** `seconds` (s), `base`, `extended` (root mean square errors of the two models, position units),
    `standstill` (that of predicting that the machine stays where it is: a model that is worse says nothing).
    """

    seconds: float
    base: float
    extended: float
    standstill: float


@dataclass(frozen=True)
class ClosedLoop:
    """How far the models are off from the first sample to the last when the user's own controller drives them.

    **Attributes:** `base`, `extended`, `given` (root mean square errors of the position, position units; the last None
    where the user's own model is not given in full), `input_base`, `input_extended`, `input_given` (of the input that
    the controller gives against the recorded one, input units), `law` (part of the variance of the recorded input that
    the controller's gains make of the recorded reference less the measured position; None without a reference).
    """

    base: float
    extended: float
    input_base: float
    input_extended: float
    given: float | None = None
    input_given: float | None = None
    law: float | None = None


class RecordingFit(eqx.Module):
    """Measured against base and extended model, for one recording; every array has shape `(n,)`.

    **Attributes:** `name`, `role`, `t` (s), `u` (input units), `x`, `free_base`, `free_extended`, `predicted_base`,
    `predicted_extended` (position units), `residual_force` (the force that the base model lacks, force units),
    `residual_force_extended`, `residual_force_std`; `noise_floor`, what a perfect model would leave 0.1 s ahead, and
    the root mean square errors (position units) `free_run_rmse_base`, `free_run_rmse_extended`,
    `prediction_rmse_base`, `prediction_rmse_extended`; those of the motion over 0.1 s in the free run, put on the
    measured position each time and with the run's own velocity, `increment_rmse_base`, `increment_rmse_extended` (None
    where not known). Of the user's own simulation as it was given, `free_given`, `free_run_rmse_given`,
    `increment_rmse_given` and `prediction_rmse_given`; None where there is none, and no prediction where it is a
    column of the recording, which no measured sample corrects. `horizons`: errors one sample, 0.1 s and 1 s ahead, and
    over the whole recording; `unmeasured_base`, `unmeasured_extended`: the part of the residual force that noise does
    not explain; `sensor_noise`: that of the position where the floor is another, as of an integrated velocity, which
    drifts in 0.1 s; `closed_loop`: the errors under the user's own controller, None where there is none or the loop
    was open. With `drive = "motion"` the model columns and the errors are those of the force, in force units, `force`
    is the measured one, and there are no `horizons`.
    """

    name: str = eqx.field(static=True)
    role: Literal["fit", "holdout"] = eqx.field(static=True)
    t: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " n"]
    x: Float[np.ndarray, " n"]
    free_base: Float[np.ndarray, " n"]
    free_extended: Float[np.ndarray, " n"]
    predicted_base: Float[np.ndarray, " n"]
    predicted_extended: Float[np.ndarray, " n"]
    residual_force: Float[np.ndarray, " n"]
    residual_force_extended: Float[np.ndarray, " n"]
    residual_force_std: Float[np.ndarray, " n"]
    noise_floor: float = eqx.field(static=True)
    free_run_rmse_base: float = eqx.field(static=True)
    free_run_rmse_extended: float = eqx.field(static=True)
    prediction_rmse_base: float = eqx.field(static=True)
    prediction_rmse_extended: float = eqx.field(static=True)
    drive: Literal["force", "motion"] = eqx.field(static=True, default="force")
    force: Float[np.ndarray, " n"] | None = None
    free_run_rmse_given: float | None = eqx.field(static=True, default=None)
    prediction_rmse_given: float | None = eqx.field(static=True, default=None)
    free_given: Float[np.ndarray, " n"] | None = None
    increment_rmse_base: float | None = eqx.field(static=True, default=None)
    increment_rmse_extended: float | None = eqx.field(static=True, default=None)
    increment_rmse_given: float | None = eqx.field(static=True, default=None)
    horizons: tuple[Horizon, ...] = eqx.field(static=True, default=())
    unmeasured_base: Unmeasured | None = eqx.field(static=True, default=None)
    unmeasured_extended: Unmeasured | None = eqx.field(static=True, default=None)
    closed_loop: ClosedLoop | None = eqx.field(static=True, default=None)
    sensor_noise: float | None = eqx.field(static=True, default=None)

    @property
    def one_sample_floor(self) -> float:
        """What a perfect model would leave one sample ahead."""
        return self.noise_floor if self.sensor_noise is None else self.sensor_noise
