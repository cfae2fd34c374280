"""Locate the mismatch: where the base model fails, before any effect is named.

Excess power of the standardised innovations over the noise floor, in bins of regime, direction, velocity, position,
input, time or distance since a reversal, dwell, time and frequency. The shares of one axis add to 1. The floor is an
absolute reference, so that a mismatch of all samples is found as well as a local one.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.views import View
from frictionjax.diagnosis.mismatch_map.axes import EstimatedMotion, MapAxis, axes_of
from frictionjax.diagnosis.mismatch_map.bin_power import Tally, tally_of
from frictionjax.diagnosis.mismatch_map.conditions import parts_within
from frictionjax.diagnosis.mismatch_map.frequency_bands import Bands, bands_of
from frictionjax.diagnosis.mismatch_map.null_maps import Chance, chance_of, statistic_of
from frictionjax.diagnosis.mismatch_map.where_words import divergence, lead_of, where_words
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import MismatchBin, Within
from frictionjax.physics import Drive
from frictionjax.recordings import Plant


class Located(eqx.Module):
    """Where the base model fails.

    **Attributes:** `bins` (the map), `within` (which parts of other axes contain the excess of its strongest bins),
    `where` (both in words).
    """

    bins: tuple[MismatchBin, ...]
    within: tuple[Within, ...]
    where: str = eqx.field(static=True)


class MismatchGrid(eqx.Module):
    """The bins of a map of the mismatch, and what chance makes of them.

    **Attributes:** `axes` (from `axes_of`), `scene` (the recordings), `level` (power that a true model leaves at each
    sample, shape `(r, n)`), `tally` and `bands` (the bins), `chance` (distribution of the map under noise alone).
    """

    axes: tuple[MapAxis, ...]
    scene: Scene
    level: Float[np.ndarray, "r n"]
    tally: Tally
    bands: Bands
    chance: Chance

    def located(self, base: View, extended: View, *, rule: Rule = Rule()) -> Located:
        """Where the `base` model fails, beside what the `extended` one leaves; `rule`: which places are reported."""
        return self._map(base, extended, gained=False, rule=rule)

    def explained(self, before: View, after: View, *, rule: Rule = Rule()) -> str:
        """In words, where the errors of the model `after` an effect was added are smaller than those `before`; `rule`:
        which places are reported."""
        return self._map(before, after, gained=True, rule=rule).where

    def _map(self, before: View, after: View, *, gained: bool, rule: Rule) -> Located:
        """The map over all recordings of the power `before`, or of the part of it that is `gained`."""
        e = np.stack([np.nan_to_num(view.e) / np.sqrt(self.level) for view in (before, after)])
        squares, lines = e**2, self.bands.powers(e)
        if gained:
            squares[0] += np.where(np.asarray(self.scene.batch.valid) > 0, 1.0, 0.0) - squares[1]
            lines[:, 0] += 1.0 - lines[:, 1]
        power, errors = self.tally.powers(self.tally.sums(squares), rule)
        power = np.concatenate([power, lines])
        errors = np.concatenate([errors[:, 0], np.zeros(len(self.bands.labels))])
        p_values = self.chance.p_values(statistic_of(power[:, 0], errors, self.chance.spread))
        axes = self.axes
        names = [(number, axes[number].name, axes[number].labels[k]) for number, k in self.tally.bins]
        names += [(len(axes), "frequency", label) for label in self.bands.labels]
        counts = [*self.tally.samples.tolist(), *self.bands.lines.tolist()]
        weights = np.concatenate([self.tally.samples, self.bands.null])
        rows = [
            MismatchBin(name, label, 0.0, float(here), float(then), count, float(p))
            for (_, name, label), (here, then), count, p in zip(names, power, counts, p_values, strict=True)
        ]
        grouped = itertools.groupby(range(len(rows)), key=lambda i: names[i][0])
        maps = [_with_shares(rows, weights, list(members)) for _, members in grouped]
        bins = tuple(itertools.chain.from_iterable(_most_telling(maps)))
        unions = unions_of(bins, axes)
        lead = lead_of(bins, unions, rule=rule)
        within = parts_within(lead, axes, squares[0], self.scene, rule=rule) if lead else ()
        return Located(bins, within, where_words(bins, unions, within, gained=gained, rule=rule))


def grid_of(
    axes: tuple[MapAxis, ...],
    scene: Scene,
    floor: Float[np.ndarray, "r b"] | None = None,
    chance: Chance | None = None,
    mapping: Callable[..., Iterable] = map,
    *,
    rule: Rule = Rule(),
) -> MismatchGrid:
    """The bins of a map of the `scene`.

    **Arguments:**

    - `axes`: from `axes_of`.
    - `scene`: the recordings.
    - `floor`: power of each block that a perfect model leaves, shape `(r, b)`; 1 everywhere when None.
    - `chance`: distribution of the map under noise alone; drawn when None.
    - `mapping`: as `map`; that of an executor draws in parallel.
    - `rule`: how many samples and clusters a bin needs.
    """
    level = floor_of_samples(floor, scene)
    tally, bands = tally_of(axes, scene, rule), bands_of(scene, level)
    chance = chance_of(tally, bands, scene, level, mapping=mapping, rule=rule) if chance is None else chance
    return MismatchGrid(axes, scene, level, tally, bands, chance)


def grid_along(
    base: View,
    drive: Drive,
    plant: Plant,
    scene: Scene,
    floor: Float[np.ndarray, "r b"],
    mapping: Callable[..., Iterable] = map,
    *,
    rule: Rule = Rule(),
) -> MismatchGrid:
    """The bins of `grid_of` along the axes that suit the recordings.

    **Arguments:**

    - `base`: what the base model predicts; its observed motion says in which bin a sample lies.
    - `drive`: the base model.
    - `plant`: for units.
    - `scene`, `floor`, `mapping`, `rule`: as in `grid_of`.
    """
    batch = scene.batch
    inputs = np.zeros(batch.x.shape) if batch.inputs is None else np.asarray(batch.inputs)
    axes = axes_of(EstimatedMotion(np.asarray(batch.x), base.v, base.bend, inputs), drive, plant, scene)
    if batch.inputs is None:
        axes = tuple(axis for axis in axes if axis.name != "input")
    return grid_of(axes, scene, floor, mapping=mapping, rule=rule)


def unions_of(bins: tuple[MismatchBin, ...], axes: tuple[MapAxis, ...]) -> tuple[MismatchBin, ...]:
    """The unions of the `bins` that the `axes` define, as one bin each, with the smallest of their p-values."""
    found = []
    for axis in axes:
        known = {b.bin: b for b in bins if b.axis == axis.name}
        for union in axis.unions:
            own = [known[axis.labels[k]] for k in union.bins if axis.labels[k] in known]
            if not own or not set(known) <= set(axis.labels):  # the other partition was kept
                continue
            weight = [b.count / sum(b.count for b in own) for b in own]
            found.append(
                MismatchBin(
                    axis.name,
                    union.label,
                    sum(b.share for b in own),
                    sum(w * b.excess for w, b in zip(weight, own, strict=True)),
                    sum(w * b.excess_extended for w, b in zip(weight, own, strict=True)),
                    sum(b.count for b in own),
                    min(b.p_value for b in own),
                )
            )
    return tuple(found)


def floor_of_samples(floor: Float[np.ndarray, "r b"] | None, scene: Scene) -> Float[np.ndarray, "r n"]:
    """The `floor` of each block, shape `(r, b)`, at each sample of the `scene`, shape `(r, n)`; 1 when it is None."""
    shape = np.asarray(scene.batch.valid).shape
    return np.ones(shape) if floor is None else np.repeat(np.maximum(floor, 1.0), scene.batch.block, axis=1)


def _with_shares(
    rows: list[MismatchBin], weights: Float[np.ndarray, " b"], members: list[int]
) -> list[MismatchBin]:
    """The bins of one axis, the `members` of `rows`, with their shares of the excess; `weights`: power of
    noise alone in each."""
    extra = np.array([max(rows[i].excess - 1.0, 0.0) * weights[i] for i in members])
    total = float(extra.sum())
    shares = extra / total if total > 0 else np.full(len(members), 1.0 / len(members))
    return [replace(rows[i], share=float(share)) for i, share in zip(members, shares, strict=True)]


def _most_telling(maps: list[list[MismatchBin]]) -> list[list[MismatchBin]]:
    """Of maps along one axis the one whose shares of the excess differ most from those of the samples (the divergence
    of Kullback and Leibler); the first of those alike."""
    best: dict[str, list[MismatchBin]] = {}
    for one in maps:
        axis = one[0].axis
        if axis not in best or _divergence(one) > _divergence(best[axis]) + 1e-9:
            best[axis] = one
    return list(best.values())


def _divergence(rows: list[MismatchBin]) -> float:
    total = sum(row.count for row in rows)
    return divergence((row.share for row in rows), (row.count / total for row in rows))
