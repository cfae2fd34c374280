"""What the input does between samples, where the case leaves it to the recordings (`hold = "auto"`): held, or straight
from one sample to the next, by the likelihood of the base model."""

import dataclasses
from concurrent.futures import Executor
from typing import Literal

import numpy as np

from frictionjax.core import Progress
from frictionjax.diagnosis.base_model.fit_base import base_of, fit_base
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import Judgement
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.intake.starting_point import StartingPoint, starting_point
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import ComparisonTable, ModelComparison, table_of_one
from frictionjax.recordings import Case

Hold = Literal["zero", "linear"]
HOLD = "hold"

WORDS: dict[Hold, str] = {"zero": "held between samples", "linear": "linear between samples"}
_NATS = 2.0  # of log-likelihood in one of the loss of a block
_SAID = (
    'The input is taken to be {} (hold = "auto"): the log-likelihood of the base model on the fitted recordings is '
    "{:.3g} ± {:.2g} higher than with an input that is {}."
)


def with_hold(case: Case, hold: Hold) -> Case:
    """The `case` with an input that is known to do this between samples."""
    return dataclasses.replace(case, plant=dataclasses.replace(case.plant, hold=hold))


def linear_against_held(linear: Judgement, held: Judgement, *, rule: Rule = Rule()) -> ModelComparison:
    """The base model fitted with an input that is `linear` between samples against the one with an input that is
    `held`, above the noise; both with the same observers and steps. `rule`: as in `compare`."""
    return compare(held, linear, np.ones((1, 1)), rule=rule)


def likelier(row: ModelComparison) -> Hold:
    """Which input is likelier on the fitted recordings, by the `row` that compares them; the held one where neither
    is."""
    return "linear" if row.fit.total > 0.0 else "zero"


def base_with_likelier_hold(
    case: Case, starting: StartingPoint, executor: Executor, progress: Progress, *, rule: Rule = Rule()
) -> tuple[Case, StartingPoint, Model, tuple[str, ...], tuple[ComparisonTable, ...]]:
    """The `case` with the likelier input, its starting point, its base model, what is to be said of the choice, and the
    comparison that made it; where the input of the case is known, the case as it is, and nothing.

    **Arguments:** `starting`: of the case, with a held input where the recordings are to decide; `executor`,
    `progress`, `rule`: as in `base_of`.
    """
    base = base_of(starting, executor, progress, rule=rule)
    if case.plant.hold != "auto" or starting.imposed:
        return case, starting, base, (), ()
    cases: dict[Hold, Case] = {hold: with_hold(case, hold) for hold in WORDS}
    progress("base fit: linear input", 0.9)
    straight = starting_point(cases["linear"])
    drives, batch, held_out = straight.start.drives, straight.batch, straight.held_out
    other = fit_base(
        drives, batch, held_out, executor, progress, fixed=straight.own.fixed, like=base, rule=rule
    )
    row = linear_against_held(other.judgement, base.judgement, rule=rule)
    tables = (table_of_one(HOLD, (HOLD,), row, chaotic=False, imposed=False),)
    chosen = likelier(row)
    rest: Hold = "zero" if chosen == "linear" else "linear"
    total, error = _NATS * abs(row.fit.total), _NATS * row.fit.error
    said = (_SAID.format(WORDS[chosen], total, error, WORDS[rest]),)
    if chosen == "zero":
        return cases[chosen], starting, base, said, tables
    # Observers and steps were those of the held input.
    return cases[chosen], straight, base_of(straight, executor, progress, rule=rule), said, tables
