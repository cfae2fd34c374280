"""Refit: the short list of candidates, converged with all parameters free, and judged."""

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.judge import Judgement, advantage, energy_explained, explained, judge
from frictionjax.diagnosis.name import Trial
from frictionjax.estimation.joint import SLOW_BANDWIDTH, Joint
from frictionjax.estimation.robust_fit import Fitted, descend

_LEFT = 0.5  # part of the present misfit: a refit that leaves more of it gets a second start
_KEEP = 0.1  # a candidate that gains less than this part of the best one is not refitted


class Model(eqx.Module):
    """A fitted structure: `joint` (slow observer), where the descent ended, `fitted`, and its `judgement`."""

    joint: Joint
    fitted: Fitted
    judgement: Judgement


class Refitted(eqx.Module):
    """A candidate, refitted.

    **Attributes:** `trial`, `model`.
    """

    trial: Trial
    model: Model

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.trial.effect

    @property
    def form(self) -> str:
        """Name of its form."""
        return type(self.trial.form).__name__


class Compared(eqx.Module):
    """A refitted candidate against the model without it.

    **Attributes:** `share_fit`, `share_holdout` (share of the misfit above the floor that it removes), `energy_fit`,
    `energy_holdout` (share of the power), `lead_fit`, `lead_holdout` (gain in its standard errors, over clusters of
    0.5 s).
    """

    share_fit: float
    share_holdout: float
    energy_fit: float
    energy_holdout: float
    lead_fit: float
    lead_holdout: float

    @property
    def worth(self) -> float:
        """Sum of the explained shares: what the candidates are ranked by."""
        return self.share_fit + self.share_holdout


def compare(before: Judgement, after: Judgement, floor: np.ndarray) -> Compared:
    """`after` against `before`, above the `floor` of each block."""
    held = before.held_out
    return Compared(
        *explained(before, after, floor),
        *energy_explained(before, after, floor),
        advantage(after, before, ~held, floor),
        advantage(after, before, held, floor),
    )


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
        by_form.setdefault((trial.effect, type(trial.form).__name__), trial)
    best = sorted(by_form.values(), key=lambda t: -t.gain)
    if not best or best[0].gain < least_gain:
        promising = sorted(by_form.values(), key=lambda t: -t.linear_gain)
        return [t for t in promising if t.linear_gain > least_gain][:most] if far else []
    kept = [t for t in best if t.gain > _KEEP * best[0].gain and t.gain > least_gain][:most]
    linear = sorted(by_form.values(), key=lambda t: -t.linear_gain)[:2]
    return kept + [t for t in linear if t not in kept and np.isfinite(t.gain)]


def refit(trial: Trial, present_misfit: float) -> Refitted:
    """Refit one trial from its one-step estimate: fast observer, then slow; then judge it.

    A base model with something missing may have come to rest far from the truth, and a candidate that starts there may
    look refuted. One that leaves most of `present_misfit` is fitted again, from where the base fit began.
    """
    best = _converged(trial.joint, trial.vector, graduate=False)
    if best.misfit > _LEFT * present_misfit:
        again = _converged(trial.joint, trial.joint.setting.start, graduate=True)
        best = min(best, again, key=lambda fitted: fitted.misfit)
    return _refitted(trial, best)


def _refitted(trial: Trial, fitted: Fitted) -> Refitted:
    slow = trial.joint.at_bandwidth(SLOW_BANDWIDTH)
    return Refitted(trial, Model(slow, fitted, judge(slow, fitted)))


def _converged(joint: Joint, vector, *, graduate: bool) -> Fitted:
    """After a descent with the fast observer, then with the slow one."""
    fast = descend(joint, vector, graduate=graduate, steps=12, tolerance=0.05)
    return descend(joint.at_bandwidth(SLOW_BANDWIDTH), fast.vector, graduate=False, steps=15, tolerance=0.01)


def polish(candidate: Refitted) -> Refitted:
    """The same refit, converged: for those that may be named."""
    model = candidate.model
    return _refitted(candidate.trial, descend(model.joint, model.fitted.vector, graduate=False, steps=25))
