"""Unknown: a nonparametric model of the force that the catalogue does not explain, over the variable it depends on."""

from collections.abc import Collection, Sequence
from concurrent.futures import Executor

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import Scene, judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import search_bandwidth
from frictionjax.diagnosis.evidence.views import View, held_out_error
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.linearised import Present, present_model
from frictionjax.diagnosis.screening.score_test import Trial, forms_to_try, try_form
from frictionjax.diagnosis.table import (
    ComparisonTable,
    Improvement,
    ModelComparison,
    OtherDecision,
    table_of_one,
)
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend
from frictionjax.estimation.parameters import changed
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.residual_maps import MAPS, AbstractMap

POSITION = "position"
"""What a force of the position depends on, among the variables of the maps."""
_REJECTED = (
    "A map of the residual force over {} lowers the held-out misfit, but the held-out error rises from {:.3g} to "
    "{:.3g} times the noise: the map is not used."
)
MAP = "map of the residual force is used"

_TAIL = 0.05  # share of the excess that is left out on either side of a spot
_MARGIN = 1.5  # factor on the width of a spot, for its map


class ResidualModel(eqx.Module):
    """A map of the missing force over one variable.

    **Attributes:** `variable` (in words), `model`, `row` (that compares it with the model without it), `helps` (whether
    it predicts held-out recordings significantly better than the model without it).
    """

    variable: str = eqx.field(static=True)
    model: Model
    row: ModelComparison = eqx.field(static=True)
    helps: bool = eqx.field(static=True)


def _spot(present: Present) -> tuple[float, float] | None:
    """Middle and half width of the part of the stroke with most of the excess; None where that is much of it."""
    batch, e = present.posterior.batch, np.nan_to_num(np.asarray(present.e))
    inside = np.asarray(batch.valid) > 0
    x, excess = np.asarray(batch.x)[inside], np.maximum(e[inside] ** 2 - 1.0, 0.0)
    order = np.argsort(x)
    share = np.cumsum(np.minimum(excess, np.quantile(excess, 0.999))[order])
    if not share[-1] > 0.0:
        return None
    low, high = np.interp((_TAIL, 1.0 - _TAIL), share / share[-1], x[order])
    half = 0.5 * (high - low) * _MARGIN
    return (float(0.5 * (low + high)), float(half)) if 2.0 * half < 0.5 * np.ptp(x) else None


def helps(gains: Improvement, rule: Rule) -> bool:
    """Whether a map with these `gains` predicts held-out recordings better than the model without it, by the `rule`."""
    return gains.lead_holdout > rule.residual.lead and gains.share_holdout > rule.residual.share


def residual_model(
    model: Model,
    floor: Float[np.ndarray, "#r #b"],
    executor: Executor,
    *,
    base: Model | None = None,
    variables: Collection[str] = tuple(MAPS),
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> ResidualModel | None:
    """The map that explains most of what `model` leaves, all parameters free.

    Each map is a set of effects whose one-step estimates are tested like those of the catalogue, with all base
    parameters free; the best are refitted, and the one that predicts best is kept. Where forces of the position are
    named, the map over the position is among them, and kept unless another one is clearly likelier: in slow motion the
    input follows such a force, and a map over the input says the same of the recordings, and not what the force is.

    **Arguments:**

    - `model`: the fitted base model, with the effects that were named.
    - `floor`: power of each block that a perfect model would leave, shape `(r, b)`.
    - `executor`: runs tests and refits in parallel.
    - `base`: the base model; None: the `model` itself.
    - `variables`: what the force may depend on; names in `MAPS`.
    - `rule`: whether the map helps, and what is clearly likelier.
    - `effort`: how many maps are refitted, and how far.

    **Returns:** the `ResidualModel`, or None when no map can be computed.
    """
    scales = plant_scales(model.judgement.drive, model.posterior.batch)
    searched = model.posterior.at_bandwidth(search_bandwidth(model.posterior, model.fitted.vector))
    present = present_model(searched, model.fitted.vector)
    spot, own = _spot(present), effort.refitting

    def test(item: tuple[str, type[AbstractMap]]) -> list[tuple[float, str, Trial]]:
        variable, form = item
        instances = forms_to_try(form, scales, {})
        if spot is not None and variable.startswith("position"):
            instances.append(form(middle=spot[0], half=spot[1]))  # type: ignore[call-arg]
        trials = try_form(present, instances, scales, effort=effort)
        return [(trial.gain, variable, trial) for trial in trials if np.isfinite(trial.gain)]

    def converge(item: tuple[float, str, Trial]) -> ResidualModel:
        _, variable, trial = item
        posterior, vector = extend(searched, model.fitted.vector, trial.form, scales)
        count, rows = len(posterior.layout), np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
        vector = changed(vector, np.concatenate([np.arange(count), count + rows]), trial.vector)
        first = descend(posterior, vector, steps=own.map_steps, tolerance=own.map_tolerance)
        slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
        fitted = descend(
            slow, first.vector, graduate=False, steps=own.map_steps, tolerance=own.slow_tolerance
        )
        found = Model(slow, fitted, judge(slow, fitted))
        row = compare(model.judgement, found.judgement, floor, rule=rule)
        return ResidualModel(variable, found, row, helps(row.gains(rule), rule))

    tested = [
        found for some in executor.map(test, ((name, MAPS[name]) for name in variables)) for found in some
    ]
    tested.sort(key=lambda item: -item[0])
    chosen = tested[: own.residual_maps]
    forces = forces_of_position(model, base or model)
    if forces:
        chosen += [item for item in tested[own.residual_maps :] if item[1] == POSITION][:1]
    return of_alike(list(executor.map(converge, chosen)), forces, rule)


def forces_of_position(model: Model, base: Model) -> tuple[str, ...]:
    """Names of the forces of the position among the effects of the `model` beyond those of the `base` model."""
    named = model.posterior.drive.effects[len(base.posterior.drive.effects) :]
    return tuple(effect.name for effect in named if effect.about.of_position)


def of_alike(converged: Sequence[ResidualModel], named: Collection[str], rule: Rule) -> ResidualModel | None:
    """The map that explains most among those that are `converged`; where forces of the position are `named`, that over
    the position, if it helps and the other one is not clearly likelier by the `rule`. None where there are none."""
    best = max(converged, key=lambda found: found.row.gains(rule).worth, default=None)
    for one in converged:
        if named and one.variable == POSITION and one.helps and one is not best and best is not None:
            return best if best.row.lead_over(one.row).in_errors(rule) > rule.rivals.lead else one
    return best


def with_and_without_map(without: View, mapped: View, scene: Scene) -> OtherDecision:
    """How well the held-out recordings of the `scene` are predicted `without` the map and with it, `mapped`, over the
    noise."""
    before, after = (held_out_error(predicted, scene) for predicted in (without, mapped))
    return OtherDecision(MAP, {"error_without_map": before, "error": after})


def map_is_used(compared: OtherDecision) -> bool:
    """Whether the held-out error does not rise with the map, of what was `compared`."""
    return not compared.numbers["error"] > compared.numbers["error_without_map"]


def rejected_note(residual: ResidualModel, compared: OtherDecision) -> str:
    """The sentence of a map, the `residual`, that is not used by what was `compared`."""
    numbers = compared.numbers
    return _REJECTED.format(residual.variable, numbers["error_without_map"], numbers["error"])


def map_tables(residual: ResidualModel | None) -> tuple[ComparisonTable, ...]:
    """The comparison by which a map, the `residual`, helps, as a table that is stored; none where there is no map."""
    if residual is None:
        return ()
    row, imposed = residual.row, residual.model.posterior.batch.imposed
    return (table_of_one("map", ("map", residual.variable), row, chaotic=False, imposed=imposed),)
