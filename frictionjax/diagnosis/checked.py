"""What a check of a diagnosis found: how often its names are right on simulated machines like the user's."""

from collections.abc import Sequence
from dataclasses import dataclass

import scipy

LEVEL = 0.95
"""Of the intervals that are stated."""


@dataclass(frozen=True)
class CheckedName:
    """How often a name is right on simulated machines.

    **Attributes:** `effect` (the name), `given` (machines whose diagnosis names it, or has it in the class of what it
    names), `right` (those of them in which what acted is in that class), `acting` (machines in which it acted), `found`
    (those of them that were given the name).
    """

    effect: str
    given: int
    right: int
    acting: int
    found: int

    @property
    def share(self) -> float:
        """How often the name is right where it is given; NaN where it never was."""
        return self.right / self.given if self.given else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of `share`: `binomial_interval`."""
        return binomial_interval(self.right, self.given)

    @property
    def sentence(self) -> str:
        """What the report says of it."""
        name = self.effect.replace("_", " ")
        acted = (
            f"{name} acted in {self.acting} of the simulated machines and was named in {self.found} of them."
        )
        if not self.given:
            return f"On data like yours no simulated machine was given the name {name}: {acted}"
        return (
            f"On data like yours the name {name} is right {self.right} of the {_times(self.given)} that it is given "
            f"({_share(self.right, self.given)}): {acted}"
        )


@dataclass(frozen=True)
class CheckedAnswer:
    """What was said of simulated machines, and how often.

    **Attributes:** `acting` (names of the effects that acted beyond the base model; none in the base model alone),
    `verdict`, `named` (names that the diagnosis gave), `right` (whether these are the effects that acted, each within
    its class), `machines` (how many).
    """

    acting: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    right: bool
    machines: int


@dataclass(frozen=True)
class Check:
    """What a diagnosis says of simulated machines at the user's own inputs, rates and noise.

    **Attributes:** `machines` (that were diagnosed), `failed` (that could not be), `names` (one for each effect that
    the user's own diagnosis names), `answers` (what was said, the most frequent first for each machine).
    """

    machines: int
    failed: int
    names: tuple[CheckedName, ...]
    answers: tuple[CheckedAnswer, ...]

    @property
    def right(self) -> int:
        """Machines of which the right thing was said: all effects that acted, each within its class, and no other."""
        return sum(one.machines for one in self.answers if one.right)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What the report says: a sentence for each name; then how all machines fared."""
        if not self.machines:
            return (f"None of the {self.failed} simulated machines could be diagnosed.",)
        whole = (
            f"Of {self.machines} simulated machines {self.right} were diagnosed right "
            f"({_share(self.right, self.machines)})"
        )
        more = f"; {self.failed} more could not be diagnosed." if self.failed else "."
        return (*(name.sentence for name in self.names), whole + more)


def binomial_interval(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a rate that was `count` times met `of` so many times, by Wilson's score: (0, 1) where there
    was no time."""
    if not of:
        return 0.0, 1.0
    found = scipy.stats.binomtest(count, of).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)


def given_name(effect: str, classes: Sequence[Sequence[str]]) -> bool:
    """Whether a diagnosis with these `classes`, one for each named effect, gives the name of an `effect`."""
    return any(effect in members for members in classes)


def is_right(acting: Sequence[str], classes: Sequence[Sequence[str]]) -> bool:
    """Whether the named effects, of these `classes`, are the `acting` ones: one name for each, each in its class."""
    if len(acting) != len(classes):
        return False
    left = [set(members) for members in classes]
    for effect in acting:
        own = next((members for members in left if effect in members), None)
        if own is None:
            return False
        left.remove(own)
    return True


def _share(count: int, of: int) -> str:
    low, high = binomial_interval(count, of)
    return f"{100 * count / of:.0f} %, 95 % interval {100 * low:.0f} to {100 * high:.0f} %"


def _times(count: int) -> str:
    return "1 time" if count == 1 else f"{count} times"
