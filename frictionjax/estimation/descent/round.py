"""One round of the second descent of a fit, and the rule by which the rounds stop: pure functions of its state.

The noise of each recording by its likelihood, then a few Levenberg-Marquardt steps of the parameters.
"""

from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.arrays import known as known_numbers
from frictionjax.estimation.descent.levenberg_marquardt import STRIDE, equal_curvature, levenberg_marquardt
from frictionjax.estimation.evidence import (
    Forces,
    Noise,
    Observed,
    Positions,
    filtered,
    scored_from_the_start,
)
from frictionjax.estimation.objective.posterior import Posterior

_STEPS = 5  # of Levenberg-Marquardt in a round; the first only evaluates the start
ROUNDS = 12
"""Rounds, at most."""
SAME_COST = 0.5
"""Nats of log-likelihood: two rounds that differ by less have the same cost."""
SHORT_MOVE = 1.0
"""Standard deviations of a coordinate, were all others known: a round that moves less is the last, if the noise is the
same, too."""
_SAME_NOISE = np.log(1.2)  # of the logarithm of the likeliest ratio: less is the same noise
NEAR_UNITS = 6.0
"""Times the units of the solver: so near the minimum next to no damping is needed."""
NEAR_TOLERANCE = 0.05
"""Of a unit: steps converge quadratically near the minimum, and the last one leaves far less."""
_MOST_WORSE = 3  # rounds that cost more than the one before, until the descent is given up


class FitState(eqx.Module):
    """Where a fit is between two rounds, or many side by side (arrays then have a leading axis).

    **Attributes:** `posterior` (with the noise levels of the last round), `vector`, shape `(q,)`; `noise` of the
    recordings of position (None without any, or before the first round); `unit` of the solver, shape `(q,)` (None
    before the first round); `cost`: minus the log-posterior, noise included, where the last round's steps ended;
    `ending`: why they did (`Ending.number`).
    """

    posterior: Posterior
    vector: Float[Numbers, "*d q"]
    noise: Noise | None
    unit: Float[Numbers, "*d q"] | None
    cost: Float[Numbers, "*d"]
    ending: Int[Numbers, "*d"]


class RoundProgress(eqx.Module):
    """What the stopping rule knows of the rounds so far.

    **Attributes:** number of `rounds`, cost of the `last` one and the `least` one, how many were `worse` than the one
    before, whether a round without a successful step has been `retried`, `moved` (how far the last round moved a
    coordinate, at most, in its standard deviations were all others known), whether the rounds have `converged`, and
    whether they have `ended`.
    """

    rounds: Int[Numbers, "*d"]
    last: Float[Numbers, "*d"]
    least: Float[Numbers, "*d"]
    worse: Int[Numbers, "*d"]
    retried: Bool[Numbers, "*d"]
    moved: Float[Numbers, "*d"]
    converged: Bool[Numbers, "*d"]
    ended: Bool[Numbers, "*d"]


def with_likeliest_noise(
    state: FitState,
    ratios: Float[Numbers, "r k"] | None,
    known: Bool[Numbers, " r"],
    substeps: int,
    search: Callable = filtered,
) -> FitState:
    """The same vector, with the likeliest noise of every recording.

    **Arguments:**

    - `state`: where the fit is.
    - `ratios`: candidates for the ratio of unmeasured force to position noise, shape `(r, k)`; None without recordings
        of position.
    - `known`: recordings of position whose noise is given, shape `(r,)`.
    - `substeps`: integration steps per sample.
    - `search`: `filtered`, or `filtered_in_pieces` outside of transformations.
    """
    posterior, vector, noise = state.posterior, state.vector, state.noise
    drive, evidence = posterior.drive_of(vector), list(posterior.evidence)
    for index, one in enumerate(evidence):
        z0 = posterior.deflections_of(vector, index)
        if isinstance(one, Forces):
            evidence[index] = one.with_noise_of(drive, z0)
        elif isinstance(one, Observed | Positions):
            batch = scored_from_the_start(one.batch) if isinstance(one, Observed) else one.batch
            evidence[index], noise = search(drive, z0, batch, ratios, known, substeps)
    own = eqx.tree_at(lambda p: p.evidence, posterior, tuple(evidence))
    return FitState(own, vector, noise, state.unit, state.cost, state.ending)


def with_unit(state: FitState) -> FitState:
    """The same with the `unit` of the solver, where there is none yet."""
    if state.unit is not None:
        return state
    unit = NEAR_UNITS * equal_curvature(state.posterior, state.vector)
    return FitState(state.posterior, state.vector, state.noise, unit, state.cost, state.ending)


def one_round(
    state: FitState,
    ratios: Float[Numbers, "r k"] | None,
    known: Bool[Numbers, " r"],
    substeps: int,
    search: Callable = filtered,
) -> FitState:
    """The noise of each recording by its likelihood, then a few Levenberg-Marquardt steps; arguments as in
    `with_likeliest_noise`. Works inside transformations."""
    there = with_unit(with_likeliest_noise(state, ratios, known, substeps, search))
    posterior, unit = there.posterior, there.unit
    assert unit is not None
    end = levenberg_marquardt(posterior, there.vector, unit, _STEPS, tolerance=NEAR_TOLERANCE)
    vector = posterior.within(end.vector)
    cost = end.cost + posterior.log_deviation
    own = posterior.reaching(vector)
    return FitState(own, vector, there.noise, NEAR_UNITS * end.unit, cost, end.ending)


def judged(
    progress: RoundProgress, before: FitState, after: FitState
) -> tuple[RoundProgress, Bool[Numbers, ""], Bool[Numbers, ""]]:
    """The stopping rule: the progress after the round from `before` to `after`, whether its steps have all failed, and
    whether it is the likeliest so far. Works inside transformations."""
    xp, (progress, after, old, noise) = known_numbers(progress, after, before.vector, before.noise)
    cost, last = after.cost, progress.last
    # Every step failed: at the minimum, or where the cost is too curved for next to no damping.
    failed = xp.all(after.vector == old) & ~progress.retried & (progress.rounds < ROUNDS - 1)
    better = cost < progress.least
    far = xp.max(xp.abs(after.vector - old) * STRIDE * NEAR_UNITS / after.unit)
    at_rest = ~(far > SHORT_MOVE)
    if noise is not None and after.noise is not None:
        change = xp.abs(xp.log(after.noise.best) - xp.log(noise.best))
        at_rest = at_rest & xp.all(change < _SAME_NOISE)
    converged = ~failed & ((xp.abs(last - cost) < SAME_COST) | at_rest)
    # Other weights may cost a round what the next ones win back.
    worse = progress.worse + xp.where(~failed & (cost > last), 1, 0)
    rounds = progress.rounds + 1
    now = RoundProgress(
        rounds=rounds,
        last=xp.where(failed & ~(cost < last), last, cost),
        least=xp.where(better, cost, progress.least),
        worse=worse,
        retried=failed | (progress.retried & ~(better & ~failed)),
        moved=far,
        converged=converged,
        ended=converged | (worse > _MOST_WORSE) | (rounds >= ROUNDS),
    )
    return now, failed, better
