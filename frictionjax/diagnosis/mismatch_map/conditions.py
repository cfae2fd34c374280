"""Whether the excess of the strongest bins of the map lies in one part of another axis alone.

Each bin of the other axes, and each union of them ("after rests longer than 0.3 s"), is compared with the rest of the
strongest bins. The scatter of a mismatch over time is unknown: the standard error of the logarithm of the ratio of the
two powers comes from clusters of 0.5 s. Its p-value, by Student's t with the degrees of freedom of Welch and
Satterthwaite, is corrected for the number of parts compared (Bonferroni).
"""

from dataclasses import replace

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.mismatch_map.axes import MapAxis
from frictionjax.diagnosis.mismatch_map.bin_power import clusters_of
from frictionjax.diagnosis.mismatch_map.where_words import divergence
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import MismatchBin, Within

_ASKED = ("dwell", "direction", "since_reversal", "position", "input", "time")


def parts_within(
    lead: tuple[MismatchBin, ...],
    axes: tuple[MapAxis, ...],
    power: Float[np.ndarray, "r n"],
    scene: Scene,
    *,
    rule: Rule = Rule(),
) -> tuple[Within, ...]:
    """Parts of other axes that contain the excess of the `lead`, one after the other: each within those before.

    **Arguments:**

    - `lead`: the strongest bins, all of one axis.
    - `axes`: from `axes_of`.
    - `power`: squares of the innovations over their floor, shape `(r, n)`.
    - `scene`: the recordings.
    - `rule`: what is reported.
    """
    scored = np.asarray(scene.batch.valid) > 0
    inside = scored & np.any([_inside(one, axes) for one in lead], axis=0)
    given, used, found = " or ".join(one.bin for one in lead), {lead[0].axis}, []
    for _ in range(rule.place.most_parts):
        left = [axis for axis in axes if axis.name in _ASKED and axis.name not in used]
        best = _strongest_part(left, inside, power, scene, given, rule)
        if best is None:
            break
        part, mask = best
        found.append(part)
        used.add(part.axis)
        inside, given = inside & mask, f"{given}, {part.bin}"
    return tuple(found)


def _inside(one: MismatchBin, axes: tuple[MapAxis, ...]) -> Bool[np.ndarray, "r n"]:
    for axis in axes:
        for label, _, bins in axis.parts() if axis.name == one.axis else ():
            if label == one.bin:
                return axis.inside(bins)
    raise ValueError(f"No axis `{one.axis}` has a bin `{one.bin}`.")


def _strongest_part(
    axes: list[MapAxis],
    inside: Bool[np.ndarray, "r n"],
    power: Float[np.ndarray, "r n"],
    scene: Scene,
    given: str,
    rule: Rule,
) -> tuple[Within, Bool[np.ndarray, "r n"]] | None:
    """The part of one of the `axes` that contains most of the excess `inside` in the fewest samples, with its mask;
    None when no part differs significantly from the rest."""
    selected, cluster = power[inside], clusters_of(scene)[inside]
    compared, found = 0, []
    for axis in axes:
        for label, phrase, bins in axis.parts():
            mask = axis.inside(bins)
            here = mask[inside]
            count = int(here.sum())
            if not is_a_part(count, selected.size, rule):
                continue
            p_value = more_power(selected, here, cluster, rule)
            if p_value is None:
                continue
            compared += 1
            high, low = float(selected[here].mean()), float(selected[~here].mean())
            extra = max(high - 1.0, 0.0) * count
            rest = max(low - 1.0, 0.0) * (selected.size - count)
            if extra > 0.0:
                share = extra / (extra + rest)
                samples = count / selected.size
                only = is_only(share, high, low, rule)
                part = Within(axis.name, label, phrase, given, share, samples, high, low, p_value, only)
                found.append((part, mask))
    clear = [(part, mask) for part, mask in found if is_condition(part, compared, rule)]
    if not clear:
        return None
    part, mask = max(clear, key=lambda one: _divergence(one[0]))
    return replace(part, p_value=part.p_value * compared), mask


def _divergence(part: Within) -> float:
    """How informative a part is: that of its share of the excess given its share of the samples."""
    return divergence((part.share, 1.0 - part.share), (part.samples, 1.0 - part.samples))


def is_a_part(count: int, samples: int, rule: Rule) -> bool:
    """Whether a part with this `count` of the `samples` may be a condition, by the `rule`: one with nearly all of them
    is not informative."""
    return (
        min(count, samples - count) >= rule.place.least_samples and count <= rule.place.largest_part * samples
    )


def is_condition(part: Within, compared: int, rule: Rule) -> bool:
    """Whether a `part`, of as many as were `compared`, is reported by the `rule`."""
    return (
        part.p_value * compared < rule.place.significant
        and part.share >= rule.place.part_share
        and part.excess - 1.0 >= rule.place.part_contrast * (part.excess_elsewhere - 1.0)
    )


def is_only(share: float, excess: float, elsewhere: float, rule: Rule) -> bool:
    """Whether almost all of the excess lies in a part: in total, by its `share`, and per sample, by its `excess` and
    that `elsewhere`; by the `rule`."""
    return share >= rule.place.only_share and elsewhere - 1.0 <= rule.place.only_rest * (excess - 1.0)


def more_power(
    power: Float[np.ndarray, " s"], here: Bool[np.ndarray, " s"], cluster: Int[np.ndarray, " s"], rule: Rule
) -> float | None:
    """One-sided p-value of the `power` being no larger `here` than elsewhere, by each sample's `cluster`; None where
    there are fewer clusters than the `rule` asks for."""
    logs, variances, degrees = [], [], []
    for mask in (here, ~here):
        which = cluster[mask]
        count = np.bincount(which)
        total = np.bincount(which, power[mask])[count > 0]
        count = count[count > 0].astype(float)
        m = count.size
        if m < rule.place.least_clusters or total.sum() <= 0.0:
            return None
        mean = total.sum() / count.sum()
        logs.append(np.log(mean))
        variances.append(float(np.sum((total - mean * count) ** 2)) * m / (m - 1) / total.sum() ** 2)
        degrees.append(m - 1)
    variance = sum(variances)
    if variance <= 0.0:
        return None
    freedom = variance**2 / sum(v**2 / d for v, d in zip(variances, degrees, strict=True))
    return float(scipy.stats.t.sf((logs[0] - logs[1]) / np.sqrt(variance), freedom))
