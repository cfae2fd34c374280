"""What all rivals stand on: the base model before the recordings, its residuals, and every effect's column."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import jax.numpy as jnp
import numpy as np

import frictionjax as fj
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.views import View, view
from frictionjax.diagnosis.screening.linearised import Present, present_model
from frictionjax.diagnosis.screening.periods import wavelengths
from frictionjax.diagnosis.screening.score_test import forms_to_try
from frictionjax.estimation.data.batch import Batch, make_batch
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import AbstractEffect, catalogue


@dataclass(frozen=True)
class Column:
    """One small step of an effect, as changes of the innovations for each strength, shape `(k, r, n)`."""

    effect: str
    form: AbstractEffect
    posterior: Posterior
    vector: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Ground:
    """The base model `drive` before the recordings of a `case`; `posterior` and `vector` hold the same."""

    case: fj.Case
    drive: fj.Drive
    batch: Batch
    held_out: np.ndarray
    posterior: Posterior
    vector: np.ndarray
    scales: dict[str, float] = field(repr=False)

    @cached_property
    def present(self) -> Present:
        """The base model before the fitted recordings: innovations, weights, Jacobian, motion."""
        return present_model(self.posterior, jnp.asarray(self.vector))

    @cached_property
    def scene(self) -> Scene:
        """All recordings, as maps and pictures see them."""
        slowest = float(np.max(np.asarray(self.batch.dt)))
        names = tuple(r.name for r in self.recordings)
        return Scene(self.batch, self.held_out, min(SLOW_BANDWIDTH, 0.1 / slowest), names)

    @property
    def recordings(self) -> tuple:
        """In the order of the batch."""
        return self.case.fit_recordings + self.case.holdout_recordings

    def seen_by(self, drive: fj.Drive) -> View:
        """All recordings as `drive` sees them: free run, 0.1 s ahead, residual force."""
        rows = self.held_out.size
        nothing = Judgement(drive, jnp.zeros(rows), np.zeros((rows, 1)), self.held_out, self.batch)
        return view(nothing, self.scene)

    @cached_property
    def base_view(self) -> View:
        """All recordings as the base model sees them."""
        return self.seen_by(self.drive)

    @cached_property
    def columns(self) -> list[Column]:
        """One column set for every form of every effect of the catalogue, at every point of its grid."""
        present, dt = self.present, np.asarray(self.present.posterior.batch.dt)
        speed = np.gradient(np.asarray(present.posterior.batch.x), axis=1) / dt[:, None]
        e, batch = np.nan_to_num(np.asarray(present.e)), present.posterior.batch
        periods = {
            "odd_period": wavelengths(e, speed, batch, odd=True).periods,
            "even_period": wavelengths(e, speed, batch, odd=False).periods,
            "sensor_period": wavelengths(e, speed, batch, odd=False, count=2, fine=True).periods,
        }
        return [
            column
            for forms in catalogue().values()
            for form in forms
            for column in self._columns_of(form, periods)
        ]

    def _columns_of(self, form: type[AbstractEffect], periods: dict) -> list[Column]:
        present, stepped, sets = self.present, [], []
        for instance in forms_to_try(form, self.scales, periods):
            posterior, vector = extend(present.posterior, present.vector, instance, self.scales)
            names = {strength.name: strength.probes[0] for strength in instance.strengths}
            added = range(len(present.posterior.layout), len(posterior.layout))
            where = [(i, names[p.name]) for i in added if (p := posterior.layout[i].parameter).name in names]
            sets.append((instance, posterior, vector, [size for _, size in where]))
            stepped += [(posterior, jnp.asarray(vector).at[i].add(size)) for i, size in where]
        if not stepped:
            return []
        changed = present.injected([posterior for posterior, _ in stepped], [vector for _, vector in stepped])
        changes = np.asarray(changed - present.e[None])
        found, first = [], 0
        for instance, posterior, vector, sizes in sets:
            own = changes[first : first + len(sizes)] / np.asarray(sizes)[:, None, None]
            first += len(sizes)
            if np.all(np.isfinite(own)):
                found.append(Column(form.name, instance, posterior, np.asarray(vector), own))
        return found


def ground_of(case: fj.Case, base: dict[str, float]) -> Ground:
    """The ground of a `case` whose base model has the parameters `base` (J and those of LuGre)."""
    friction = fj.LuGre(**{k: base[k] for k in ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")})
    drive = fj.Drive(base.get("J", case.plant.inertia), friction, case.plant.motor_constant or 1.0)
    recordings = case.fit_recordings + case.holdout_recordings
    batch = make_batch(recordings, encoder_step=case.plant.encoder_step)
    held_out = np.array([r.role == "holdout" for r in recordings])
    fixed = frozenset() if case.plant.inertia is None else frozenset({"J"})
    posterior, vector = robust_posterior(drive, batch, held_out, fixed=fixed)
    scales = plant_scales(drive, batch)
    return Ground(case, drive, batch, held_out, posterior, np.asarray(vector), scales)
