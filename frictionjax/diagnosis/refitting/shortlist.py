"""Short list: which of the tested effects are worth a refit."""

import numpy as np

from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.model import has_contacts
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.physics.effects import catalogue


def one_of_each(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form, the highest gain first; of those that gain alike, the highest linear gain."""
    by_form: dict[tuple[str, str], Trial] = {}
    for trial in sorted(trials, key=lambda t: (-t.gain, -t.linear_gain)):
        by_form.setdefault((trial.effect, type(trial.form).__name__), trial)
    return list(by_form.values())


def short_list(
    trials: list[Trial], *, most: int, far: bool = False, effort: Effort = Effort()
) -> list[Trial]:
    """The trials worth refitting: the best trial of each form by actual gain, the best by linear gain, and what is
    confused with the leader.

    **Arguments:**

    - `trials`: all trials.
    - `most`: how many forms at most.
    - `far`: the present model is far from the noise. It may sit in a minimum that no single step leaves; the forms that
        promise most are then refitted although no step towards them gains.
    - `effort`: how much is refitted.
    """
    budget, best = effort.screening, one_of_each(trials)
    least_gain = budget.least_gain
    if not best or best[0].gain < least_gain:
        promising = sorted(best, key=lambda t: -t.linear_gain)
        return [t for t in promising if t.linear_gain > least_gain][:most] if far else []
    kept = [t for t in best if t.gain > budget.keep * best[0].gain and t.gain > least_gain][:most]
    linear = sorted(best, key=lambda t: -t.linear_gain)[: budget.linear_forms]
    # What is confused with the leader may be the truth although its first step gains less: with all its forms, for the
    # step of one may be a mirage where that of the other is none.
    lead = best[0].effect
    confused = [t.effect for t in best if t.effect in confused_with(lead) and t.linear_gain > least_gain]
    names = list(dict.fromkeys([lead, *confused]))[: 1 + budget.related]
    related = [t for t in best if t.effect in names and t.linear_gain > least_gain]
    chosen: list[Trial] = []
    for trial in kept + linear + related:
        if np.isfinite(trial.gain) and not any(trial is one for one in chosen):
            chosen.append(trial)
    return chosen


def absorbed_by_base(trials: list[Trial], *, effort: Effort = Effort()) -> list[Trial]:
    """The best trial of each form of which a plain step would be visible and the base parameters can undo most: the
    base fit may have absorbed it as other inertia and friction, and then no small step away from there gains."""
    budget = effort.screening
    absorbed = [t for t in trials if t.absorbed > budget.absorbed and t.shown > budget.visible]
    best: dict[str, Trial] = {}
    for trial in sorted(absorbed, key=lambda t: -t.absorbed):
        best.setdefault(type(trial.form).__name__, trial)
    return list(best.values())[: budget.most_absorbed]


def backlash_candidates(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form of a load behind a gap."""
    return one_of_each([trial for trial in trials if has_contacts(trial.form)])


def confused_with(effect: str) -> frozenset[str]:
    """Names of the effects that the catalogue says are confused with the `effect`, or it with them; itself included."""
    says = {
        name: {n for form in forms for n in form.about.confused_with} for name, forms in catalogue().items()
    }
    return frozenset({effect} | says[effect] | {name for name, others in says.items() if effect in others})
