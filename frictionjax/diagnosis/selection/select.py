"""Select: stepwise selection of effects, each accepted only if fit and held-out recordings agree."""

import dataclasses
from collections.abc import Callable, Iterator
from concurrent.futures import Executor

import numpy as np

from frictionjax.core import Progress
from frictionjax.diagnosis.base_model.likeliest import at_the_pace_of
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import is_coarse
from frictionjax.diagnosis.refitting.refitted import Refitted, ease
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.resonance import resonance_pair
from frictionjax.diagnosis.selection.answers import Answers
from frictionjax.diagnosis.selection.refit_candidates import CandidateRefitter
from frictionjax.diagnosis.selection.refitted_tables import RefittedTables, lower_base
from frictionjax.diagnosis.selection.search import Decision, decide
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.table import ComparisonTable
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start.force_balance import Balanced


@dataclasses.dataclass(frozen=True)
class Selection:
    """What a selection came to.

    **Attributes:** `steps` (its rounds, with their models), `decision` (what is named, and why), `tables` (every
    comparison that was made).
    """

    steps: list[Step]
    decision: Decision
    tables: tuple[ComparisonTable, ...]


def select(
    model: Model,
    executor: Executor,
    progress: Progress,
    *,
    without: frozenset[str] = frozenset(),
    barred: frozenset[str] = frozenset(),
    stick_inertia: float | None = None,
    balanced: Callable[[], tuple[Balanced, ...]] = tuple,
    carried: bool = False,
    turn: float = 2.0 * np.pi,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> Selection:
    """Add effects to the fitted base model while fit and held-out recordings agree on them.

    **Arguments:**

    - `model`: the fitted base model.
    - `executor`: runs tests and refits side by side.
    - `progress`: called as it goes.
    - `without`: names of effects, or of forms, to leave out of the catalogue.
    - `barred`: names of effects that are tested, for their smallest detectable size, but not refitted.
    - `stick_inertia`: the inertia that noise in stick shows, where a recording has some.
    - `balanced`: gives the forces that the force balance asks for; called only where refits are stuck.
    - `carried`: the base model is none of the machine, because one of those forces carries most of the motor force:
        the first effect is one of them.
    - `turn`: a full turn, position units, where the position is an angle.
    - `rule`: what decides.
    - `effort`: how much is tested and refitted.

    Under a coarse sensor the gains of the observers are those that the base model asks for. What is found may show that
    they are wrong for the machine, and such gains may as well hide what is left. If the model that was found misses
    more with its own gains, or less although something is left, the selection is made once more with those, and its
    refits start from there, too; the tables of the first one follow those of the second.

    A base fit may have come to rest in a side valley, out of which any effect leads. If the base model ends lower from
    where a model with an effect ended, the selection is made once more with that base model.
    """

    shown = 0.0

    def selected(base: Model, before: tuple[Refitted, ...] = ()) -> Selection:
        done = shown  # of what the last selection left

        def beyond(stage: str, fraction: float) -> None:
            nonlocal shown
            shown = done + (1.0 - done) * fraction
            progress(stage, shown)

        known = (without, barred, stick_inertia, balanced, carried, turn, before)
        return _selected(base, executor, beyond, *known, rule, effort)

    found, base = selected(model), model
    for another in (_from_lower_base, _at_the_pace_of):
        again = another(found, base, rule)
        if again is not None:
            base, before = again, found
            found = selected(base, tuple(refit for step in before.steps for refit in step.refits))
            found = dataclasses.replace(found, tables=(*found.tables, *of_another_base(before.tables)))
    return found


def of_another_base(tables: tuple[ComparisonTable, ...]) -> Iterator[ComparisonTable]:
    """The `tables` of a selection that was made again with another base model, under names that no search asks for."""
    for table in tables:
        yield dataclasses.replace(table, key=f"first {table.key}", asked=("another base", *table.asked))


def _best_of(found: Selection) -> Model | None:
    """What was `found`, or, where nothing was accepted, the candidate that explains most; None where nothing was
    accepted and nothing is left."""
    accepted = [step.accepted for step in found.steps if step.accepted is not None]
    best = accepted[-1:] or (found.steps[0].refits[:1] if found.decision.remains else [])
    return best[0].model if best else None


def _from_lower_base(found: Selection, base: Model, rule: Rule) -> Model | None:
    """The `base` model, where it ends lower from what was `found`; else None."""
    best = _best_of(found)
    return None if best is None else lower_base(best, base, rule)


def _at_the_pace_of(found: Selection, base: Model, rule: Rule) -> Model | None:
    """The `base` model observed as what was `found` asks for; None where nothing changes."""
    best = _best_of(found)
    if best is None or not is_coarse(base.posterior):
        return None
    return at_the_pace_of(best, base, remains=found.decision.remains, rule=rule)


def _selected(
    model: Model,
    executor: Executor,
    progress: Progress,
    without: frozenset[str],
    barred: frozenset[str],
    stick_inertia: float | None,
    balanced: Callable[[], tuple[Balanced, ...]],
    carried: bool,
    turn: float,
    before: tuple[Refitted, ...],
    rule: Rule,
    effort: Effort,
) -> Selection:
    """As `select`, at the pace of the `model`."""
    model = ease(model, rule=rule, effort=effort)
    posterior = model.posterior
    scales = plant_scales(model.judgement.drive, posterior.batch, turn=turn)
    answers = Answers(model, executor, rule=rule)
    pair = None
    if not posterior.batch.imposed:
        fitted = np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
        pair = resonance_pair(posterior.batch, fitted)  # type: ignore[arg-type]
    candidates = CandidateRefitter(
        executor,
        progress,
        turn,
        pair,
        without,
        barred,
        stick_inertia,
        balanced,
        rule,
        effort,
        base_effects=len(posterior.drive.effects),
        carried=carried,
        before=before,
    )
    tables = RefittedTables(model, candidates, scales, answers.of_likeliest, rule=rule, effort=effort)
    decision = decide(tables, rule, effort.rounds)
    return Selection([tables.step(one) for one in decision.rounds], decision, tuple(tables.tables))
