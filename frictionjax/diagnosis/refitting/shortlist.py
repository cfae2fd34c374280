"""Short list: which of the tested effects are worth a refit."""

import numpy as np

from frictionjax.diagnosis.evidence.model import has_contacts
from frictionjax.diagnosis.screening.score_test import Trial

_KIN = 2  # effects that are easily taken for the leader and are refitted with it, in all their forms

_MASKED, _PLAIN = 0.9, 1.0  # part of a step that base parameters undo; its power over that of the noise

_MOST_MASKED = 5

_KEEP = 0.1  # a candidate that gains less than this part of the best one is not refitted


def one_of_each(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form, the highest gain first; of those that gain alike, the highest linear gain."""
    by_form: dict[tuple[str, str], Trial] = {}
    for trial in sorted(trials, key=lambda t: (-t.gain, -t.linear_gain)):
        by_form.setdefault((trial.effect, type(trial.form).__name__), trial)
    return list(by_form.values())


def short_list(trials: list[Trial], *, most: int, least_gain: float, far: bool = False) -> list[Trial]:
    """The trials worth refitting: the best trial of each form by actual gain, the two best by linear gain, and what is
    easily taken for the leader.

    **Arguments:**

    - `trials`: all trials.
    - `most`: how many forms at most.
    - `least_gain`: actual gain below which nothing is refitted.
    - `far`: the present model is far from the noise. It may sit in a minimum that no single step leaves; the forms that
        promise most are then refitted although no step towards them gains.
    """
    best = one_of_each(trials)
    if not best or best[0].gain < least_gain:
        promising = sorted(best, key=lambda t: -t.linear_gain)
        return [t for t in promising if t.linear_gain > least_gain][:most] if far else []
    kept = [t for t in best if t.gain > _KEEP * best[0].gain and t.gain > least_gain][:most]
    linear = sorted(best, key=lambda t: -t.linear_gain)[:2]
    # What is easily taken for the leader may be the truth although its first step gains less: with all its forms, for
    # the step of one may be a mirage where that of the other is none.
    lead = best[0].form
    alike = [
        t.effect
        for t in best
        if (t.effect in lead.about.confused_with or lead.name in t.form.about.confused_with)
        and t.linear_gain > least_gain
    ]
    near = list(dict.fromkeys([lead.name, *alike]))[: 1 + _KIN]
    kin = [t for t in best if t.effect in near and t.linear_gain > least_gain]
    chosen: list[Trial] = []
    for trial in kept + linear + kin:
        if np.isfinite(trial.gain) and not any(trial is one for one in chosen):
            chosen.append(trial)
    return chosen


def hidden_in_the_base(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form of which a plain step would show and the base parameters can undo most: a base fit
    may have taken it for a machine of other inertia and friction, and then no small step away from that one gains."""
    masked = [trial for trial in trials if trial.absorbed > _MASKED and trial.shown > _PLAIN]
    best: dict[str, Trial] = {}
    for trial in sorted(masked, key=lambda t: -t.absorbed):
        best.setdefault(type(trial.form).__name__, trial)
    return list(best.values())[:_MOST_MASKED]


def behind_gaps(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form of a load behind a gap."""
    return one_of_each([trial for trial in trials if has_contacts(trial.form)])
