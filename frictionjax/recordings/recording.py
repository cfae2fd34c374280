"""The nouns: a recording, the plant it was made on, the user's own model of it, and the case of them."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

# A time step that deviates from the nominal one by more than this part of it is jitter, and is resampled.
JITTER_TOLERANCE = 1e-3


class Plant(eqx.Module):
    """What is known of the machine before anything is identified.

    **Attributes:**

    - `motor_constant`: force or torque per input unit; None when unknown (every force is then per input unit).
    - `position_unit`, `force_unit`, `input_unit`: units, as text.
    - `encoder_step`: quantum of the position sensor in position units; None when unknown.
    - `inertia`: known inertia or mass; None when it is to be identified.
    """

    motor_constant: float | None = eqx.field(static=True, default=None)
    position_unit: str = eqx.field(static=True, default="position")
    force_unit: str = eqx.field(static=True, default="force")
    input_unit: str = eqx.field(static=True, default="input")
    encoder_step: float | None = eqx.field(static=True, default=None)
    inertia: float | None = eqx.field(static=True, default=None)


class Sampling(eqx.Module):
    """How far the time stamps of the file were from a uniform grid.

    **Attributes:**

    - `jitter`: largest deviation of a step from the nominal one, as a fraction of it.
    - `gaps`: `(time, length)` of every step longer than 1.5 nominal steps, s, in the file's own time.
    - `missing`: samples that the gaps lack.
    - `late`: samples whose stamps came late, by what the next steps are too short: none is missing there.
    - `repeated`: rows that were written twice, and dropped.
    - `resampled`: True when the channels were interpolated onto a uniform grid.
    """

    jitter: float = eqx.field(static=True, default=0.0)
    gaps: tuple[tuple[float, float], ...] = eqx.field(static=True, default=())
    missing: int = eqx.field(static=True, default=0)
    late: int = eqx.field(static=True, default=0)
    repeated: int = eqx.field(static=True, default=0)
    resampled: bool = eqx.field(static=True, default=False)


class Recording(eqx.Module):
    """One uniformly sampled experiment: the input that was applied and the position that was measured.

    **Attributes:**

    - `name`: short name, unique in its case (the file's stem).
    - `sample_rate`: samples per second.
    - `u`: input, held between samples, shape `(n,)`, in input units (zeros for `drive = "motion"`).
    - `x`: measured position, shape `(n,)`, in position units.
    - `role`: `"fit"` or `"holdout"`; a holdout recording is never used for fitting or for naming effects.
    - `loop`: `"open"`, or `"closed"` when u is feedback of the measured x, noise included.
    - `drive`: `"force"` (u is applied, x is the response) or `"motion"` (x is imposed, `force` is the response).
    - `start_time`: s since power-on; recordings of one warm-up share a clock.
    - `v`, `force`, `reference`, `temperature`, `normal_force`, `supply`: optional channels, shape `(n,)`.
    - `warnings`: what the audit found, as sentences.
    - `sampling`: how far the file's time stamps were from a uniform grid.
    """

    name: str = eqx.field(static=True)
    sample_rate: float = eqx.field(static=True)
    u: Float[np.ndarray, " n"]
    x: Float[np.ndarray, " n"]
    role: Literal["fit", "holdout"] = eqx.field(static=True, default="fit")
    loop: Literal["open", "closed"] = eqx.field(static=True, default="open")
    drive: Literal["force", "motion"] = eqx.field(static=True, default="force")
    start_time: float = eqx.field(static=True, default=0.0)
    v: Float[np.ndarray, " n"] | None = None
    force: Float[np.ndarray, " n"] | None = None
    reference: Float[np.ndarray, " n"] | None = None
    temperature: Float[np.ndarray, " n"] | None = None
    normal_force: Float[np.ndarray, " n"] | None = None
    supply: Float[np.ndarray, " n"] | None = None
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    sampling: Sampling = Sampling()

    @property
    def t(self) -> Float[np.ndarray, " n"]:
        """Time since the first sample, s, shape `(n,)`."""
        return np.arange(self.x.size) / self.sample_rate

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.x.size / self.sample_rate


class Given(eqx.Module):
    """A value of one parameter.

    **Attributes:** `value` (in the units of the case), `fixed` (whether a fit must leave it as it is).
    """

    value: float = eqx.field(static=True)
    fixed: bool = eqx.field(static=True, default=False)


class GivenEffect(eqx.Module):
    """An effect that is known to act.

    **Attributes:** `name` (in the catalogue), `form` (name of one of its forms; empty: the first), `values` (by the
    names of its strengths and other parameters).
    """

    name: str = eqx.field(static=True)
    form: str = eqx.field(static=True, default="")
    values: dict[str, Given] = eqx.field(static=True, default_factory=dict)


class GivenModel(eqx.Module):
    """The user's own model.

    **Attributes:** `parameters` (of inertia and friction, by name), `effects`, `source` (the case file as text, for
    messages; None when there is none).
    """

    parameters: dict[str, Given] = eqx.field(static=True, default_factory=dict)
    effects: tuple[GivenEffect, ...] = eqx.field(static=True, default=())
    source: str | None = eqx.field(static=True, default=None)


class Case(eqx.Module):
    """A plant and its recordings.

    **Attributes:**

    - `name`: the case's name.
    - `plant`: the `Plant`.
    - `recordings`: all recordings, in the order of the case file.
    - `model`: the user's own model of the machine; None where there is none.
    """

    name: str = eqx.field(static=True)
    plant: Plant
    recordings: tuple[Recording, ...]
    model: GivenModel | None = None

    @property
    def fit_recordings(self) -> tuple[Recording, ...]:
        """The recordings that fits and the naming of effects use."""
        return tuple(r for r in self.recordings if r.role == "fit")

    @property
    def holdout_recordings(self) -> tuple[Recording, ...]:
        """The held-out recordings, for validation."""
        return tuple(r for r in self.recordings if r.role == "holdout")
