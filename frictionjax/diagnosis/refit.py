"""Refit: the short list of candidates, converged with all parameters free, and judged."""

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.diagnosis.judge import Judgement, Scene, energy_explained, explained, judge
from frictionjax.diagnosis.name import Trial
from frictionjax.estimation.observer_fit import descend
from frictionjax.estimation.problem import SLOW_BANDWIDTH, Problem

_LEFT = 0.5  # part of the present misfit: a refit that leaves more of it gets a second start
_KEEP = 0.1  # a candidate that gains less than this part of the best one is not refitted


class Refitted(eqx.Module):
    """A candidate, refitted and judged.

    **Attributes:** `trial`, `problem` (slow observer), `vector`, `judgement`, `share_fit`, `share_holdout` (share
    of the present misfit explained), `energy_fit`, `energy_holdout` (share of the present excess power).
    """

    trial: Trial
    problem: Problem
    vector: Float[Array, " q"]
    judgement: Judgement
    share_fit: float
    share_holdout: float
    energy_fit: float
    energy_holdout: float

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.trial.effect

    @property
    def worth(self) -> float:
        """Sum of the explained shares: what the candidates are ranked by."""
        return self.share_fit + self.share_holdout


def short_list(trials: list[Trial], *, most: int, least_gain: float, far: bool = False) -> list[Trial]:
    """The trials worth refitting: the best trial of each form by actual gain, and the two best by linear gain.

    **Arguments:**

    - `trials`: all trials.
    - `most`: how many forms at most.
    - `least_gain`: actual gain below which nothing is refitted.
    - `far`: the present model is far from the noise. It may sit in a minimum that no single step leaves; the forms that
        promise most are then refitted although no step towards them gains.
    """
    by_form: dict[tuple[str, str], Trial] = {}
    for trial in sorted(trials, key=lambda t: (-t.gain, -t.linear_gain)):
        form = type(trial.drive.effects[-1]).__name__
        by_form.setdefault((trial.effect, form), trial)
    best = sorted(by_form.values(), key=lambda t: -t.gain)
    if not best or best[0].gain < least_gain:
        promising = sorted(by_form.values(), key=lambda t: -t.linear_gain)
        return [t for t in promising if t.linear_gain > least_gain][:most] if far else []
    kept = [t for t in best if t.gain > _KEEP * best[0].gain and t.gain > least_gain][:most]
    linear = sorted(by_form.values(), key=lambda t: -t.linear_gain)[:2]
    return (
        kept + [t for t in linear if t not in kept and t.gain > 0.25 * least_gain][: max(most - len(kept), 0)]
    )


def refit(trial: Trial, present: Judgement, scene: Scene) -> Refitted:
    """Refit one trial from its one-step estimate: fast observer, then slow; then judge it against `present`.

    A base model with something missing may have come to rest far from the truth, and a candidate that starts there may
    look refuted. One that explains little is fitted again, from where the base fit began.

    **Arguments:**

    - `trial`: the candidate.
    - `present`: judgement of the model without it.
    - `scene`: all recordings.
    """
    vector, value = _converged(trial.problem, trial.vector, graduate=False)
    if value > _LEFT * present.misfit_fit:
        again, other = _converged(trial.problem, trial.problem.setting.start, graduate=True)
        if other < value:
            vector = again
    slow = trial.problem.at_bandwidth(SLOW_BANDWIDTH)
    return _compared(trial, slow, vector, judge(slow.drive(vector), scene), present, scene)


def _converged(problem: Problem, vector: Float[Array, " q"], *, graduate: bool):
    """Vector and misfit after a descent with the fast observer, then with the slow one."""
    vector, _, _ = descend(problem, vector, graduate=graduate, rounds=6, tolerance=0.2)
    slow = problem.at_bandwidth(SLOW_BANDWIDTH)
    return descend(slow, vector, graduate=False, rounds=15, tolerance=0.02)[:2]


def polish(candidate: Refitted, present: Judgement, scene: Scene) -> Refitted:
    """The same refit, converged: for the one that is to be named. Arguments as for `rejudged`."""
    vector, _, _ = descend(candidate.problem, candidate.vector, graduate=False, rounds=8)
    problem = candidate.problem
    return _compared(candidate.trial, problem, vector, judge(problem.drive(vector), scene), present, scene)


def rejudged(candidate: Refitted, present: Judgement, scene: Scene) -> Refitted:
    """The same refit, its shares told against another judgement `present` of the model without it, in `scene`.

    **Arguments:** `candidate`, `present`, `scene`.
    """
    return _compared(
        candidate.trial, candidate.problem, candidate.vector, candidate.judgement, present, scene
    )


def _compared(trial, problem, vector, judgement, present, scene) -> Refitted:
    share_fit, share_holdout = explained(present, judgement)
    energy_fit, energy_holdout = energy_explained(present, judgement, scene)
    return Refitted(trial, problem, vector, judgement, share_fit, share_holdout, energy_fit, energy_holdout)
