"""What is reported of every effect of the catalogue: tested or not, significant or not, and why it was not named."""

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import acceptable
from frictionjax.diagnosis.selection.candidate_table import effect_p_values
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.verdict import Candidate
from frictionjax.physics.effects import catalogue

_NO_MOTION = "the recordings hold no motion that would show it"
_NOTHING_LEFT = (
    "not tested: without the force that carries the machine the base model is too far off for a test"
)


def candidates(
    steps: list[Step], units: dict[str, str], untestable: dict[str, str], *, rule: Rule = Rule()
) -> tuple[Candidate, ...]:
    """One row per effect: from the first round, or from the one in which it was accepted, or refitted and dropped.

    **Arguments:**

    - `steps`: the rounds of the selection.
    - `units`: names for force, position, input.
    - `untestable`: effect -> why the recordings cannot show it.
    - `rule`: what decided.
    """
    rows = [_row(name, steps, units, untestable.get(name, ""), rule) for name in catalogue()]
    return tuple(sorted(rows, key=lambda c: (c.reason != "named", not c.tested, c.p_value)))


def _row(name: str, steps: list[Step], units: dict[str, str], why_not: str, rule: Rule) -> Candidate:
    rounds = [step for step in steps if any(t.effect == name for t in step.trials)]
    named = next((s for s in steps if s.accepted is not None and s.accepted.effect == name), None)
    dropped = next((s for s in rounds if s.dropped and any(r.effect == name for r in s.refits)), None)
    step = named or dropped or (rounds[0] if rounds else None)
    if step is None:
        first = any(row.makes_credible for step in steps for row in step.compared)
        reason = why_not or (_NOTHING_LEFT if first else _NO_MOTION)
        return Candidate(name, float("nan"), {}, False, reason)
    if named is not None and named.accepted is not None:
        trial = named.accepted.trial
    else:
        trial = max((t for t in step.trials if t.effect == name), key=lambda t: (t.gain, t.linear_gain))
    p_value = effect_p_values(step.trials)[name]
    refits = [c for r, c in zip(step.refits, step.compared, strict=True) if r.effect == name]
    best = max(refits, key=lambda c: c.gains(rule).worth, default=None)
    gains = best.gains(rule) if best is not None else None
    if named is not None:
        reason = "named"
    elif why_not:
        reason = why_not
    elif best is not None:
        refused = acceptable(best, rule, least_share=step.least_share)[1]
        reason = refused or step.dropped or "another effect explains the same better"
    else:
        reason = "its first step gains too little for a refit"
    return Candidate(
        effect=name,
        p_value=p_value,
        minimum_detectable=trial.detectable,
        tested=not why_not,
        reason=reason,
        gain_fit=gains.share_fit if gains else float("nan"),
        gain_holdout=gains.share_holdout if gains else float("nan"),
        one_step=trial.one_step,
        units={p.name: _unit(p.unit, units) for p in trial.form.strengths},
    )


def _unit(pattern: str, units: dict[str, str]) -> str:
    for name, text in units.items():
        pattern = pattern.replace("{" + name + "}", text)
    return pattern
