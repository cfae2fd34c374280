"""Confidence: the probability that a name is right, from what the refits show; calibrated on simulated machines.

    logit P = bias + weights . (logit of the share that the whole explains, logit of the share that the effect explains
    where it was found, lead over the best other effect)

Both shares are the smaller of those on fitted and on held-out recordings. The weights were fitted by
`python -m benchmarks.calibrate` on machines with one effect, diagnosed with it and without it in the catalogue, and on
machines with physics outside it: so P holds where one in three mismatches is of a kind that the catalogue lacks.
"""

from typing import NamedTuple

import numpy as np

from frictionjax.diagnosis.judge import explained
from frictionjax.diagnosis.select import Step

BIAS = -2.0
WEIGHTS = (1.0, 0.5, 1.0)
LEAST_CONFIDENCE = 0.5
"""Probability of being right below which an effect is not named."""

_EDGE = 0.01  # of a share: below 1 % and above 99 % all is the same


class Evidence(NamedTuple):
    """What speaks for one accepted effect: `whole` and `own` share explained (0 to 1; see the module), and `lead`, by
    which its sum of shares on fitted and held-out recordings beats the best other effect's."""

    whole: float
    own: float
    lead: float

    @property
    def features(self) -> np.ndarray:
        """What the weights multiply, shape `(3,)`."""
        whole, own = (np.log(s / (1.0 - s)) for s in np.clip((self.whole, self.own), _EDGE, 1.0 - _EDGE))
        return np.array([whole, own, float(np.clip(self.lead, 0.0, 1.0))])

    @property
    def confidence(self) -> float:
        """Probability that the name is right."""
        return float(1.0 / (1.0 + np.exp(-(BIAS + self.features @ np.asarray(WEIGHTS)))))


def evidence_of(steps: list[Step]) -> list[Evidence]:
    """The `Evidence` for each effect that the selection accepted, in its order."""
    accepted = [step for step in steps if step.accepted is not None]
    if not accepted:
        return []
    last = accepted[-1].accepted
    assert last is not None
    whole = min(explained(steps[0].before.judgement, last.model.judgement, steps[-1].floor))
    found = []
    for step in accepted:
        assert step.accepted is not None
        compared = step.compared[step.refits.index(step.accepted)]
        others = [
            c.worth
            for r, c in zip(step.refits, step.compared, strict=True)
            if r.effect != step.accepted.effect
        ]
        lead = compared.worth - max(others, default=0.0)
        found.append(Evidence(whole, min(compared.share_fit, compared.share_holdout), lead))
    return found
