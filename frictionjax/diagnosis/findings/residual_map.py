"""Unknown: a nonparametric model of the force that the catalogue does not explain, over the variable it depends on."""

from concurrent.futures import Executor

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.comparison import Compared, compare
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.screening.linearised import Present, present_model
from frictionjax.diagnosis.screening.score_test import Trial, forms_to_try, try_form
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, extend
from frictionjax.estimation.parameters import changed
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.residual_maps import MAPS, AbstractMap

_CONVERGED = 2  # maps that are refitted: those whose one-step estimates gain most
_TAIL, _MARGIN = (
    0.05,
    1.5,
)  # share of the excess outside a spot on either side; factor on the width for its map
_LEAST_LEAD = 1.5  # standard errors by which the held-out misfit must fall; it may lie in few clusters
_LEAST_SHARE = 0.1  # of the held-out misfit that the map must remove, besides


class ResidualModel(eqx.Module):
    """A map of the missing force over one variable.

    **Attributes:** `variable` (in words), `model`, `compared` (against the model without it), `helps` (whether it
    predicts held-out recordings significantly better than the model without it).
    """

    variable: str = eqx.field(static=True)
    model: Model
    compared: Compared
    helps: bool = eqx.field(static=True)


def _spot(present: Present) -> tuple[float, float] | None:
    """Middle and half width of the part of the stroke with most of the excess; None where that is much of it."""
    batch, e = present.joint.batch, np.nan_to_num(np.asarray(present.e))
    inside = np.asarray(batch.valid) > 0
    x, excess = np.asarray(batch.x)[inside], np.maximum(e[inside] ** 2 - 1.0, 0.0)
    order = np.argsort(x)
    share = np.cumsum(np.minimum(excess, np.quantile(excess, 0.999))[order])
    if not share[-1] > 0.0:
        return None
    low, high = np.interp((_TAIL, 1.0 - _TAIL), share / share[-1], x[order])
    half = 0.5 * (high - low) * _MARGIN
    return (float(0.5 * (low + high)), float(half)) if 2.0 * half < 0.5 * np.ptp(x) else None


def residual_model(
    model: Model, floor: Float[np.ndarray, "#r #b"], executor: Executor
) -> ResidualModel | None:
    """The map that explains most of what `model` leaves, all parameters free.

    Each map is a set of effects whose one-step estimates are tested like those of the catalogue, with all base
    parameters free; the best are refitted, and the one that predicts best is kept.

    **Arguments:**

    - `model`: the fitted base model, with the effects that were named.
    - `floor`: power of each block that a perfect model would leave, shape `(r, b)`.
    - `executor`: runs tests and refits in parallel.

    **Returns:** the `ResidualModel`, or None when no map can be computed.
    """
    scales = plant_scales(model.judgement.drive, model.joint.batch)
    fast = model.joint.at_bandwidth(FAST_BANDWIDTH)
    present = present_model(fast, model.fitted.vector)
    spot = _spot(present)

    def test(item: tuple[str, type[AbstractMap]]) -> list[tuple[float, str, Trial]]:
        variable, form = item
        instances = forms_to_try(form, scales, {})
        if spot is not None and variable.startswith("position"):
            instances.append(form(middle=spot[0], half=spot[1]))  # type: ignore[call-arg]
        trials = try_form(present, instances, scales)
        return [(trial.gain, variable, trial) for trial in trials if np.isfinite(trial.gain)]

    def converge(item: tuple[float, str, Trial]) -> ResidualModel:
        _, variable, trial = item
        posterior, vector = extend(fast, model.fitted.vector, trial.form, scales)
        count, rows = len(posterior.layout), np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
        vector = changed(vector, np.concatenate([np.arange(count), count + rows]), trial.vector)
        started = descend(posterior, vector, steps=12, tolerance=0.02)
        slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
        fitted = descend(slow, started.vector, graduate=False, steps=12, tolerance=0.01)
        found = Model(slow, fitted, judge(slow, fitted))
        compared = compare(model.judgement, found.judgement, floor)
        helps = compared.lead_holdout > _LEAST_LEAD and compared.share_holdout > _LEAST_SHARE
        return ResidualModel(variable, found, compared, helps)

    tested = [found for some in executor.map(test, MAPS.items()) for found in some]
    tested.sort(key=lambda item: -item[0])
    converged = list(executor.map(converge, tested[:_CONVERGED]))
    return max(converged, key=lambda found: found.compared.worth, default=None)
