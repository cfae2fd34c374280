"""Comparisons of two models as plain numbers: what a rule decides by, and what is kept of a search.

A model with one more effect is compared with the model without it, above the floor of each block. All that decides is
in these numbers, so that another rule can be tried on them without a refit.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.rule import Rule

SCHEMA = "frictionjax.comparisons/1"
_DIGITS = 6  # of the gains by cluster, when they are stored

Both = tuple[float, float]
"""A number of the fitted recordings, and the same of the held-out ones."""


@dataclasses.dataclass(frozen=True)
class Lead:
    """By how much one model leads another over paired clusters of 0.5 s.

    **Attributes:** `total` (sum of the differences of their losses), `error` (its standard error), `clusters` (how many
    differ).
    """

    total: float
    error: float
    clusters: int

    def in_errors(self, rule: Rule) -> float:
        """The lead in its standard errors; 0 where there are too few clusters for one, by the `rule`."""
        return 0.0 if self.clusters < rule.accept.least_clusters else self.total / self.error


def paired_lead(gains: Float[np.ndarray, "..."]) -> Lead:
    """The lead that the `gains` of paired clusters add up to; clusters that do not differ do not count."""
    own = gains[gains != 0.0]
    if own.size == 0:
        return Lead(0.0, 0.0, 0)
    error = float(np.sqrt(own.size)) * max(float(own.std()), 1e-300)
    return Lead(float(own.sum()), error, int(own.size))


@dataclasses.dataclass(frozen=True)
class Improvement:
    """By how much the second model of a comparison is better than the first, by a rule.

    **Attributes:** `share_fit`, `share_holdout` (share of the misfit above the floor that is removed), `energy_fit`,
    `energy_holdout` (share of the power), `lead_fit`, `lead_holdout` (gain in its standard errors), `repeats` (whether
    all that is periodic along the stroke is recorded to repeat in it).
    """

    share_fit: float
    share_holdout: float
    energy_fit: float
    energy_holdout: float
    lead_fit: float
    lead_holdout: float
    repeats: bool

    @property
    def lead(self) -> float:
        """Gain on both together in standard errors, each with the same weight (Stouffer): the sum of the gains would be
        as uncertain as the noisier of the two."""
        return (self.lead_fit + self.lead_holdout) / math.sqrt(2.0)

    @property
    def worth(self) -> float:
        """Sum of the explained shares: what candidates are ranked by."""
        return self.share_fit + self.share_holdout

    @property
    def share(self) -> float:
        """The smaller one of the explained shares."""
        return min(self.share_fit, self.share_holdout)

    @property
    def energy(self) -> float:
        """The smaller one of the shares of the power."""
        return min(self.energy_fit, self.energy_holdout)


@dataclasses.dataclass(frozen=True)
class ModelComparison:
    """One model against another, above one floor.

    **Attributes:** `before`, `after` (forms of the effects in the two models), `effect` and `form` (names of the one
    that is added; empty where several are), `exact` (of each effect that `before` lacks, whether its equation is
    exact), `misfits_before`, `misfits_after` (per sample above the floor), `misfit_errors` (their standard errors for a
    perfect model), `energies` (share of the power that is removed), `fit`, `held_out` (leads over the model without),
    `waves` (of each period, how many the stroke holds, and whether it is that of a force beside another force), `free`
    (parameters of `after`), `chaotic` (whether `after` has a gap), `p_value` (score test of the effect, Bonferroni over
    its forms and grid), `gains_fit`, `gains_held_out` (difference of the losses by cluster), `makes_credible` (whether
    `before` predicts no better than no model and `after` does, by the rule with which the table was made), `ahead`
    (lead over the model without its last effect in the logarithms of the errors of held-out positions 0.1 s ahead; None
    where it was not asked for, and where the motion is imposed).
    """

    before: tuple[str, ...]
    after: tuple[str, ...]
    effect: str
    form: str
    exact: tuple[bool, ...]
    misfits_before: Both
    misfits_after: Both
    misfit_errors: Both
    energies: Both
    fit: Lead
    held_out: Lead
    waves: tuple[tuple[float, bool], ...] = ()
    free: int = 0
    chaotic: bool = False
    p_value: float = 0.0
    gains_fit: tuple[float, ...] = ()
    gains_held_out: tuple[float, ...] = ()
    makes_credible: bool = False
    ahead: Lead | None = None

    def gains(self, rule: Rule) -> Improvement:
        """What the comparison says by the `rule`."""
        return Improvement(
            *shares(self.misfits_before, self.misfits_after, rule),
            *self.energies,
            self.fit.in_errors(rule),
            self.held_out.in_errors(rule),
            repeats(self.waves, rule),
        )

    def lead_over(self, other: "ModelComparison") -> Lead:
        """By how much `after` leads that of the `other` comparison, with the same model before and above the same
        floor, over the clusters of all recordings."""
        own, its = (np.array([*one.gains_fit, *one.gains_held_out]) for one in (self, other))
        return paired_lead(own - its)


@dataclasses.dataclass(frozen=True)
class ComparisonTable:
    """All comparisons of one step of the selection.

    **Attributes:** `key` (its name among the tables of a diagnosis), `asked` (the step: a move of the search, and the
    rounds that it goes on from), `before` (forms of the effects in the model without the candidates), `misfits` of that
    model, `misfit_errors` (their standard errors for a perfect model), `chaotic` (whether it has a gap), `rows` (one
    candidate each), `between` (row, other row, and by how much the first leads over all recordings), `force`
    (unmeasured force over Coulomb friction), `excused` (whether the floor was raised for a candidate with a gap, by the
    ranking of the rule with which the table was made), `imposed` (whether the motion is imposed: an accepted model is
    then refitted).
    """

    key: str
    asked: tuple[str, ...]
    before: tuple[str, ...]
    misfits: Both
    misfit_errors: Both
    chaotic: bool
    rows: tuple[ModelComparison, ...]
    between: tuple[tuple[int, int, Lead], ...] = ()
    force: float = 0.0
    excused: bool = False
    imposed: bool = False

    @property
    def is_first(self) -> bool:
        """Whether it holds the candidates for the first name."""
        return self.asked[:2] == ("candidates", "0")

    def lead(self, row: int, other: int, rule: Rule) -> float:
        """By how many standard errors the candidate `row` leads the `other` one over all recordings, by the `rule`."""
        for first, second, lead in self.between:
            if (first, second) == (row, other):
                return lead.in_errors(rule)
            if (first, second) == (other, row):
                return -lead.in_errors(rule)
        raise KeyError(f"rows {row} and {other} of table {self.key} were not compared")


@dataclasses.dataclass(frozen=True)
class OtherDecision:
    """What was decided by a few numbers of two models, not by their likelihood above a floor: no table holds it.

    **Attributes:** `about` (what was decided), `numbers` (by name).
    """

    about: str
    numbers: Mapping[str, float]


def table_of_one(
    key: str, asked: tuple[str, ...], row: ModelComparison, *, chaotic: bool, imposed: bool
) -> ComparisonTable:
    """A table of the comparison `row` alone; the other arguments are those of a `ComparisonTable`."""
    errors = row.misfit_errors
    return ComparisonTable(
        key, asked, row.before, row.misfits_before, errors, chaotic, (row,), imposed=imposed
    )


def within(misfits: Both, errors: Both, most: float, rule: Rule) -> tuple[bool, bool]:
    """Whether the `misfits` are below `most` and what chance adds in recordings of this length (fit, held out).

    **Arguments:** `misfits`, their standard `errors` for a perfect model, the limit `most`, and the `rule`.
    """
    fit, held = (
        misfit < most + rule.limits.sure * error for misfit, error in zip(misfits, errors, strict=True)
    )
    return fit, held


def shares(before: Both, after: Both, rule: Rule) -> Both:
    """Share of the misfits `before` that is not there `after`, by the `rule`.

    Where one set shows what the other hardly does, what the other leaves is counted against what would be adequate: a
    share of a misfit at the floor is chance.
    """
    wholes = whole_misfits(before, rule)
    fit, held = (1.0 - new / whole if whole > 0.0 else 0.0 for whole, new in zip(wholes, after, strict=True))
    return fit, held


def whole_misfits(misfits: Both, rule: Rule) -> Both:
    """What a share of the `misfits` is a share of, by the `rule`."""
    adequate = rule.limits.adequate
    least = adequate if max(misfits) > adequate else 0.0
    return max(misfits[0], least), max(misfits[1], least)


def repeats(waves: Iterable[tuple[float, bool]], rule: Rule) -> bool:
    """Whether the stroke holds enough of each of the `waves`, by the `rule`.

    A part of a wave can imitate any force that depends on the position; beside another such force, a wave with its
    overtone can imitate whatever that one leaves, unless it is recorded twice.
    """
    return all(
        count >= (rule.accept.waves_beside if beside else rule.accept.waves) for count, beside in waves
    )


def table_json(table: ComparisonTable) -> dict[str, Any]:
    """The `table` for JSON, with the gains by cluster rounded."""
    content = dataclasses.asdict(table)
    for row in content["rows"]:
        for name in ("gains_fit", "gains_held_out"):
            row[name] = [float(f"{gain:.{_DIGITS}g}") for gain in row[name]]
    return content


def table_of(content: Mapping[str, Any]) -> ComparisonTable:
    """The table whose `table_json` is the `content`."""
    fields: dict[str, Any] = {
        **content,
        "asked": tuple(content["asked"]),
        "before": tuple(content["before"]),
        "misfits": _both(content["misfits"]),
        "misfit_errors": _both(content["misfit_errors"]),
        "rows": tuple(_comparison_of(row) for row in content["rows"]),
        "between": tuple((row, other, Lead(**lead)) for row, other, lead in content["between"]),
    }
    return ComparisonTable(**fields)


def _comparison_of(content: Mapping[str, Any]) -> ModelComparison:
    pairs = ("misfits_before", "misfits_after", "misfit_errors", "energies")
    lists = ("before", "after", "exact", "gains_fit", "gains_held_out")
    fields: dict[str, Any] = {
        **content,
        **{name: _both(content[name]) for name in pairs},
        **{name: tuple(content[name]) for name in lists},
        "ahead": Lead(**content["ahead"]) if content.get("ahead") else None,
        "fit": Lead(**content["fit"]),
        "held_out": Lead(**content["held_out"]),
        "waves": tuple((math.inf if count is None else count, beside) for count, beside in content["waves"]),
    }
    return ModelComparison(**fields)


def _both(values: Iterable[float | None]) -> Both:
    fit, held = (math.nan if value is None else value for value in values)
    return fit, held
