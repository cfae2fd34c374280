"""What a batch conceals and how its machines are measured, drawn from one seed; no case is simulated here.

Conditions (experiments, rate, noise, length) are dealt from one deck to every stratum alike, so that none of them
says what a case conceals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from typing import TypeVar

import numpy as np

from benchmarks.concealed.reality import CATALOGUE, EXTRA, OUTSIDE, RECIPES, rate_of

SHARES = {"nothing": 0.25, "one": 0.45, "two": 0.10, "confusable": 0.05, "outside": 0.15}
"""Stratum -> its share of a batch."""

NAMED = CATALOGUE + EXTRA
"""Effects that can be named, by the simulator's count."""

CONFUSABLE = (
    ("constant_load", "direction_asymmetry"),
    ("delay", "drive_lag"),
    ("maxwell_slip", "elasto_plastic"),
    ("ripple", "position_dependence"),
    ("sensor_lag", "delay"),
    ("creep", "friction_lag"),
    ("nonlinear_bristle", "elasto_plastic"),
    ("ripple", "torque_ripple"),
)
"""Pairs that are easily taken for each other: the first is concealed."""

TWO = (
    ("creep", "quadratic_drag"),
    ("maxwell_slip", "return_spring"),
    ("direction_asymmetry", "delay"),
    ("ripple", "stribeck_shape"),
    ("position_dependence", "encoder_error"),
    ("flexible_transmission", "constant_load"),
    ("friction_lag", "drive_deadzone"),
    ("elasto_plastic", "warmup"),
    ("load_dependence", "sensor_lag"),
    ("nonlinear_bristle", "quadratic_drag"),
    ("backlash", "direction_asymmetry"),
    ("dwell_strengthening", "torque_ripple"),
)
"""Pairs of effects concealed together: no two of one slot."""

_STICK = ("maxwell_slip", "elasto_plastic", "nonlinear_bristle", "creep", "viscoelastic_damping")
_ANYWHERE = (
    "constant_load", "delay", "drive_lag", "drive_deadzone", "encoder_error", "sensor_lag", "mains_pickup",
    "flexible_transmission", "backlash", "outside:drive_hysteresis", "outside:floor_vibration",
    "outside:loose_sensor", "outside:sensor_drift", "outside:motor_fade", "outside:supply_sag",
    "outside:payload_added",
)  # fmt: skip

# What a coarse encoder, a short file or a slow recorder cannot show.
_FINE = (*_STICK, "micro_damping", "dwell_strengthening", "friction_lag", "outside:sensor_drift")
_NOT_IN = {
    "industrial": _FINE,
    "poor": (*_FINE, "warmup", "outside:motor_fade", "outside:decaying_detent", "outside:payload_added"),
    "joint": (*_FINE, "mains_pickup", "flexible_transmission", "encoder_error", "outside:gear_impacts"),
}

# Family of experiments -> share of a batch. The last two lack a regime.
_FAMILIES = {
    "default": 0.4,
    "mixed": 0.2,
    "few": 0.1,
    "odd": 0.1,
    "rich": 0.05,
    "sliding": 0.1,
    "presliding": 0.05,
}
KNOWN = (*_FAMILIES, *RECIPES)
"""Families that a batch can be made of."""

# What all recordings of a family last together at most, s.
_SECONDS = {
    "default": 102,
    "mixed": 120,
    "few": 50,
    "odd": 66,
    "rich": 142,
    "sliding": 54,
    "presliding": 78,
}
# Samples a second -> share of a batch.
_RATES = {1000.0: 0.2, 2000.0: 0.5, 4000.0: 0.15, 5000.0: 0.1, 10000.0: 0.05}
# Samples of a case at most, unless its durations would shrink to less than this factor.
_SAMPLES, _LEAST_STRETCH = 2e5, 0.3
_SHORT = 0.2  # share of the batch with half the durations
_COLOURED = 0.3  # share of the batch with coloured noise


Key = TypeVar("Key")


class UnknownFamily(ValueError):
    """A batch was asked for with a family of experiments that there is not."""


@dataclass(frozen=True)
class Plan:
    """One case: its stratum, what it conceals and how strong, and how it is measured; `easily_taken_for` is the other
    effect of a confusable pair. The machine is the most visible one of up to so many `attempts`, see `make`."""

    stratum: str
    missing: tuple[str, ...]
    strength: str
    families: str
    rate: float
    stretch: float
    coloured: bool
    seed: int
    easily_taken_for: str = ""
    attempts: int = 1

    def plain(self) -> dict:
        """For JSON."""
        return asdict(self) | {"missing": list(self.missing)}


def counts(cases: int) -> dict[str, int]:
    """Cases of each stratum: the shares of `cases`, rounded so that they add up (largest remainders first)."""
    exact = {name: share * cases for name, share in SHARES.items()}
    whole = {name: int(value + 1e-9) for name, value in exact.items()}
    by_rest = sorted(exact, key=lambda name: (whole[name] - exact[name], list(SHARES).index(name)))
    for name in by_rest[: cases - sum(whole.values())]:
        whole[name] += 1
    return whole


def shows_in(effect: str, family: str) -> bool:
    """Whether the experiments of a `family` hold the regime in which `effect` acts at all."""
    if family == "presliding":
        return effect in _STICK + _ANYWHERE
    if family == "sliding":
        return effect not in _STICK
    return effect not in _NOT_IN.get(family, ())


def _dealt(rng: np.random.Generator, shares: dict[Key, float], count: int) -> list[Key]:
    """`count` keys of `shares` in their proportions: a random point, then equal steps along the shares."""
    edges = np.cumsum(list(shares.values()))
    points = (rng.random() + np.arange(count)) / max(count, 1) * edges[-1]
    keys = [list(shares)[int(i)] for i in np.searchsorted(edges, points % edges[-1], side="right")]
    return [keys[i] for i in rng.permutation(count)]


def _contents(rng: np.random.Generator, stratum: str, count: int) -> list[tuple[tuple[str, ...], str, str]]:
    """(effects, strength, easily taken for) of each case of a stratum: every effect before any comes again."""
    if stratum == "nothing":
        return [((), "strong", "")] * count
    deck = {"one": [(name,) for name in NAMED], "outside": [(name,) for name in OUTSIDE], "two": list(TWO)}
    effects = deck.get(stratum, [(first,) for first, _ in CONFUSABLE])
    order = [int(i) for _ in range(-(-count // len(effects))) for i in rng.permutation(len(effects))]
    strengths = ("strong", "medium", "weak") if stratum == "one" else ("strong", "medium")
    begin = int(rng.integers(len(strengths)))
    graded = islice(cycle(strengths), begin, begin + count)
    other = [second for _, second in CONFUSABLE] if stratum == "confusable" else [""] * len(effects)
    return [(effects[i], strength, other[i]) for i, strength in zip(order, graded, strict=False)]


def _matched(families: list[str], contents: list[tuple[tuple[str, ...], str, str]]) -> list[str]:
    """`families` in an order in which each shows what its case conceals; those that lack a regime choose first.

    Where a family shows none of the effects that are left, its case gets the default family.
    """
    found: dict[int, str] = {}
    for family in sorted(families, key=lambda name: list(_FAMILIES)[::-1].index(name)):
        free = [i for i in range(len(contents)) if i not in found]
        fits = [i for i in free if all(shows_in(effect, family) for effect in contents[i][0])]
        found[(fits or free)[0]] = family if fits else "default"
    return [found[i] for i in range(len(contents))]


def compose(cases: int, seed: int, families: Sequence[str] = ()) -> list[Plan]:
    """Plans of a batch of `cases`, in the order in which they are numbered; of the given `families` of experiments in
    equal parts, or of the usual ones in their own shares.

    Raises `UnknownFamily` for a name that is none.
    """
    if families:
        return _compose_of(cases, seed, families)
    rng = np.random.default_rng([seed, 0x5EA1])
    plans: list[Plan] = []
    for stratum, count in counts(cases).items():
        contents = _contents(rng, stratum, count)
        families = _matched(_dealt(rng, _FAMILIES, count), contents)
        rates = _dealt(rng, _RATES, count)
        short = _dealt(rng, {True: _SHORT, False: 1.0 - _SHORT}, count)
        coloured = _dealt(rng, {True: _COLOURED, False: 1.0 - _COLOURED}, count)
        dealt = zip(contents, families, rates, short, coloured, strict=True)
        for (missing, strength, other), family, rate, is_short, is_coloured in dealt:
            stretch = _stretch_of(family, rate)
            stretch *= 0.5 if is_short and stretch > 0.6 else 1.0
            machine = int(rng.integers(2**53))
            plans.append(Plan(stratum, missing, strength, family, rate, stretch, is_coloured, machine, other))
    return [plans[i] for i in rng.permutation(cases)]


ATTEMPTS = 10
"""Machines that are tried at most until what they conceal is visible."""


def _shown(rng: np.random.Generator, stratum: str, families: list[str]) -> list[tuple[tuple[str, ...], str]]:
    """(effects, easily taken for) of the cases of a stratum, one for each of `families`: what its experiments can show,
    and no effects again before all that fit have come."""
    deck = {
        "one": [((name,), "") for name in NAMED],
        "two": [(pair, "") for pair in TWO],
        "confusable": [((first,), second) for first, second in CONFUSABLE],
        "outside": [((name,), "") for name in OUTSIDE],
    }.get(stratum, [((), "")])
    left: list[tuple[tuple[str, ...], str]] = []
    found = []
    alone = bool(rng.random() < 0.5)
    for family in families:
        if family == "joint" and stratum in ("one", "two"):
            found.append((_beside_weight(rng, stratum, alone), ""))
            alone = not alone
            continue
        fits = [one for one in deck if all(shows_in(effect, family) for effect in one[0])]
        if not any(one in left for one in fits):
            left += [deck[int(i)] for i in rng.permutation(len(deck))]
        found.append(next(one for one in left if one in fits))
        left.remove(found[-1])
    return found


def _beside_weight(rng: np.random.Generator, stratum: str, alone: bool) -> tuple[str, ...]:
    """What a joint conceals: its weight, `alone` or with something else; or something else, while the weight is
    given."""
    others = [name for name in NAMED if name != "gravity_pendulum" and shows_in(name, "joint")]
    other = others[int(rng.integers(len(others)))]
    if stratum == "two":
        return ("gravity_pendulum", other)
    return ("gravity_pendulum",) if alone else (other,)


def _compose_of(cases: int, seed: int, families: Sequence[str]) -> list[Plan]:
    """Plans of a batch of given `families`, each dealt to every stratum alike."""
    unknown = [family for family in families if family not in KNOWN]
    if unknown:
        raise UnknownFamily(f"unknown family of experiments {unknown[0]!r}; known: {', '.join(KNOWN)}")
    rng = np.random.default_rng([seed, 0x5EA2])
    strata = [name for name, count in counts(cases).items() for _ in range(count)]
    rounds = [
        families[int(i)] for _ in range(-(-cases // len(families))) for i in rng.permutation(len(families))
    ]
    plans: list[Plan] = []
    for stratum in SHARES:
        own = [family for family, name in zip(rounds, strata, strict=False) if name == stratum]
        grades = ("strong", "medium", "weak") if stratum == "one" else ("strong", "medium")
        begin = int(rng.integers(len(grades)))
        coloured = _dealt(rng, {True: _COLOURED, False: 1.0 - _COLOURED}, len(own))
        for number, (family, (missing, other)) in enumerate(zip(own, _shown(rng, stratum, own), strict=True)):
            strength = grades[(begin + number) % len(grades)]
            if not missing or (family == "joint" and missing == ("gravity_pendulum",)):
                strength = "strong"  # a link's weight has the size that it has
            rate = rate_of(rng, family) if family in RECIPES else _dealt(rng, _RATES, 1)[0]
            stretch = 1.0 if family in RECIPES else _stretch_of(family, rate)
            machine = int(rng.integers(2**53))
            attempts = ATTEMPTS if family in RECIPES else 1
            plans.append(
                Plan(
                    stratum,
                    missing,
                    strength,
                    family,
                    rate,
                    stretch,
                    coloured[number],
                    machine,
                    other,
                    attempts,
                )
            )
    return [plans[i] for i in rng.permutation(cases)]


def _stretch_of(family: str, rate: float) -> float:
    """Factor on the durations of a usual family, so that a case has not too many samples."""
    return round(min(1.0, max(_SAMPLES / (rate * _SECONDS[family]), _LEAST_STRETCH)), 2)
