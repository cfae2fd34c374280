"""The nouns: a recording, the plant it was made on, the user's own model of it, and the case of them."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core.display import SIGNALS, AbstractDisplayed, Display, TextGrid, one_line, signal_row
from frictionjax.core.frames import to_dataframe, to_xarray
from frictionjax.core.front_door import public_verb
from frictionjax.core.quantities import DisplayUnit
from frictionjax.recordings.controller import Controller
from frictionjax.recordings.units import parse_unit, turn_of

# A time step that deviates from the nominal one by more than this part of it is jitter, and is resampled.
JITTER_TOLERANCE = 1e-3
_CHANNELS = ("u", "x", "v", "force", "reference", "temperature", "normal_force", "supply", "simulated")


class Plant(eqx.Module):
    """What is known of the machine before anything is identified.

    **Attributes:**

    - `motor_constant`: force or torque per input unit; None when unknown (every force is then per input unit).
    - `position_unit`, `force_unit`, `input_unit`: units, as text.
    - `encoder_step`: quantum of the position sensor in position units; None when unknown.
    - `inertia`: known inertia or mass; None when it is to be identified.
    - `hold`: what the input does between samples: `"zero"`, it is held; `"linear"`, it runs straight to the next one;
      `"auto"`, the recordings decide.
    - `position_shown`, `force_shown`, `input_shown`: the units in which these are shown, where other ones: those of the
      files, which were converted to SI.
    """

    motor_constant: float | None = eqx.field(static=True, default=None)
    position_unit: str = eqx.field(static=True, default="position")
    force_unit: str = eqx.field(static=True, default="force")
    input_unit: str = eqx.field(static=True, default="input")
    encoder_step: float | None = eqx.field(static=True, default=None)
    inertia: float | None = eqx.field(static=True, default=None)
    hold: Literal["zero", "linear", "auto"] = eqx.field(static=True, default="zero")
    position_shown: str = eqx.field(static=True, default="")
    force_shown: str = eqx.field(static=True, default="")
    input_shown: str = eqx.field(static=True, default="")

    @property
    def turn(self) -> float:
        """A full turn in position units; 2 pi, as of rad, where the position is no angle."""
        return turn_of(self.position_unit) or 2.0 * np.pi

    def displayed(self, unit: str) -> str | DisplayUnit:
        """How numbers in a `unit` are shown: one of position, force or input, or that per s or s^2, in the unit of the
        files; any other, of a stiffness say, as it is."""
        own = (
            (self.position_unit, self.position_shown),
            (self.force_unit, self.force_shown),
            (self.input_unit, self.input_shown),
        )
        for computed, shown in own:
            rest = unit.removeprefix(computed)
            known, wanted = parse_unit(computed), parse_unit(shown)
            if unit.startswith(computed) and rest in ("", "/s", "/s^2") and known and wanted:
                return DisplayUnit(f"{shown}{rest}", known.factor / wanted.factor, unit)
        return unit

    @property
    def shown_position(self) -> str | DisplayUnit:
        """The unit in which positions are shown."""
        return self.displayed(self.position_unit)

    @property
    def shown_force(self) -> str | DisplayUnit:
        """The unit in which forces are shown."""
        return self.displayed(self.force_unit)

    @property
    def shown_input(self) -> str | DisplayUnit:
        """The unit in which inputs are shown."""
        return self.displayed(self.input_unit)

    def __repr__(self) -> str:
        return one_line(self, *(("hold",) if self.hold == "zero" else ()))


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


class Recording(AbstractDisplayed):
    """One uniformly sampled experiment: the input that was applied and the position that was measured.

    **Attributes:**

    - `name`: short name, unique in its case (the file's stem).
    - `sample_rate`: samples per second.
    - `u`: input, shape `(n,)`, in input units (zeros for `drive = "motion"`); the plant's `hold` says what it does
      between samples.
    - `x`: measured position, shape `(n,)`, in position units.
    - `role`: `"fit"` or `"holdout"`; a holdout recording is never used for fitting or for naming effects.
    - `loop`: `"open"`, or `"closed"` when u is feedback of the measured x, noise included.
    - `drive`: `"force"` (u is applied, x is the response) or `"motion"` (x is imposed, `force` is the response).
    - `start_time`: s since power-on; recordings of one warm-up share a clock.
    - `v`, `force`, `reference`, `temperature`, `normal_force`, `supply`: optional channels, shape `(n,)`.
    - `simulated`: the position that a simulation of the user's gives for the same input, position units, shape `(n,)`;
      with `drive = "motion"` the force, force units; None where there is none.
    - `integrated`: True where no position was measured: `x` is the integral of `v` from zero, which keeps the offset of
      the velocity sensor as a constant drift.
    - `warnings`: what the audit found, as sentences.
    - `sampling`: how far the file's time stamps were from a uniform grid.
    - `plant`: the machine, as its case describes it; None when nothing is known of it.
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
    simulated: Float[np.ndarray, " n"] | None = None
    integrated: bool = eqx.field(static=True, default=False)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    sampling: Sampling = Sampling()
    plant: Plant | None = None

    def _display(self) -> Display:
        kind = "motion imposed" if self.drive == "motion" else f"{self.loop} loop"
        role = "held out" if self.role == "holdout" else "to fit"
        title = (
            f"Recording {self.name}: {self.x.size} samples at {self.sample_rate:g} Hz, {self.duration:.4g} s, {role}, "
            f"{kind}"
        )
        units = self._units()
        rows = [(name, getattr(self, name)) for name in _CHANNELS]
        shown = tuple(signal_row(name, v, units.get(name, "")) for name, v in rows if v is not None)
        return Display(title, self.warnings, (TextGrid(SIGNALS, shown),))

    def to_dataframe(self) -> Any:
        """A pandas DataFrame over `t` (s), with a column for each channel."""
        channels = {name: getattr(self, name) for name in _CHANNELS if getattr(self, name) is not None}
        return to_dataframe({"t": self.t, **channels}, {"t": "s", **self._units()}, index="t")

    def to_xarray(self) -> Any:
        """An xarray Dataset over `t` (s), with a variable for each channel."""
        arrays = {
            name: (("t",), getattr(self, name)) for name in _CHANNELS if getattr(self, name) is not None
        }
        units = {name: unit for name, unit in self._units().items() if name in arrays}
        return to_xarray(
            arrays, {"t": self.t}, {"t": "s", **units}, name=self.name, sample_rate=self.sample_rate
        )

    def plot(self, **how: Any) -> Any:
        """Draw every channel over time: `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def _units(self) -> dict[str, str]:
        plant = self.plant or Plant()
        units = {"u": plant.input_unit, "x": plant.position_unit, "v": f"{plant.position_unit}/s"}
        answer = plant.force_unit if self.drive == "motion" else plant.position_unit
        return {**units, "force": plant.force_unit, "simulated": answer}

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


class Case(AbstractDisplayed):
    """A plant and its recordings.

    **Attributes:**

    - `name`: the case's name.
    - `plant`: the `Plant`; each of the recordings is given it, so that what is known of the machine goes with them.
    - `recordings`: all recordings, in the order of the case file.
    - `model`: the user's own model of the machine; None where there is none.
    - `controller`: that of the recordings made in closed loop; None where it is not known.
    """

    name: str = eqx.field(static=True)
    plant: Plant
    recordings: tuple[Recording, ...]
    model: GivenModel | None = None
    controller: Controller | None = None

    def __init__(
        self,
        name: str,
        plant: Plant,
        recordings: Sequence[Recording],
        model: GivenModel | None = None,
        controller: Controller | None = None,
    ) -> None:
        self.name, self.plant, self.model, self.controller = name, plant, model, controller
        self.recordings = tuple(
            one if one.plant is plant else dataclasses.replace(one, plant=plant) for one in recordings
        )

    def _display(self) -> Display:
        rows = tuple(
            (
                one.name,
                "held out" if one.role == "holdout" else "fit",
                f"{one.sample_rate:g} Hz",
                f"{one.duration:.4g} s",
                "motion imposed" if one.drive == "motion" else f"{one.loop} loop",
                str(len(one.warnings)),
            )
            for one in self.recordings
        )
        head = ("recording", "role", "sample rate", "length", "experiment", "warnings")
        return Display(f"Case {self.name}", (repr(self.plant),), (TextGrid(head, rows),))

    def plot(self, **how: Any) -> Any:
        """Draw position and input (or measured force) of each recording over time: `frictionjax.plot`, with `how` as
        there."""
        return public_verb("plot")(self, **how)

    @property
    def fit_recordings(self) -> tuple[Recording, ...]:
        """The recordings that fits and the naming of effects use."""
        return tuple(r for r in self.recordings if r.role == "fit")

    @property
    def holdout_recordings(self) -> tuple[Recording, ...]:
        """The held-out recordings, for validation."""
        return tuple(r for r in self.recordings if r.role == "holdout")
