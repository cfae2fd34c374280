"""The rounds of a fit: when they stop, which one is kept, and that fits side by side do not touch each other."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Bool, Float

from frictionjax.estimation.descent.refine import AbstractRounds, ManyFits, _to_the_minimum
from frictionjax.estimation.descent.round import NEAR_UNITS, ROUNDS, FitState, RoundProgress, judged
from frictionjax.estimation.evidence import Noise

pytestmark = pytest.mark.untyped

UNIT = NEAR_UNITS * 5.0
"""Of the solver, where a coordinate's standard deviation is 1."""


class Nothing(eqx.Module):
    """Stands for a `Posterior` without evidence."""

    evidence: tuple[()] = ()


def _state(place, cost, ratio=1.0):
    noise = Noise(jnp.ones(1), jnp.ones(1), jnp.asarray([ratio]))
    unit, ending = jnp.asarray([UNIT]), jnp.asarray(0)
    return FitState(Nothing(), jnp.asarray([place]), noise, unit, jnp.asarray(cost), ending)


def _before_any(count=()):
    none, no, inf = jnp.zeros(count, int), jnp.zeros(count, bool), jnp.full(count, jnp.inf)
    return RoundProgress(none, inf, inf, none, no, inf, no, no)


def _after(rounds):
    """Progress after `rounds`, each a place, a cost and perhaps a ratio, from place 0."""
    progress, before, failures = _before_any(), _state(0.0, jnp.inf), []
    for one in rounds:
        after = _state(*one)
        progress, failed, _ = judged(progress, before, after)
        failures.append(bool(failed))
        before = after
    return progress, failures


@pytest.mark.parametrize(
    ("rounds", "converged"),
    [
        ([(9.0, -100.0), (18.0, -100.4)], True),  # the same cost
        ([(9.0, -100.0), (18.0, -101.0)], False),  # neither cost nor place
        ([(9.0, -100.0), (9.9, -101.0)], True),  # less than a standard deviation
        ([(9.0, -100.0), (9.9, -101.0, 1.3)], False),  # but the noise is another
        ([(9.0, -100.0), (9.9, -101.0, 1.1)], True),
    ],
)
def test_rounds_converge_where_cost_or_place_and_noise_stay(rounds, converged):
    progress, _ = _after(rounds)
    assert bool(progress.converged) is converged
    assert bool(progress.ended) is converged


def test_a_round_without_a_successful_step_is_tried_again_once():
    progress, failures = _after([(9.0, -100.0), (9.0, -90.0)])
    assert failures == [False, True]
    assert not bool(progress.ended)
    assert float(progress.last) == -100.0
    assert int(progress.worse) == 0
    progress, failures = _after([(9.0, -100.0), (9.0, -90.0), (9.0, -90.0)])
    assert failures == [False, True, False]
    assert bool(progress.converged)


def test_a_round_without_a_successful_step_counts_where_its_noise_is_likelier():
    progress, failures = _after([(9.0, -90.0), (18.0, -100.0), (18.0, -105.0)])
    assert failures == [False, False, True]
    assert float(progress.least) == -105.0
    assert not bool(progress.ended)


def test_rounds_that_cost_more_time_and_again_are_given_up():
    worse = [(9.0 * k, -100.0 + 10.0 * k) for k in range(1, 6)]
    progress, _ = _after(worse)
    assert int(progress.worse) == 4
    assert bool(progress.ended) and not bool(progress.converged)
    assert float(progress.least) == -90.0
    progress, _ = _after(worse[:-1])
    assert not bool(progress.ended)


def test_so_many_rounds_are_the_most():
    better = [(9.0 * k, -100.0 * k) for k in range(1, ROUNDS + 1)]
    assert not bool(_after(better[:-1])[0].ended)
    progress, _ = _after(better)
    assert bool(progress.ended) and not bool(progress.converged)
    assert int(progress.rounds) == ROUNDS


class Scripted(AbstractRounds):
    """Rounds of fits side by side whose places and costs are written down, shape `(rounds, d)`."""

    places: Float[np.ndarray, "rounds d"]
    costs: Float[np.ndarray, "rounds d"]
    calls: list = eqx.field(static=True)
    known: Bool[np.ndarray, " r"] = eqx.field(default_factory=lambda: np.zeros(1, bool))
    substeps: int = 1

    def round(self, state, ratios):
        number = len(self.calls)
        self.calls.append(np.asarray(state.vector)[:, 0])
        places, costs = jnp.asarray(self.places[number])[:, None], jnp.asarray(self.costs[number])
        return FitState(state.posterior, places, state.noise, state.unit, costs, state.ending)

    def started(self, state):
        return _before_any(state.vector.shape[:1])

    def judged(self, progress, before, after):
        return ManyFits(self.known, 1).judged(progress, before, after)

    def coulomb(self, state) -> Float[np.ndarray, " d"]:
        return np.ones(state.vector.shape[0])

    def where(self, chosen: Bool[Array, " d"], this, other):
        return ManyFits(self.known, 1).where(chosen, this, other)


def test_a_fit_that_has_ended_stays_while_others_go_on():
    """The first converges in its second round; what later rounds would make of it does not count."""
    places = np.array([[9.0, 9.0], [9.5, 20.0], [77.0, 30.0], [78.0, 30.5]])
    costs = np.array([[-100.0, -10.0], [-101.0, -20.0], [-999.0, -30.0], [-999.0, -31.0]])
    both = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), _state(0.0, jnp.inf))
    script = Scripted(places, costs, [])
    found = _to_the_minimum(script, both, np.ones(5))
    assert len(script.calls) == 4
    assert np.asarray(found.vector)[:, 0].tolist() == [9.5, 30.5]
    assert found.progress.least.tolist() == [-101.0, -31.0]
    assert found.progress.rounds.tolist() == [2, 4]
    assert found.progress.converged.tolist() == [True, True]
    # Its state goes into the later rounds unchanged.
    assert [call[0] for call in script.calls] == [0.0, 9.0, 9.5, 9.5]


def test_the_likeliest_round_is_kept():
    """Costs that rise again, for one of two: its second round is what was found."""
    places = np.array([[9.0, 9.0], [20.0, 20.0], [31.0, 31.0], [42.0, 42.0], [53.0, 53.0], [64.0, 64.0]])
    costs = np.array(
        [[-10.0, -1.0], [-20.0, -3.0], [-18.0, -5.0], [-16.0, -7.0], [-14.0, -9.0], [-12.0, -9.1]]
    )
    both = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), _state(0.0, jnp.inf))
    found = _to_the_minimum(Scripted(places, costs, []), both, np.ones(5))
    assert np.asarray(found.vector)[:, 0].tolist() == [20.0, 64.0]
    assert found.progress.converged.tolist() == [False, True]
