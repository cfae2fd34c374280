"""The ceiling: how much any force of what is known at each instant would explain of held-out recordings.

The model is given a force that is free in position, velocity, the bristle's deflection, the distance since the last
reversal, the last rest, input and time (`free_force`), with its own parameters free beside it. Its heights are found on
the fitted recordings by re-weighted least squares on simulated responses; in which of the variables it is free, and how
far its heights are held back, is chosen by cross-validation there. Held-out recordings judge the result, and choose
nothing but their own starting deflections.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force, floor_of, quietness
from frictionjax.diagnosis.findings.free_force import RegressorGroup, free_force, together
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.linearised import Present, present_model
from frictionjax.diagnosis.screening.score_test import LONGEST_STEP
from frictionjax.diagnosis.selection.conclusion import is_above
from frictionjax.diagnosis.table import ModelComparison
from frictionjax.diagnosis.verdict import Ceiling, OneStep
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.pieces import put_together
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.misfit import losses_of, misfit_of
from frictionjax.estimation.objective.quadratic import all_columns

_PROBE = 0.02  # of Coulomb friction: a force whose response is simulated
_A_PERIOD = 8.0  # samples that are kept in a period of the observer's bandwidth
_HELD_BACK = np.logspace(2.0, -6.0, 9)  # inverse variances of heights over Coulomb friction, in a sample
_FOLDS = 5
_SOME = 8  # forces that are simulated side by side
_PASSES, _TURNS = 2, 4  # of linearising, of re-weighting in each
_DAMPING = (1.0, 0.5, 0.2)


_Part = tuple[Float[np.ndarray, "s s"], Float[np.ndarray, " s"], float]
"""The normal equations of a part of the recordings, and its cost without a step."""


class _Fit(NamedTuple):
    """A model with a force: its `vector`, the `heights` over Coulomb friction, the `power` that it leaves."""

    vector: Float[np.ndarray, " q"]
    heights: Float[np.ndarray, " k"]
    power: Float[np.ndarray, "r b"]
    errors: Float[np.ndarray, "r n"]


def ceiling_of(
    model: Model,
    scene: Scene,
    since: Float[np.ndarray, " r"],
    *,
    base: Model | None = None,
    rule: Rule = Rule(),
) -> tuple[Ceiling | None, ModelComparison | None]:
    """How much more than the `model` a model with a free force explains.

    **Arguments:**

    - `model`: the last model, with what was accepted.
    - `scene`: its recordings.
    - `since`: s since power-on of the first sample of each.
    - `base`: the base model, for how far it is from the noise; None where the `model` is it.
    - `rule`: when the free force is significant.

    **Returns:** what it comes to, and the model with a free force against the one without it (None where there is
    nothing to explain); nothing where the motion is imposed.
    """
    posterior, batch = model.posterior, model.posterior.batch
    if not isinstance(batch, Batch):
        return None, None
    # Above the noise of the sensor alone: an unmeasured force may be what is missing.
    answer = answer_to_force(posterior, np.asarray(model.fitted.vector), rule=rule)
    floor = floor_of(0.0, answer, quietness(model.judgement.power, answer, posterior))
    left = model.judgement.misfits(floor)[1]
    if left <= rule.limits.adequate:
        return Ceiling(left, left, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, "", False), None
    search = _Search(model)
    present = search.present
    x, v, z = _motion(present)
    drive = model.judgement.drive
    groups = free_force(x, v, z, np.asarray(batch.u), drive, scene, since)
    fit, groups = search.run(groups)
    reached, before = (
        Judgement(drive, one.vector, one.power, model.judgement.held_out, batch)
        for one in (fit, search.first)
    )
    found = compare(before, reached, floor, rule=rule)
    judged = (before if base is None else base.judgement, before, reached)
    return _reported(found, fit, groups, model, _one_step(judged, scene, floor), rule), found


def _one_step(
    judged: tuple[Judgement, ...], scene: Scene, floor: Float[np.ndarray, "#r #b"]
) -> tuple[OneStep, ...]:
    """How far each of the models that were `judged` is from the noise `floor` in each held-out recording of the
    `scene`."""
    found = []
    for one in judged:
        loss, count = losses_of(one.power, one.batch, floor), np.asarray(one.batch.block_count)
        misfit = loss.sum(axis=1) / np.maximum(count.sum(axis=1), 1.0)
        # The power at which every sample has this misfit.
        found.append(np.sqrt(np.maximum(2.0 * np.exp(2.0 * misfit) - 1.0, 0.0)))
    rows = np.flatnonzero(scene.held_out)
    return tuple(OneStep(scene.names[row], *(float(ratio[row]) for ratio in found)) for row in rows)


def _reported(
    found: ModelComparison,
    fit: _Fit,
    groups: tuple[RegressorGroup, ...],
    model: Model,
    recordings: tuple[OneStep, ...],
    rule: Rule,
) -> Ceiling:
    batch, drive, gains = model.posterior.batch, model.judgement.drive, found.gains(rule)
    inside, Fc = np.asarray(batch.valid) > 0.0, float(drive.friction.Fc)
    force = Fc * np.tensordot(fit.heights, together(groups), 1) if groups else np.zeros(inside.shape)
    applied = float(drive.motor_constant) * np.asarray(batch.inputs)[inside]
    rms = float(np.sqrt(np.mean(force[inside] ** 2)))
    return Ceiling(
        misfit_model=found.misfits_before[1],
        misfit_free=found.misfits_after[1],
        share_fit=float(gains.share_fit),
        share_holdout=float(gains.share_holdout),
        lead=float(gains.lead_holdout),
        force=rms,
        of_coulomb=rms / max(Fc, 1e-300),
        of_applied=rms / max(float(np.sqrt(np.mean(applied**2))), 1e-300),
        variable=", ".join(group.variable for group in groups),
        above=is_above(found, rule),
        recordings=recordings,
    )


def _motion(present: Present) -> tuple[Float[np.ndarray, "r n"], ...]:
    """Position, velocity and deflection of the bristle as the model observes them."""
    recordings, motion = present.posterior.recordings, present.motion
    assert isinstance(recordings, Observed) and motion is not None
    pieces = [piece for piece, _ in recordings.in_pieces()]
    return tuple(
        put_together(
            [(piece, np.asarray(getattr(own, name))) for piece, own in zip(pieces, motion, strict=True)],
            recordings.rows,
            recordings.samples,
        )
        for name in ("x", "v", "z")
    )


class _Search:
    """Heights of a free force beside the parameters of a model."""

    def __init__(self, model: Model) -> None:
        posterior = model.posterior
        self.fitted: Bool[np.ndarray, " r"] = np.asarray(posterior.fitted[0]) > 0
        everywhere = dataclasses.replace(posterior, fitted=(np.ones_like(np.asarray(posterior.fitted[0])),))
        self.present = present_model(everywhere, np.asarray(model.fitted.vector))
        own = self.present.posterior
        self.batch, self.count = own.batch, own.parameters
        self.friction = float(model.judgement.drive.friction.Fc)
        evaluation = own.evaluated(self.present.vector)[0]
        bandwidth = float(np.min(own.recordings.bandwidth))  # type: ignore[attr-defined]
        self.every = max(1, int(1.0 / (_A_PERIOD * bandwidth * float(np.max(np.asarray(self.batch.dt))))))
        self.base = self._thinned(all_columns(evaluation))
        none = np.zeros(0)
        self.first = _Fit(
            np.asarray(self.present.vector),
            none,
            np.asarray(block_power(np.asarray(evaluation.e), self.batch)),
            np.asarray(evaluation.e),
        )

    def run(self, groups: tuple[RegressorGroup, ...]) -> tuple[_Fit, tuple[RegressorGroup, ...]]:
        """The model with a force of those of the `groups` that predict parts of the fitted recordings that were left
        out, each column over Coulomb friction; and these groups."""
        nothing = np.zeros_like(self.first.errors)
        responses = [self._responses(group.columns, self.first, nothing) for group in groups]
        chosen, held_back = self._chosen(responses)
        if not chosen:
            return self.first, ()
        kept = tuple(groups[number] for number in chosen)
        columns = together(kept)
        now = self.first._replace(heights=np.zeros(len(columns)))
        found = np.concatenate([responses[number] for number in chosen])
        for _ in range(_PASSES):
            before = now
            now = self._descended(now, np.concatenate([self.base, found]), held_back, columns)
            if now is before:
                break
            # What a force does depends on what is there already, where a break-away comes sooner or later.
            found = self._responses(columns, now, self.friction * np.tensordot(now.heights, columns, 1))
        return self._settled(now, columns), kept

    def _descended(
        self,
        now: _Fit,
        design: Float[np.ndarray, "s r m"],
        held_back: float,
        columns: Float[np.ndarray, "k r n"],
    ) -> _Fit:
        """The fit after some turns of re-weighting with one `design`."""
        least = self._misfit(now.power)
        for _ in range(_TURNS):
            step = self._step(design, now, held_back)
            tried = self._after(now, [damping * step for damping in _DAMPING], columns)
            misfits = [self._misfit(one.power) for one in tried]
            best = int(np.argmin(misfits))
            if not misfits[best] < least:
                break
            now, least = tried[best], misfits[best]
        return now

    def _responses(
        self, columns: Float[np.ndarray, "k r n"], now: _Fit, force: Float[np.ndarray, "r n"]
    ) -> Float[np.ndarray, "k r m"]:
        """What each of the `columns`, times Coulomb friction, does to the innovations beside a `force`; thinned."""
        found = [self._thinned(now.errors[None])[:0]]
        for first in range(0, len(columns), _SOME):
            some = columns[first : first + _SOME]
            vectors = np.repeat(now.vector[None], len(some), axis=0)
            errors = self.present.with_forces(vectors, force + _PROBE * self.friction * some)
            found.append(self._thinned(np.nan_to_num(errors - now.errors) / _PROBE))
        return np.concatenate(found)

    def _thinned(self, values: Float[np.ndarray, "k r n"]) -> Float[np.ndarray, "k r m"]:
        """Means of as many samples as the observer's bandwidth needs no finer."""
        values = np.asarray(values)
        more = -values.shape[2] % self.every
        padded = np.pad(values, ((0, 0), (0, 0), (0, more)))
        return padded.reshape(*values.shape[:2], -1, self.every).mean(-1)

    def _weights(self, power: Float[np.ndarray, "r b"]) -> Float[np.ndarray, "r m"]:
        """Weight of each thinned sample: that of its block with the Cauchy loss at the noise."""
        weight = np.asarray(self.present.posterior.sample_weight) * np.asarray(self.batch.valid)
        weight = weight * np.repeat(1.0 / (power + 1.0), self.batch.block, axis=-1)
        return self._thinned(weight[None])[0]

    def _misfit(self, power: Float[np.ndarray, "r b"]) -> float:
        return misfit_of(power, self.fitted.astype(float), self.batch)

    def _normal(
        self,
        design: Float[np.ndarray, "s r m"],
        errors: Float[np.ndarray, "r m"],
        weight: Float[np.ndarray, "r m"],
        rows: Bool[np.ndarray, " r"],
    ) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, " s"]]:
        tall = (design * weight)[:, rows].reshape(len(design), -1)
        return tall @ design[:, rows].reshape(len(design), -1).T, tall @ errors[rows].ravel()

    def _penalty(self, size: int, held_back: float, weight: float) -> Float[np.ndarray, "s s"]:
        """Of the parameters their prior, of the heights `held_back`, in a mean sample of the `weight`."""
        prior = np.asarray(self.present.posterior.prior) ** 2
        heights = np.full(size - prior.size, held_back * weight)
        return np.diag(np.concatenate([0.5 * prior + 1e-9, heights]))

    def _chosen(self, responses: list[Float[np.ndarray, "_ r m"]]) -> tuple[list[int], float]:
        """Which groups of columns, by their `responses`, predict parts of the fitted recordings that were left out, one
        after the other, and how far their heights are held back."""
        design = np.concatenate([self.base, *responses])
        errors, weight = self._thinned(self.first.errors[None])[0], self._weights(self.first.power)
        parts = []
        for inside in self._folds(weight):
            left = float(np.sum((inside * errors**2)[self.fitted]))
            parts.append((*self._normal(design, errors, inside, self.fitted), left))
        total = float(np.sum(weight[self.fitted]))
        ends = len(self.base) + np.cumsum([0, *(len(own) for own in responses)])
        own = [np.arange(ends[number], ends[number + 1]) for number in range(len(responses))]
        base = np.arange(len(self.base))
        chosen: list[int] = []
        best, least = self._left_out(parts, base, np.inf, total), np.inf
        while len(chosen) < len(own):
            tried = [
                (
                    self._left_out(
                        parts, np.concatenate([base, *(own[k] for k in (*chosen, number))]), value, total
                    ),
                    number,
                    value,
                )
                for number in range(len(own))
                if number not in chosen and own[number].size
                for value in _HELD_BACK
            ]
            if not tried:
                break
            costs, number, value = min(tried, key=lambda one: float(np.sum(one[0])))
            gains = best - costs
            if not np.mean(gains) > np.std(gains, ddof=1) / np.sqrt(gains.size):
                break
            chosen, best, least = [*chosen, number], costs, value
        return chosen, least

    def _folds(self, weight: Float[np.ndarray, "r m"]) -> list[Float[np.ndarray, "r m"]]:
        """The `weight` of the parts that are left out: fitted recordings, or stretches where these are few."""
        rows = np.flatnonzero(self.fitted)
        if rows.size >= _FOLDS - 1:
            return [weight * (np.arange(len(weight)) == row)[:, None] for row in rows]
        stretch = np.minimum(np.arange(weight.shape[1]) * _FOLDS // weight.shape[1], _FOLDS - 1)
        return [weight * (stretch == number) for number in range(_FOLDS)]

    def _left_out(
        self, parts: list[_Part], places: Int[np.ndarray, " k"], held_back: float, total: float
    ) -> Float[np.ndarray, " f"]:
        """Cost of each of the `parts` with coordinates at the `places` from the other parts."""
        square = np.ix_(places, places)
        gram = np.sum([part[0] for part in parts], axis=0)[square]
        right = np.sum([part[1] for part in parts], axis=0)[places]
        costs = []
        for own_gram, own_right, left in parts:
            own_gram, own_right = own_gram[square], own_right[places]
            step = self._solved(gram - own_gram, right - own_right, held_back, total)
            costs.append(left + 2.0 * step @ own_right + step @ own_gram @ step)
        return np.array(costs)

    def _solved(
        self, gram: Float[np.ndarray, "s s"], right: Float[np.ndarray, " s"], held_back: float, weight: float
    ) -> Float[np.ndarray, " s"]:
        penalty = self._penalty(len(right), 0.0 if np.isinf(held_back) else held_back, weight)
        return -np.linalg.solve(gram + penalty, right)

    def _step(
        self, design: Float[np.ndarray, "s r m"], now: _Fit, held_back: float
    ) -> Float[np.ndarray, " s"]:
        errors, weight = self._thinned(now.errors[None])[0], self._weights(now.power)
        gram, right = self._normal(design, errors, weight, self.fitted)
        total = float(np.sum(weight[self.fitted]))
        right[len(self.base) :] += held_back * total * now.heights
        return self._solved(gram, right, held_back, total)

    def _after(
        self, now: _Fit, steps: list[Float[np.ndarray, " s"]], columns: Float[np.ndarray, "k r n"]
    ) -> list[_Fit]:
        """The fits after each of the `steps`."""
        many = len(self.base)
        vectors = [now.vector + np.clip(step[:many], -LONGEST_STEP, LONGEST_STEP) for step in steps]
        return self._simulated(vectors, [now.heights + step[many:] for step in steps], columns)

    def _simulated(
        self,
        vectors: list[Float[np.ndarray, " q"]],
        heights: list[Float[np.ndarray, " k"]],
        columns: Float[np.ndarray, "k r n"],
    ) -> list[_Fit]:
        forces = self.friction * np.tensordot(np.stack(heights), columns, 1)
        errors = self.present.with_forces(np.stack(vectors), forces)
        powers = np.asarray(block_power(errors, self.batch))
        return [_Fit(*one) for one in zip(vectors, heights, powers, errors, strict=True)]

    def _settled(self, fit: _Fit, columns: Float[np.ndarray, "k r n"]) -> _Fit:
        """The `fit` with the starting deflections of the held-out recordings from these themselves."""
        weight, errors = self._weights(fit.power), self._thinned(np.nan_to_num(fit.errors)[None])[0]
        vector = np.array(fit.vector)
        for row in np.flatnonzero(~self.fitted):
            own = self.base[self.count + row, row]
            size = float(np.sum(weight[row] * own**2))
            if size > 0.0:
                change = -float(np.sum(weight[row] * own * errors[row])) / size
                vector[self.count + row] += np.clip(change, -LONGEST_STEP, LONGEST_STEP)
        [other] = self._simulated([vector], [fit.heights], columns)
        better = misfit_of(other.power, (~self.fitted).astype(float), self.batch)
        return other if better < misfit_of(fit.power, (~self.fitted).astype(float), self.batch) else fit
