"""The result of `diagnose`: nouns that mirror verdict.json, schema frictionjax.verdict/1."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate, InputError, public_verb
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid, estimate_row
from frictionjax.core.frames import estimate_columns, to_dataframe, to_xarray
from frictionjax.core.quantities import in_unit
from frictionjax.diagnosis.checked import Check
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.explain import explain_effect
from frictionjax.diagnosis.recording_fit import RecordingFit, Unmeasured
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import ComparisonTable, OtherDecision
from frictionjax.recordings import Plant

Verdict = Literal["adequate", "named", "unknown"]


class NextExperiment(eqx.Module):
    """An experiment that distinguishes two effects.

    **Attributes:** `between` (the two effects), `experiment` (in words), `d_prime` (distance of the two models in
    standard deviations, for one pass), `seconds` (how long it must last for a distance of 5), `u` (the input of one
    pass, input units, shape `(n,)`), `sample_rate` (Hz), `sentence`.
    """

    between: tuple[str, str] = eqx.field(static=True)
    experiment: str = eqx.field(static=True)
    d_prime: float = eqx.field(static=True)
    seconds: float = eqx.field(static=True)
    u: Float[np.ndarray, " n"]
    sample_rate: float = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


@dataclass(frozen=True)
class MissingEffect:
    """One named piece of missing physics.

    **Attributes:** `effect` (its name), `effect_class` (every effect that these recordings cannot distinguish from it,
    itself included), `confidence` in [0, 1], `p_value` under the model without it but with the effects named before
    it (it is from the round in which this one was found), `parameters` (name to `Estimate`), `where` (words: the
    place of the mismatch that this effect removes), `split_by` (the experiment that would distinguish the
    members of the class; empty when it has one), `sentence` (what the effect is, in plain words), `next_experiment` (a
    `NextExperiment` that distinguishes it from the nearest of its class, or None), `evidence` (the four numbers that
    `confidence` comes from: `Evidence` in `confidence.py`).
    """

    effect: str
    effect_class: tuple[str, ...]
    confidence: float
    p_value: float
    parameters: dict[str, Estimate]
    where: str
    split_by: str = ""
    sentence: str = ""
    next_experiment: NextExperiment | None = None
    evidence: tuple[float, ...] = ()


@dataclass(frozen=True)
class Unexplained:
    """What no effect of the catalogue explains: whether it is significant, `present`, its `share` of the excess, and
    `where`; the variable over which a nonparametric map of the residual force predicts held-out recordings,
    `carried_by` (empty when none does), and the share of their remaining misfit that the map `explains`."""

    present: bool
    share: float
    where: str
    carried_by: str = ""
    explains: float = 0.0


@dataclass(frozen=True)
class MismatchBin:
    """One bin of the map of the base model's mismatch.

    **Attributes:** `axis` (regime, time, velocity, position, direction, input, frequency, since_reversal, dwell),
    `bin` (its label, with units), `share` (part of the total excess; the shares of one axis add to 1), `excess`
    (standardised residual power over the noise floor), `excess_extended` (the same for the extended model),
    `count` (samples in the bin), `p_value` (family-wise: probability that noise alone raises any bin of the map as far;
    NaN when not computed).
    """

    axis: str
    bin: str
    share: float
    excess: float
    excess_extended: float = float("nan")
    count: int = 0
    p_value: float = float("nan")


@dataclass(frozen=True)
class Within:
    """Which part of another axis contains the excess of the strongest bins.

    **Attributes:** `axis`, `bin` (a bin of it, or all bins beyond one edge, with units), `phrase` (the same as words
    after "only"), `given` (the strongest bins, and the parts of other axes reported before), `share` (of their excess
    that lies in this part), `samples` (share of their samples that does), `excess` (power over the noise floor there),
    `excess_elsewhere` (in the rest of them), `p_value` (of equal power in both, corrected for all parts compared),
    `only` (whether almost all of the excess lies in this part).
    """

    axis: str
    bin: str
    phrase: str
    given: str
    share: float
    samples: float
    excess: float
    excess_elsewhere: float
    p_value: float
    only: bool = False


@dataclass(frozen=True)
class OneStep:
    """How far the innovations of a held-out recording are from the noise: root mean square over that of the noise
    floor, robust (from the misfit of its samples, which a few large errors do not rule).

    **Attributes:** `recording` (its name), `base`, `model`, `free` (the base model, the last model, and the last model
    with a free force).
    """

    recording: str
    base: float
    model: float
    free: float


@dataclass(frozen=True)
class Ceiling:
    """How much a force that is free in what is known at each instant would explain beside the last model.

    **Attributes:** `misfit_model`, `misfit_free` (per sample of the held-out recordings, above sensor noise, of the
    model without it and with it), `share_fit`, `share_holdout` (share of the misfit that it removes), `lead` (in
    standard errors, on held-out recordings), `force` (root mean square, force units), `of_coulomb`, `of_applied` (over
    Coulomb friction, over the applied force), `variable` (that carries most of it), `above` (whether it predicts
    held-out recordings significantly better), `recordings` (a `OneStep` for each held-out one; empty where no force was
    tried).
    """

    misfit_model: float
    misfit_free: float
    share_fit: float
    share_holdout: float
    lead: float
    force: float
    of_coulomb: float
    of_applied: float
    variable: str
    above: bool
    recordings: tuple[OneStep, ...] = ()


@dataclass(frozen=True)
class SimulationAsGiven:
    """How far the user's own simulation, as it was given, is from the recordings, and where it misses them.

    **Attributes:** `source` (`"column"`: the column `simulated` of the recordings; `"model"`: `[model]` with the values
    of the case), `sentence` (how far, beside base and extended model, and where), `where` (the places in words; empty
    where they are not known), `mismatch` (the map over the recordings that have a simulation: `excess` is that of the
    simulation, `excess_extended` that of the base model).
    """

    source: Literal["column", "model"]
    sentence: str
    where: str = ""
    mismatch: tuple[MismatchBin, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """One effect of the catalogue, and the evidence for it.

    **Attributes:** `effect`, `p_value`, `minimum_detectable` (parameter name to the smallest size, in its unit,
    that these recordings would show), `tested`, `reason` (why not tested, or why not named), `gain_fit` and
    `gain_holdout` (share of the base model's excess that a refit with it explains; NaN when not refitted),
    `one_step` (parameter name to its one-step estimate), `units` (parameter name to its unit, as text).
    """

    effect: str
    p_value: float
    minimum_detectable: dict[str, float]
    tested: bool
    reason: str
    gain_fit: float = float("nan")
    gain_holdout: float = float("nan")
    one_step: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


class Diagnosis(AbstractDisplayed):
    """What `diagnose` found.

    **Attributes:** `case` (name), `plant`, `verdict` (`"adequate"`, `"named"` or `"unknown"`), `summary` (the
    sentence), `missing` (strongest first), `unexplained`, `mismatch` (the map), `base` and `extended` (parameter
    name to `Estimate`), `recordings`, `candidates`, `warnings`, `seconds` (stage to s; `total` and `compile`),
    `given` (the user's own simulation as it was given, compared; None where there is none),
    `within` (which parts of other axes contain the excess of the strongest bins), `comparisons` (every comparison of
    two models that was made, one `ComparisonTable` a step), `decided` (what was decided by a few numbers instead), the
    `rule` and the `effort` with which it was made, the force that the last model needs beside it, `unmeasured`, and
    what a free force would explain beside it, `ceiling` (None where no effect was tested); and how the names fare on
    simulated machines, `check` (None until `check_diagnosis`).
    """

    case: str = eqx.field(static=True)
    plant: Plant
    verdict: Verdict = eqx.field(static=True)
    summary: str = eqx.field(static=True)
    missing: tuple[MissingEffect, ...]
    unexplained: Unexplained
    mismatch: tuple[MismatchBin, ...]
    base: dict[str, Estimate] = eqx.field(static=True)
    extended: dict[str, Estimate] = eqx.field(static=True)
    recordings: tuple[RecordingFit, ...]
    candidates: tuple[Candidate, ...]
    warnings: tuple[str, ...] = eqx.field(static=True)
    seconds: dict[str, float] = eqx.field(static=True)
    within: tuple[Within, ...] = ()
    comparisons: tuple[ComparisonTable, ...] = eqx.field(static=True, default=())
    decided: tuple[OtherDecision, ...] = eqx.field(static=True, default=())
    rule: Rule = eqx.field(static=True, default=Rule())
    effort: Effort = eqx.field(static=True, default=Effort())
    unmeasured: Unmeasured | None = eqx.field(static=True, default=None)
    ceiling: Ceiling | None = eqx.field(static=True, default=None)
    given: SimulationAsGiven | None = eqx.field(static=True, default=None)
    check: Check | None = eqx.field(static=True, default=None)

    @property
    def was_diagnosed(self) -> bool:
        """Whether the base model fitted well enough for effects to be tested."""
        return not self.candidates or any(one.tested for one in self.candidates)

    def held_out_rmse(self, kind: Literal["prediction", "free_run"] = "prediction") -> tuple[float, float]:
        """Root mean square error on the held-out recordings, each with the same weight: of the base model and of the
        extended one. `kind`: predicted 0.1 s ahead, or a free run from the start. Position units; force units under an
        imposed motion."""
        held_out = [fit for fit in self.recordings if fit.role == "holdout"]
        base, extended = (
            float(np.sqrt(np.mean([getattr(fit, f"{kind}_rmse_{model}") ** 2 for fit in held_out])))
            for model in ("base", "extended")
        )
        return base, extended

    def explain(self, effect: str) -> str:
        """Why `effect` was named or not, in a few sentences.

        Raises `InputError` for a name that is not in the catalogue.
        """
        return explain_effect(self, effect)

    def save(self, directory: str | Path) -> Path:
        """Write verdict.json, fit/*.csv and report.html into `directory`; returns it: `frictionjax.save_diagnosis`."""
        return public_verb("save_diagnosis")(self, directory)

    def _display(self) -> Display:
        base, final = self.base, self.extended if self.verdict != "adequate" else {}
        names = [*base, *(name for name in final if name not in base)]
        head = ("parameter", "base model", "standard error", "extended model", "standard error", "unit")
        rows = []
        for name in names:
            before = estimate_row(name, base[name])[1:3] if name in base else ("", "")
            after = estimate_row(name, final[name])[1:3] if name in final else ("", "")
            unit = (final.get(name) or base[name]).unit
            rows.append((name, *before, *after, "" if unit == "1" else unit))
        errors = tuple(
            (
                one.name,
                "held out" if one.role == "holdout" else "fit",
                *(f"{size:.3g}" for size in sizes),
                unit,
            )
            for one in self.recordings
            for unit, sizes in [self._errors(one)]
        )
        fits = ("recording", "role", "error 0.1 s ahead, base", "extended", "noise floor", "unit")
        named = [
            f"{one.effect}, confidence {one.confidence:.2f}"
            + (f", not distinguished from {', '.join(one.effect_class[1:])}" if one.effect_class[1:] else "")
            for one in self.missing
        ]
        title = f"Diagnosis of {self.case}: {self.verdict}" + (f" ({'; '.join(named)})" if named else "")
        some = self.warnings[:_WARNINGS]
        more = len(self.warnings) - len(some)
        checked = () if self.check is None else self.check.sentences
        sentences = (self.summary, *checked, *some, *([f"{more} more warnings."] if more else []))
        return Display(title, sentences, (TextGrid(fits, errors), TextGrid(head, tuple(rows))))

    def _errors(self, one: RecordingFit) -> tuple[str, tuple[float, ...]]:
        """The unit in which errors of a recording are shown; those of both models and the noise floor in it."""
        unit = self.plant.shown_force if one.drive == "motion" else self.plant.shown_position
        return in_unit(unit, one.prediction_rmse_base, one.prediction_rmse_extended, one.noise_floor)

    def plot(self, **how: Any) -> Any:
        """Draw the recording that the extended model improves most, the residual force, and where the mismatch is:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(
        self, what: Literal["parameters", "candidates", "mismatch", "errors"] = "parameters"
    ) -> Any:
        """A pandas DataFrame.

        **Arguments:**

        - `what`: `"parameters"` of the extended model, `"candidates"` (every effect and the evidence for it),
            `"mismatch"` (the map of the base model's mismatch), or `"errors"` of both models on each recording.

        **Raises:** `ValueError` for another word; `ImportError` where pandas is missing.
        """
        if what == "parameters":
            return to_dataframe(estimate_columns(self.extended), index="parameter")
        tables = {"candidates": self.candidates, "mismatch": self.mismatch, "errors": self.recordings}
        if what not in tables:
            raise ValueError(f"`what` is {what!r}; it must be one of: parameters, {', '.join(tables)}.")
        columns = {name: [getattr(one, name) for one in tables[what]] for name in _COLUMNS[what]}
        return to_dataframe(columns, index=_COLUMNS[what][0] if what != "mismatch" else None)

    def to_xarray(self, recording: str) -> Any:
        """An xarray Dataset over `t` (s) of one recording: measured, both models, and the residual force.

        **Arguments:**

        - `recording`: its name.

        **Raises:** `InputError` for a name that is not among the recordings.
        """
        found = next((one for one in self.recordings if one.name == recording), None)
        if found is None:
            names = ", ".join(one.name for one in self.recordings)
            raise InputError(
                f"there is no recording {recording!r}", place="`recording`", cure=f"Choose from {names}."
            )
        answer = self.plant.force_unit if found.drive == "motion" else self.plant.position_unit
        units = {"u": self.plant.input_unit, "x": self.plant.position_unit, "force": self.plant.force_unit}
        units |= dict.fromkeys(_MODELS, answer) | dict.fromkeys(_RESIDUALS, self.plant.force_unit)
        names = [
            name for name in ("u", "x", "force", *_MODELS, *_RESIDUALS) if getattr(found, name) is not None
        ]
        arrays = {name: (("t",), getattr(found, name)) for name in names}
        return to_xarray(arrays, {"t": found.t}, {"t": "s", **{n: units[n] for n in names}}, name=found.name)


_WARNINGS = 4  # that the short text lists
_MODELS = ("free_base", "free_extended", "free_given", "predicted_base", "predicted_extended")
_RESIDUALS = ("residual_force", "residual_force_extended", "residual_force_std")
_COLUMNS = {
    "candidates": ("effect", "tested", "p_value", "gain_fit", "gain_holdout", "reason"),
    "mismatch": ("axis", "bin", "share", "excess", "excess_extended", "count", "p_value"),
    "errors": (
        *("name", "role", "noise_floor", "free_run_rmse_base", "free_run_rmse_extended"),
        *(
            "prediction_rmse_base",
            "prediction_rmse_extended",
            "increment_rmse_base",
            "increment_rmse_extended",
        ),
        *("free_run_rmse_given", "increment_rmse_given", "prediction_rmse_given"),
    ),
}
