"""Confidence: how likely a name is right, from what the refits show.

    logit P = bias + weights . (logit of the share that the whole explains, logit of the share that the effect explains
    where it was found, lead over the best other effect, logit of the share of the energy that the whole explains)

Shares of the misfit say how near to the noise a model comes; far from it, as on most real machines, they hide what the
share of the energy shows. All are the smaller of those on fitted and on held-out recordings. `python -m
benchmarks.calibrate` fits bias and weights to simulated machines that have been diagnosed, with the true effect in the
catalogue and without it, as if one machine in five lacked what no catalogue has; where that is met more often, fewer
names are right than P says. P decides nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.table import ModelComparison

BIAS = -3.0
WEIGHTS = (0.5, 0.5, 2.5, 0.3)
"""As `benchmarks.calibrate` prints them for `benchmarks/results/bank/*.jsonl` and the batch 20261123, rounded."""

_EDGE = 0.01  # of a share: below 1 % and above 99 % all is the same


class Evidence(NamedTuple):
    """What speaks for one accepted effect: `whole` and `own` share of the misfit explained (0 to 1; see the module),
    `lead`, by which its sum of shares on fitted and held-out recordings beats the best other effect's, and the share of
    the `energy` explained."""

    whole: float
    own: float
    lead: float
    energy: float

    @property
    def features(self) -> np.ndarray:
        """What the weights multiply, shape `(4,)`."""
        shares = np.clip((self.whole, self.own, self.energy), _EDGE, 1.0 - _EDGE)
        whole, own, energy = np.log(shares / (1.0 - shares))
        return np.array([whole, own, float(np.clip(self.lead, 0.0, 1.0)), energy])

    @property
    def confidence(self) -> float:
        """Probability that the name is right."""
        return float(1.0 / (1.0 + np.exp(-(BIAS + self.features @ np.asarray(WEIGHTS)))))


def evidence_of(
    chain: Sequence[Round], whole: ModelComparison | None, *, rule: Rule = Rule()
) -> list[Evidence]:
    """The `Evidence` for each effect that the selection accepted, in its order.

    **Arguments:** the `chain` of rounds; `whole`, the last accepted model against the base model, None where nothing
    was accepted; the `rule`.
    """
    if whole is None:
        return []
    all_of_it, found = whole.gains(rule), []
    for one in chain:
        if one.accepted is None:
            continue
        gains = one.row.gains(rule)
        others = [row.gains(rule).worth for row in one.table.rows if row.effect != one.row.effect]
        lead = gains.worth - max(others, default=0.0)
        found.append(Evidence(all_of_it.share, gains.share, lead, all_of_it.energy))
    return found
