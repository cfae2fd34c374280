"""The audit of a recording: the quality of its channels, and the regimes of friction it visits."""

import math
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core.json import plain_json
from frictionjax.core.quantities import in_unit
from frictionjax.recordings.recording import JITTER_TOLERANCE, Plant, Recording, Sampling
from frictionjax.recordings.regimes import Regimes, find_regimes
from frictionjax.recordings.signals import Clipping, clipping, noise_std, on_grid, processing, quantum

_CHANNELS = ("u", "x", "v", "force", "reference", "temperature", "normal_force", "supply", "simulated")
_SLOW = 20.0  # Hz; below this, the time column of a servo's recording is more likely in ms
_PROCESSING = {
    "held": " repeats each value: the sensor is slower than the sample rate, and short times carry no information",
    "interpolated": " runs in straight lines between samples: it was interpolated before it was stored, "
    "which delays it and hides the noise",
    "smooth": " has no noise near the Nyquist frequency: it was low-pass filtered or interpolated before it was "
    "stored, or simulated without noise",
}


class Audit(eqx.Module):
    """What a recording contains, found without a model.

    **Attributes:**

    - `recording`: its name.
    - `sample_rate` (Hz), `samples`, `duration` (s).
    - `sampling`: jitter and gaps of the file's time stamps.
    - `not_finite`: channel to number of NaN or infinite values, for channels that have any.
    - `constant`: channels that never change.
    - `clipped`: channel to `Clipping`, for u, v and force where present.
    - `noise_std`: standard deviation of the white noise of x, quantisation included, position units.
    - `encoder_step`: quantum of x as the data show it, position units; None when x lies on no grid.
    - `declared_step`: the plant's encoder step, position units; None when it is unknown.
    - `on_declared_grid`: part of the differences of x that are whole declared steps; NaN when x moves too little,
      None when no step is declared.
    - `processing`: `"held"`, `"interpolated"`, `"smooth"` or `""`: traces of earlier processing of x.
    - `regimes`: rest, presliding and sliding.
    - `position_unit`: the unit of all numbers; `position_shown`: that of the sentences, where it is another one.
    - `measured`: the channel that noise, grid and processing are those of: `"x"`; `"v"`, per second, where x is its
      integral.
    """

    recording: str = eqx.field(static=True)
    sample_rate: float = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    duration: float = eqx.field(static=True)
    sampling: Sampling
    not_finite: dict[str, int] = eqx.field(static=True)
    constant: tuple[str, ...] = eqx.field(static=True)
    clipped: dict[str, Clipping]
    noise_std: float = eqx.field(static=True)
    encoder_step: float | None = eqx.field(static=True)
    declared_step: float | None = eqx.field(static=True)
    on_declared_grid: float | None = eqx.field(static=True)
    processing: str = eqx.field(static=True)
    regimes: Regimes
    position_unit: str = eqx.field(static=True)
    position_shown: str = eqx.field(static=True, default="")
    measured: str = eqx.field(static=True, default="x")

    def to_json(self) -> dict[str, Any]:
        """The audit as plain JSON; numbers that are not finite become null."""
        return plain_json(self)

    def sentences(self) -> tuple[str, ...]:
        """All findings of the audit as sentences, those that need attention last."""
        r = self.regimes
        unit, (noise, *speeds) = self._shown(self.noise_std, *(r.speed or ()))
        step = self.encoder_step
        per = "/s" if self.measured == "v" else ""
        grid = "lies on no grid" if step is None else f"lies on a grid of {self._step(step)}{per}"
        speed = f", at {speeds[0]:.3g} to {speeds[1]:.3g} {unit}/s" if speeds else ""
        rests = f" of {min(r.rests):.2g} to {max(r.rests):.2g} s" if r.rests else ""
        return (
            f"{self.samples} samples at {self.sample_rate:.6g} Hz, {self.duration:.4g} s.",
            f"The noise of {self.measured} is {noise:.3g} {unit}{per} (standard deviation); {self.measured} {grid}.",
            f"At rest {r.rest:.0%} of the time, in presliding {r.presliding:.0%}, sliding {r.sliding:.0%}{speed}; "
            f"{_count(r.reversals, 'reversal')} in sliding, {_count(len(r.rests), 'rest')}{rests}.",
            *self.concerns(),
        )

    def concerns(self) -> tuple[str, ...]:
        """The findings that limit what this recording can show, as sentences."""
        found = []
        if said := self.sampling_sentence():
            found.append(said)
        found += [f"{name} has {_count(count, 'value')} that {'is' if count == 1 else 'are'} not a number; "
                  "the audit left them out." for name, count in self.not_finite.items()]  # fmt: skip
        if self.sample_rate < _SLOW:
            found.append(
                f"{self.sample_rate:.4g} samples a second are few: is the time column in seconds? Its unit can be "
                "given (units, or --unit t=ms)."
            )
        found += [f"{name} never changes." for name in self.constant]
        found += [
            f"{name} looks clipped: {c.high:.1%} of the samples are at its largest value, {c.low:.1%} at its smallest."
            for name, c in self.clipped.items()
            if c.clipped
        ]
        if self.processing:
            found.append(f"{self.measured}{_PROCESSING[self.processing]}.")
        found += self._grid_concerns()
        if self.regimes.rest > 0.99:
            found.append("x is at rest for more than 99 % of the recording.")
        return tuple(found)

    def sampling_sentence(self) -> str:
        """How the time stamps deviated from uniform, and how that was corrected; empty when they were uniform."""
        s, said = self.sampling, []
        if s.repeated:
            repeated = "row repeats" if s.repeated == 1 else "rows repeat"
            said.append(f"{s.repeated} {repeated} the row before, time included: left out.")
        if s.late:
            said.append(
                f"{_count(s.late, 'time stamp')} came late and none is missing, as the clock caught up: the samples "
                "were put back between their neighbours."
            )
        if s.resampled:
            said.append(self._resampling_sentence())
        return " ".join(said)

    def _resampling_sentence(self) -> str:
        s = self.sampling
        faults = (
            [f"deviate from uniform steps by up to {s.jitter:.2g} of a step"]
            if s.jitter > JITTER_TOLERANCE
            else []
        )
        if s.gaps:
            time, length = max(s.gaps, key=lambda gap: gap[1])
            faults.append(
                f"have {_count(len(s.gaps), 'gap')} ({_count(s.missing, 'sample')} missing, longest gap "
                f"{length:.3g} s at {time:.6g} s)"
            )
        return (
            f"The time stamps {' and '.join(faults)}: x was interpolated and u averaged onto a uniform grid of "
            f"{self.sample_rate:.6g} Hz."
        )

    def _grid_concerns(self) -> list[str]:
        declared, found = self.declared_step, self.encoder_step
        if declared is None or self.on_declared_grid is None:
            return []
        if found is None:
            if not self.on_declared_grid <= 0.9:
                return []
            return [
                f"x does not lie on the grid of the encoder step ({self._step(declared)}): it was processed after "
                "the encoder, or the step is wrong."
            ]
        ratio = found / declared
        if abs(ratio - 1.0) < 0.01 or (ratio < 0.1 and self.on_declared_grid > 0.9):
            return []
        return [
            f"x lies on a grid of {self._step(found)}, {ratio:.3g} times the encoder step given "
            f"({self._step(declared)})."
        ]

    def _shown(self, *values: float) -> tuple[str, tuple[float, ...]]:
        """The unit of the sentences, and positions or speeds in it."""
        plant = Plant(position_unit=self.position_unit, position_shown=self.position_shown)
        return in_unit(plant.shown_position, *values)

    def _step(self, step: float) -> str:
        unit, (value,) = self._shown(step)
        return f"{value:.4g} {unit}"


def audit(recording: Recording, plant: Plant, *, gross_travel: float | None = None) -> Audit:
    """Examine a recording before anything is fitted to it.

    **Arguments:**

    - `recording`: the recording; values that are not finite are bridged for the estimates and counted.
    - `plant`: its units and the encoder step to compare with.
    - `gross_travel`: travel since a reversal that counts as sliding, position units; found from the data when None.

    **Returns:** the `Audit`.
    """
    channels = {name: getattr(recording, name) for name in _CHANNELS if getattr(recording, name) is not None}
    if recording.drive == "motion":
        del channels["u"]
    not_finite = {name: int(np.count_nonzero(~np.isfinite(values))) for name, values in channels.items()}
    channels = {name: _bridged(values) for name, values in channels.items()}
    x, name = channels["x"], "v" if recording.integrated else "x"
    measured, declared = channels[name], None if recording.integrated else plant.encoder_step
    noise, step = noise_std(measured), quantum(measured)
    resolution = max(noise if math.isfinite(noise) else 0.0, 0.3 * (step or 0.0))
    resolution /= recording.sample_rate if name == "v" else 1.0
    return Audit(
        recording=recording.name,
        sample_rate=recording.sample_rate,
        samples=x.size,
        duration=recording.duration,
        sampling=recording.sampling,
        not_finite={name: count for name, count in not_finite.items() if count},
        constant=tuple(name for name, values in channels.items() if np.ptp(values) == 0),
        clipped={name: clipping(channels[name]) for name in ("u", "v", "force") if name in channels},
        noise_std=noise,
        encoder_step=step,
        declared_step=declared,
        on_declared_grid=None if declared is None else on_grid(x, declared),
        processing=processing(measured, step),
        regimes=find_regimes(
            x,
            recording.sample_rate,
            resolution,
            force=channels.get("force") if recording.drive == "motion" else None,
            gross_travel=gross_travel,
            unit=plant.position_unit,
        ),
        position_unit=plant.position_unit,
        position_shown=plant.position_shown,
        measured=name,
    )


def _bridged(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The channel, interpolated over values that are not finite (zeros when none is finite)."""
    good = np.isfinite(values)
    if good.all() or not good.any():
        return values if good.all() else np.zeros_like(values)
    index = np.arange(values.size)
    return np.interp(index, index[good], values[good])


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
