"""A force of the position with another equation than the catalogue's: named by what it depends on."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.findings.residual_map import (
    POSITION,
    ResidualModel,
    forces_of_position,
    residual_model,
)
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.conclusion import beside_a_map, table_of_map
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.select import Selection
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison

_OTHER_SHAPE = (
    "Named by what it depends on: the force of this machine is another function of the position than the equation of "
    "{} says. The equation alone leaves {:.0f} % of the misfit, with a map over the position {:.0f} %."
)


def without_other_shapes(
    found: Selection, executor: Executor, *, rule: Rule = Rule(), effort: Effort = Effort()
) -> Selection:
    """What was `found`, without names that stand in for another shape of a force of the position: see
    `selection.conclusion.beside_a_map`.

    **Arguments:** `found`, a selection; the `executor`, on which maps are tested and refitted; the `rule`; the
    `effort`.
    """
    made: list[ComparisonTable] = []
    base = found.steps[0].before

    def tried(chain: Sequence[Round]) -> ComparisonTable | None:
        *_, before, named = (
            step.accepted.model for step in found.steps[: len(chain)] if step.accepted is not None
        )
        floor = found.steps[len(chain) - 1].floor
        mapped = residual_model(
            before, floor, executor, base=base, variables=(POSITION,), rule=rule, effort=effort
        )
        if mapped is None:
            return None
        rows = (
            compare(base.judgement, model.judgement, floor, rule=rule)
            for model in (mapped.model, named, before)
        )
        made.append(table_of_map(chain, *rows))
        return made[-1]

    decision = beside_a_map(found.decision, tried, rule)
    if decision is found.decision:
        return dataclasses.replace(found, tables=(*found.tables, *made))
    *kept, last = found.steps[: len(decision.rounds)]
    last = dataclasses.replace(last, accepted=None, rivals=(), dropped=decision.rounds[-1].dropped)
    return Selection([*kept, last], decision, (*found.tables, *made))


def over_position(
    residual: ResidualModel,
    base: Model,
    last: Model,
    floor: Float[np.ndarray, "#r #b"],
    *,
    rule: Rule = Rule(),
) -> tuple[ModelComparison, tuple[str, ...]] | None:
    """The model with the map of the `residual` against the base model, and the names of the forces of the position in
    the `last` model, where there are some and the map is over the position, too, and helps; else None.

    **Arguments:** `residual`, a map beside the effects of the `last` model; the `base` model; the `floor`; the `rule`.
    """
    own = forces_of_position(last, base)
    if not own or residual.variable != POSITION or not residual.helps:
        return None
    return compare(base.judgement, residual.model.judgement, floor, rule=rule), own


def other_shape_note(names: tuple[str, ...], alone: float, mapped: float) -> str:
    """The sentence of a force of the position with another equation than those of the effects with these `names`, which
    leave the share `alone` of the misfit, and with a map the share `mapped`."""
    return _OTHER_SHAPE.format(", ".join(names), 100.0 * alone, 100.0 * mapped)
