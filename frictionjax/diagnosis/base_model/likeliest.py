"""The likeliest parameters of a base model: those of `fit`, from where the robust descent ended.

A fixed-gain observer that is slow enough for a coarse sensor prefers friction that does not fall with velocity: noise
grows in an unstable motion, and a stable model leaves less. A Kalman filter knows how much noise grows.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.descent.refine import OneFit, at_start, refine
from frictionjax.estimation.objective.loss import Gaussian
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import changed


def likeliest(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
    """The `vector` with the parameters, and the starting deflections of the fitted recordings, that are likeliest for
    these recordings by the prediction errors of a Kalman filter (`refine`), from there.

    **Arguments:** `posterior`, of a diagnosis; `vector`, where its descent ended.
    """
    own, start = posterior.of_fitted(vector)
    gaussian = eqx.tree_at(
        lambda p: (p.loss, p.start, p.ceilings),
        own,
        (Gaussian(), start, (None,)),
        is_leaf=lambda leaf: leaf is None,
    )
    known = np.zeros(own.batch.x.shape[0], bool)
    found = refine(OneFit(known, own.batch.substeps), at_start(gaussian, start))
    rows = np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
    places = np.concatenate([np.arange(posterior.parameters), posterior.parameters + rows])
    return changed(vector, places, found.vector)
