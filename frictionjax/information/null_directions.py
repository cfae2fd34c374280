"""The search for null directions of an information matrix, and the sentence on each.

A direction c of the logarithms (strengths: over their typical size), of largest component 1, is null when c'Ic < 1:
its parameter may change by its own size before the noise is reached. Directions with a physical cause are
searched first, then single parameters, then the smallest groups of which only a combination is identifiable.
"""

import itertools
import re
from collections.abc import Iterator, Sequence, Sized

import numpy as np
from jaxtyping import Float, Int

from frictionjax.information.fisher import Information, bounded, inverse_information
from frictionjax.information.planned import MOTOR

_SLOW = "slow moves through break-away, such as a ramp of the force to twice the static friction"
_SMALL = "noise or slow loops below break-away"
_SLIDING = "sliding moves at several velocities"
_FAST = "noise or moves that accelerate more"
CURES = {"J": _FAST, "sigma0": _SMALL, "sigma1": _SMALL, "sigma2": _SLIDING}
CURES |= {"Fc": _SLOW, "Fs": _SLOW, "vs": _SLOW, MOTOR.name: "a known load or a known mass"}
"""Label of a parameter -> what to add to the data for it; `OTHER` for those not listed."""
_REASONS = {
    _SLOW: "the motion does not go through break-away",
    _SMALL: "the presliding motion is below the noise",
    _SLIDING: "there is too little sliding",
    _FAST: "inertia forces are below the noise",
}
OTHER = "an experiment that excites it above the noise"
_BALANCE = (
    0.1  # of sigma1 against sigma2: the most that their sum may change when only the sum is identifiable
)
_PART = 0.05  # of its largest component: smaller ones are left out of the words on a direction
_ROUNDING = 1e-13  # of a quadratic form, over the sum of its terms' sizes
_LARGEST = 3  # parameters in a group that is searched for; larger ones come from the inverse


class NullSearch:
    """The null directions of `information` found so far, and what remains when they are taken as known.

    `found` and `sentences` are the directions, shape `(p,)` each, and the words on them; `combinations` has the
    relative variance of each sum and ratio that is identifiable instead.
    """

    def __init__(self, information: Information) -> None:
        self.given, self.matrix = information, information.scaled
        self.names, self.found, self.fixed, self.sentences = information.names, [], [], []
        self.weak, self.alone = bounded(self.matrix)
        self.combinations: dict[str, float] = {}

    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Least covariance, with the weak prior, once no parameter moves along a direction that was found."""
        count = len(self.names)
        if not self.fixed:
            return inverse_information(self.weak)
        _, _, rows = np.linalg.svd(np.stack(self.fixed))
        basis = rows[np.linalg.matrix_rank(np.stack(self.fixed)) :].T
        if basis.shape[1] == 0:
            return np.zeros((count, count))
        return basis @ inverse_information(basis.T @ self.weak @ basis) @ basis.T

    def left(self) -> Int[np.ndarray, " left"]:
        """Places of the parameters that no direction found so far explains."""
        within = sum((row**2 for row in self.fixed), np.zeros(len(self.names)))
        return np.flatnonzero((np.diag(self.covariance()) >= 1.0) | (self.alone & (within < 0.5)))

    def take(
        self, direction: Float[np.ndarray, " p"], sentence: str, fixed: Float[np.ndarray, " p"] | None = None
    ) -> None:
        """Keep a `direction` and the `sentence` on it; from then on its own coordinate is `fixed`, or another."""
        self.fixed.append(direction / np.linalg.norm(direction) if fixed is None else fixed)
        self.found.append(direction / direction[np.argmax(np.abs(direction))])
        self.sentences.append(sentence)

    def is_null(self, direction: Float[np.ndarray, " p"]) -> bool:
        """Whether a change by 1 of the largest component of `direction` has less effect than the noise."""
        c = direction / np.max(np.abs(direction))
        # Terms of 1e15 cancel along an exact invariance: the remainder is rounding.
        lost = _ROUNDING * float(np.abs(c) @ np.abs(self.matrix) @ np.abs(c))
        return bool(c @ self.matrix @ c < 1.0 + lost)

    def known_directions(self) -> None:
        """All forces in one ratio; sigma1 and sigma2 in one sum."""
        names, own = self.names, np.where(self.given.logs, 1.0, self.given.values / self.given.scale)
        forces = np.asarray([unit.startswith("{force}") for unit in self.given.units])
        scale = np.where(forces, own, 0.0)
        place = names.index(MOTOR.name) if MOTOR.name in names else -1
        if (
            place >= 0
            and np.sum(scale != 0.0) > 1
            and self.is_null(scale)
            and self.matrix[place, place] >= 1.0
        ):
            others = [n for n, part in zip(names, scale, strict=True) if part and n != MOTOR.name]
            sentence = f"{words_of(others)} and the motor constant are identifiable only as ratios"
            cure = "Add a known load or a known mass, or give the motor constant."
            unit = np.eye(len(names))
            # A constant that is known fixes the size of all forces, however badly some of them are known.
            self.take(scale, f"{sentence}: all forces may be larger by one factor. {cure}", unit[place])
            covariance = self.covariance()
            for other in others:
                if self.given.logs[names.index(other)]:
                    form = unit[names.index(other)] - unit[place]
                    self.combinations[f"{other}/{MOTOR.name}"] = float(form @ covariance @ form)
        if {"sigma1", "sigma2"} <= set(names):
            self._sum_of_dampings()

    def _sum_of_dampings(self) -> None:
        """sigma1 and sigma2 as a sum: an error of one is compensated by the other, and their sum is identifiable."""
        covariance, places = self.covariance(), [self.names.index("sigma1"), self.names.index("sigma2")]
        own = self.given.values[places]
        direction = covariance[:, places[int(np.argmax(np.diag(covariance)[places]))]]
        changes = own * direction[places]
        total, null = np.zeros(len(self.names)), np.zeros(len(self.names))
        total[places], null[places] = own / np.sum(own), np.array([-1.0, 1.0]) / own
        summed = total @ covariance @ total < 1.0
        if (
            summed
            and set(places) & set(self.left())
            and abs(np.sum(changes)) < _BALANCE * np.max(np.abs(changes))
        ):
            self.combinations["sigma1 + sigma2"] = float(total @ covariance @ total)
            self.take(
                null,
                "sigma1 and sigma2 are identifiable only as a sum: without sliding, friction opposes velocity by "
                f"sigma1 + sigma2. Add {_SLIDING}.",
            )

    def single_parameters(self) -> None:
        """Parameters that are unidentifiable even with all others known, by their common cure."""
        alone = [i for i in self.left() if self.alone[i]]
        for cure in dict.fromkeys(CURES.get(self.names[i], OTHER) for i in alone):
            some = [i for i in alone if CURES.get(self.names[i], OTHER) == cure]
            which = words_of([self.names[i] for i in some])
            why = _REASONS.get(cure, "the positions do not change with it")
            for i in some:
                self.take(
                    np.eye(len(self.names))[i],
                    f"{which} {_are(some)} not identifiable at all: {why}. Add {cure}.",
                )

    def groups(self) -> None:
        """The smallest groups of which only a combination is identifiable; the remaining ones come from the inverse."""
        for places in self._candidates():
            inverse = inverse_information(self.weak[np.ix_(places, places)])
            # Parameters that an earlier direction explains do not count.
            open_ones = np.isin(places, self.left())
            worst = int(np.argmax(np.where(open_ones, np.diag(inverse), 0.0)))
            if inverse[worst, worst] >= 1.0:
                direction = np.zeros(len(self.names))
                direction[list(places)] = inverse[:, worst]
                self.take(direction, self._together(direction))
        while self.left().size:
            covariance = self.covariance()
            direction = covariance[:, int(np.argmax(np.diag(covariance)))]
            self.take(direction, self._together(direction))

    def _candidates(self) -> Iterator[tuple[int, ...]]:
        for size in range(2, _LARGEST + 1):
            for places in itertools.combinations(range(len(self.names)), size):
                if not self.left().size:
                    return
                inside = [set(np.flatnonzero(np.abs(c) > 0.0)) for c in self.found]
                if set(places) & set(self.left()) and not any(one <= set(places) for one in inside):
                    yield places

    def _together(self, direction: Float[np.ndarray, " p"]) -> str:
        direction = direction / direction[np.argmax(np.abs(direction))]
        parts = [(n, w) for n, w in zip(self.names, direction, strict=True) if abs(w) > _PART]
        cures = dict.fromkeys(CURES.get(name, OTHER) for name, _ in parts)
        which = words_of([name for name, _ in parts])
        if len(parts) == 1:
            return f"{which} is not identifiable: other parameters compensate for it. Add {', and '.join(cures)}."
        ups = [name for name, weight in parts if weight > 0.0]
        downs = [name for name, weight in parts if weight < 0.0]
        change = f"{words_of(ups)} up" + (f" with {words_of(downs)} down" if downs else " together")
        effect = f"{change} has less effect than the noise"
        return f"{which} are identifiable only together: {effect}. Add {', and '.join(cures)}."

    def rest(self) -> None:
        """Parameters that are unidentifiable only because others are, where no sentence names them."""
        covariance = inverse_information(self.weak)
        for i in np.flatnonzero((np.diag(covariance) >= 1.0) | self.alone):
            name = self.names[i]
            if not any(re.search(rf"(?<!\w){re.escape(name)}(?!\w)", one) for one in self._named_sentences()):
                cure = CURES.get(name, OTHER)
                self.take(
                    covariance[:, i], f"{name} is not identifiable while others are unknown. Add {cure}."
                )

    def _named_sentences(self) -> list[str]:
        return [one.replace("the motor constant", MOTOR.name) for one in self.sentences]


def _are(some: Sized) -> str:
    return "are" if len(some) > 1 else "is"


def words_of(names: Sequence[str]) -> str:
    """`names` as words: "a", "a and b", "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
