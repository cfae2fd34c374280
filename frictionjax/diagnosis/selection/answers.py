"""What models answer to noise and to an unmeasured force, each asked once."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import Answer, answer_to_force
from frictionjax.diagnosis.rule import Rule


class Answers:
    """The answers from which floors follow.

    A floor is what a perfect model leaves, so the answer is that of the model which comes nearest to one. A model that
    misses much may be far off in its inertia and its bristles: noise then grows in its observer where in the machine it
    does not, and the floor is too high in some blocks and too low in all others.

    **Arguments:**

    - `base`: the base model, which is asked at once.
    - `executor`: runs it beside the first refits.
    - `rule`: the numbers of `Rule.floor`.
    """

    def __init__(self, base: Model, executor: Executor, *, rule: Rule = Rule()) -> None:
        self._base, self._rule = base, rule
        self._of_base = executor.submit(answer_to_force, base.posterior, base.fitted.vector, rule=rule)
        # With the model: its number is its own while it is there.
        self._others: dict[int, tuple[Model, Answer]] = {}

    def of_likeliest(self, models: Sequence[Model]) -> Answer:
        """The answer of the likeliest of the `models` on all recordings, those with a gap left out: they amplify what
        is small, which their floor counts in a way of its own (`scatter`). Of gaps alone, that of the base model."""
        free = [model for model in models if not is_chaotic(model)]
        nearest = min(free, key=_loss, default=self._base)
        if nearest is self._base or nearest.posterior.batch.imposed:
            return self._of_base.result()
        if id(nearest) not in self._others:
            own = answer_to_force(nearest.posterior, nearest.fitted.vector, rule=self._rule)
            self._others[id(nearest)] = nearest, own
        return self._others[id(nearest)][1]


def _loss(model: Model) -> float:
    return float(model.judgement.clusters(np.ones((1, 1))).sum())
