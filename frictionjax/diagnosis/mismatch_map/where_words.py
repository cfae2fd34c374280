"""Where the mismatch is, in plain words, from the bins of the map that are significant and large."""

import math
from collections.abc import Iterable

from frictionjax.core.quantities import remarked, times
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import MismatchBin, Within

# The duration of a rest is reported as a condition on these, or on the regime.
_SHARP_AXES = ("since_reversal", "position", "input", "time")


def stands_out(one: MismatchBin, *, rule: Rule = Rule()) -> bool:
    """Whether the bin `one` is reported by the `rule`: large, and significant after correction for the whole map (where
    that is known)."""
    return one.excess > rule.place.least_excess and not one.p_value >= rule.place.significant


def strongest(bins: tuple[MismatchBin, ...], axis: str, *, rule: Rule = Rule()) -> MismatchBin | None:
    """The bin of `axis` that stands out most: the one with the largest share times log excess."""
    standing = (b for b in bins if b.axis == axis and stands_out(b, rule=rule))
    return max(standing, key=_prominence, default=None)


def lead_of(
    bins: tuple[MismatchBin, ...], unions: tuple[MismatchBin, ...] = (), *, rule: Rule = Rule()
) -> tuple[MismatchBin, ...]:
    """The bins that the sentence is about: one sharp bin, or union of bins, of another axis than regime, else the
    strongest regimes; empty when nothing stands out. `bins`: the map, `unions`: its unions, `rule`: what is
    reported."""
    sharp = _sharp(bins, unions, rule)
    return (sharp,) if sharp is not None else _regimes(bins, rule)


def where_words(
    bins: tuple[MismatchBin, ...],
    unions: tuple[MismatchBin, ...] = (),
    within: tuple[Within, ...] = (),
    *,
    gained: bool = False,
    rule: Rule = Rule(),
) -> str:
    """Where the mismatch is, in plain words: the strongest regimes, one sharp bin of another axis, and which part of
    further axes alone they are strong in. Factors are of power, the square of the error.

    **Arguments:**

    - `bins`: the map.
    - `unions`: bins of it that may be reported as one.
    - `within`: from `parts_within`, for the bins that `lead_of` gives.
    - `gained`: whether the map is of what an effect explains.
    - `rule`: what is reported.
    """

    def named(b: MismatchBin) -> str:
        if gained:
            return remarked(b.bin, f"{_share(b)} of what it explains")
        return remarked(b.bin, f"{_share(b)} of the excess, {times(b.excess)} the expected power")

    regimes, sharp = _regimes(bins, rule), _sharp(bins, unions, rule)
    if _everywhere(bins, rule):
        whole = sum(b.excess * b.count for b in bins if b.axis == "regime")
        count = sum(b.count for b in bins if b.axis == "regime")
        parts = ["every regime" if gained else f"every regime ({times(whole / count)} the expected power)"]
    else:
        parts = [named(b) for b in regimes]
    if sharp is not None:
        parts.append(named(sharp))
    parts += [
        f"{'only' if part.only else 'mostly'} {remarked(part.phrase, f'{100 * part.share:.0f} %')}"
        for part in within
    ]
    if regimes or sharp is not None:
        return ", ".join(parts)
    return "no place stands out" if gained else "nowhere above the noise"


def _regimes(bins: tuple[MismatchBin, ...], rule: Rule) -> tuple[MismatchBin, ...]:
    """The regimes that stand out about as much as the strongest one, the largest share first."""
    found = [b for b in bins if b.axis == "regime" and stands_out(b, rule=rule)]
    peak = max(map(_prominence, found), default=0.0)
    beside = rule.place.beside * peak
    return tuple(sorted((b for b in found if _prominence(b) > beside), key=lambda b: -b.share))


def _everywhere(bins: tuple[MismatchBin, ...], rule: Rule) -> bool:
    regimes = [b for b in bins if b.axis == "regime"]
    if len(regimes) < 3 or not all(stands_out(b, rule=rule) for b in regimes):
        return False
    excess = [b.excess for b in regimes]
    return max(excess) < rule.place.everywhere * min(excess)


def _sharp(bins: tuple[MismatchBin, ...], unions: tuple[MismatchBin, ...], rule: Rule) -> MismatchBin | None:
    """The most informative bin, or union of bins, of another axis than regime: nearly all of the excess in the smallest
    part of the samples."""
    found = []
    for axis in _SHARP_AXES:
        samples = sum(b.count for b in bins if b.axis == axis)
        for b in (*bins, *unions):
            if b.axis != axis or not stands_out(b, rule=rule):
                continue
            # A share in proportion to the bin's samples is not informative.
            if b.share > max(rule.place.sharp, rule.place.sharp_over_length * b.count / samples):
                part = b.count / samples
                found.append((divergence((b.share, 1.0 - b.share), (part, 1.0 - part)), b))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def divergence(shares: Iterable[float], samples: Iterable[float]) -> float:
    """Information in these `shares` of the excess of bins with these shares of the `samples`: the divergence of
    Kullback and Leibler, nats. Each add up to 1."""
    pairs = zip(shares, samples, strict=True)
    return sum((share * math.log(share / own) for share, own in pairs if share > 0.0), start=0.0)


def _prominence(b: MismatchBin) -> float:
    return b.share * math.log(b.excess)


def _share(b: MismatchBin) -> str:
    return f"{100 * b.share:.0f} %"
