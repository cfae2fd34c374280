"""The posterior of a diagnosis under any loss: what the solver of `fit` is tested on."""

import equinox as eqx

from frictionjax.estimation.objective.loss import AbstractLoss
from frictionjax.estimation.objective.posterior import Posterior


def under(posterior: Posterior, loss: AbstractLoss) -> Posterior:
    """The same `posterior` under a `loss`."""
    return eqx.tree_at(lambda p: p.loss, posterior, loss)
