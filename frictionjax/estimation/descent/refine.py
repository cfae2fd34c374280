"""The second descent of a fit, to the minimum: innovations of a Kalman filter, with the noise that is really there.

Noise and parameters in turn (`round.py`), until neither changes; the same way for one fit and for many side by side.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, PyTree

from frictionjax.core.arrays import Numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.estimation.descent.levenberg_marquardt import equal_curvature, levenberg_marquardt
from frictionjax.estimation.descent.round import (
    NEAR_TOLERANCE,
    ROUNDS,
    SAME_COST,
    FitState,
    RoundProgress,
    judged,
    one_round,
    with_likeliest_noise,
    with_unit,
)
from frictionjax.estimation.descent.stepper import Ending
from frictionjax.estimation.evidence import Forces, Noise, Observed, Positions, filtered_in_pieces
from frictionjax.estimation.objective.posterior import Posterior

# Unmeasured force over Coulomb friction: what is allowed at first, while the parameters are still far off; then
# candidates for what is likely; then candidates over the last one found. All of one number: one compiled program.
_AT_FIRST = np.array([0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32])
_LIKELY = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0])
_AROUND = np.array([0.1, 0.3, 0.6, 1.0, 2.5, 10.0])
# A recording that needs so many times the least unmeasured force may have a wrong model.
_MUCH_MORE, _USUAL = 30.0, 1e-3  # the second: of Coulomb friction, less is negligible
# Unmeasured force over Coulomb friction, in turn, to find out.
_LOWER_LEVELS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
_MANY_STEPS = 60  # of Levenberg-Marquardt at one noise level
_SHORTER = 4.0  # times shorter units, and so sixteen times the damping, after a round whose steps all fail


class Refined(eqx.Module):
    """The minimum, of one fit, or of many side by side (arrays then have a leading axis).

    **Attributes:** `state`: the likeliest one of all rounds; `progress`.
    """

    state: FitState
    progress: RoundProgress

    @property
    def posterior(self) -> Posterior:
        """With the noise levels of the best round."""
        return self.state.posterior

    @property
    def vector(self) -> Float[Numbers, "*d q"]:
        """The free coordinates."""
        return self.state.vector

    @property
    def noise(self) -> Noise | None:
        """Of the recordings of position; None without any."""
        return self.state.noise

    @property
    def cost(self) -> float:
        """Of a single fit: minus the log-posterior with the noise, but for a constant."""
        return float(self.progress.least)

    @property
    def converged(self) -> bool:
        """Of a single fit: whether neither noise nor parameters change any more."""
        return bool(self.progress.converged)

    @property
    def ending(self) -> Ending:
        """Of a single fit: why the last steps of its best round ended."""
        return Ending.of(self.state.ending)

    @property
    def inconsistent(self) -> bool:
        """Of a single fit: whether one recording needs far more unmeasured force than another."""
        return bool(_inconsistent(self.state, np.asarray(self.posterior.drive_of(self.vector).friction.Fc)))


class AbstractRounds(PlainMethods, eqx.Module):
    """How rounds are run: those of one fit, or of many side by side.

    **Attributes:** `known`: recordings of position whose noise is given, shape `(r,)`; `substeps`: integration steps
    per sample.
    """

    known: eqx.AbstractVar[Bool[np.ndarray, " r"]]
    substeps: eqx.AbstractVar[int]

    @abstractmethod
    def round(self, state: FitState, ratios: Float[np.ndarray, "*d r k"] | None) -> FitState:
        """`one_round` from `state` with these candidate `ratios`; with all that a state may have."""

    @abstractmethod
    def started(self, state: FitState) -> RoundProgress:
        """The progress at `state`, before any round."""

    @abstractmethod
    def judged(
        self, progress: RoundProgress, before: FitState, after: FitState
    ) -> tuple[RoundProgress, Bool[Numbers, "*d"], Bool[Numbers, "*d"]]:
        """The stopping rule `judged`."""

    @abstractmethod
    def coulomb(self, state: FitState) -> Float[np.ndarray, "*d"]:
        """Coulomb friction at `state`."""

    @abstractmethod
    def where(self, chosen: Bool[Numbers, "*d"], this: PyTree, other: PyTree) -> PyTree:
        """`this` where `chosen`, else the `other`."""


class OneFit(AbstractRounds):
    """Rounds of one fit; its recordings are spread over all devices while their noise is sought.

    **Attributes:** `known`, `substeps`: as in `AbstractRounds`.
    """

    known: Bool[np.ndarray, " r"]
    substeps: int = eqx.field(static=True)

    def round(self, state: FitState, ratios: Float[np.ndarray, "r k"] | None) -> FitState:
        """`one_round` from `state` with these candidate `ratios`."""
        return one_round(state, ratios, self.known, self.substeps, filtered_in_pieces)

    def started(self, state: FitState) -> RoundProgress:
        """The progress at `state`, before any round."""
        return _started()

    def judged(
        self, progress: RoundProgress, before: FitState, after: FitState
    ) -> tuple[RoundProgress, Bool[Numbers, ""], Bool[Numbers, ""]]:
        """The stopping rule `judged`: the `progress` after the round from `before` to `after`."""
        return judged(progress, before, after)

    def coulomb(self, state: FitState) -> Float[np.ndarray, ""]:
        """Coulomb friction at `state`."""
        return np.asarray(state.posterior.drive_of(state.vector).friction.Fc)

    def where(self, chosen: Bool[Numbers, ""], this: PyTree, other: PyTree) -> PyTree:
        """`this` where `chosen`, else the `other`."""
        return this if bool(chosen) else other


class ManyFits(AbstractRounds):
    """Rounds of many fits side by side, on one device; those that have ended stay as they are.

    **Attributes:** `known`, `substeps`: as in `AbstractRounds`.
    """

    known: Bool[np.ndarray, " r"]
    substeps: int = eqx.field(static=True)

    def round(self, state: FitState, ratios: Float[np.ndarray, "d r k"] | None) -> FitState:
        """`one_round` from `state` with these candidate `ratios`."""
        if state.unit is None:
            state = _entered(state, ratios, self.known, self.substeps)
        return _rounds(state, ratios, self.known, self.substeps)

    def started(self, state: FitState) -> RoundProgress:
        """The progress at `state`, before any round."""
        return jax.tree.map(lambda leaf: np.full(state.vector.shape[0], leaf), _started())

    def judged(
        self, progress: RoundProgress, before: FitState, after: FitState
    ) -> tuple[RoundProgress, Bool[Numbers, " d"], Bool[Numbers, " d"]]:
        """The stopping rule `judged`: the `progress` after the round from `before` to `after`."""
        return _judged_each(progress, before, after)

    def coulomb(self, state: FitState) -> Float[np.ndarray, " d"]:
        """Coulomb friction at `state`."""
        return np.asarray(_coulomb_each(state))

    def where(self, chosen: Bool[Numbers, " d"], this: PyTree, other: PyTree) -> PyTree:
        """`this` where `chosen`, else the `other`."""
        return _where_each(chosen, this, other)


def _started() -> RoundProgress:
    none, no, inf = np.asarray(0), np.asarray(False), np.asarray(np.inf)
    return RoundProgress(none, inf, inf, none, no, inf, no, no)


@eqx.filter_jit
def _judged_each(
    progress: RoundProgress, before: FitState, after: FitState
) -> tuple[RoundProgress, Bool[Numbers, " d"], Bool[Numbers, " d"]]:
    return jax.vmap(judged)(progress, before, after)


@eqx.filter_jit
def _entered(
    state: FitState, ratios: Float[np.ndarray, "d r k"] | None, known: Bool[np.ndarray, " r"], substeps: int
) -> FitState:
    """The states with noise and unit, as every later round leaves them: one program for all of these."""
    return jax.vmap(lambda own, some: with_unit(with_likeliest_noise(own, some, known, substeps)))(
        state, ratios
    )


@eqx.filter_jit
def _rounds(
    state: FitState, ratios: Float[np.ndarray, "d r k"] | None, known: Bool[np.ndarray, " r"], substeps: int
) -> FitState:
    return jax.vmap(lambda own, some: one_round(own, some, known, substeps))(state, ratios)


@eqx.filter_jit
def _coulomb_each(state: FitState) -> Float[Numbers, " d"]:
    return jax.vmap(lambda own: own.posterior.drive_of(own.vector).friction.Fc)(state)


@eqx.filter_jit
def _where_each(chosen: Bool[Numbers, " d"], this: PyTree, other: PyTree) -> PyTree:
    def one(own: Bool[Numbers, ""], this: PyTree, other: PyTree) -> PyTree:
        return jax.tree.map(lambda a, b: jnp.where(own, a, b), this, other)

    return jax.vmap(one)(chosen, this, other)


def refine(rounds: AbstractRounds, state: FitState, *, near: bool = False) -> Refined:
    """Go down to the minimum.

    **Arguments:**

    - `rounds`: of one fit or of many.
    - `state`: where `settle` ended; its `Observed` evidence becomes `Positions`.
    - `near`: the parameters are near the minimum already: no round with a generous unmeasured force comes first.
    """
    first = state
    if state.posterior.has_positions and not near:
        first = rounds.round(state, _of_friction(rounds, state, _AT_FIRST))
    elif any(isinstance(one, Forces) for one in state.posterior.evidence):
        for _ in range(2):
            first = _far_down(with_likeliest_noise(first, None, rounds.known, rounds.substeps))
    found = _to_the_minimum(rounds, first, _LIKELY)
    inconsistent = _inconsistent(found.state, rounds.coulomb(found.state))
    if np.any(inconsistent):
        # Parameters that only one recording determines may be far off, with an unmeasured force in their place. With
        # less and less of it, the same in all recordings, the model must explain them; the likelihood decides.
        present = state
        for part in _LOWER_LEVELS:
            present = rounds.round(present, _of_friction(rounds, present, np.full(_LIKELY.size, part)))
        again = _to_the_minimum(rounds, present, _AROUND)
        better = again.progress.least < found.progress.least - SAME_COST
        found = rounds.where(better & inconsistent, again, found)
    return found


def at_start(posterior: Posterior, vector: Float[Numbers, "*d q"]) -> FitState:
    """A `FitState` before any round."""
    each = vector.shape[:-1]
    cost, ending = np.full(each, np.inf), np.full(each, Ending.STEPS.number)
    return FitState(posterior, vector, None, None, cost, ending)


def _to_the_minimum(rounds: AbstractRounds, state: FitState, parts: Float[np.ndarray, " k"]) -> Refined:
    """Noise and parameters in turn, until neither changes; `parts` of Coulomb friction are the first candidates."""
    best, progress = state, rounds.started(state)
    for number in range(ROUNDS):
        around = number > 0 or parts is _AROUND
        ratios = _around(state) if around else _of_friction(rounds, state, parts)
        after = rounds.round(state, ratios)
        updated, failed, better = rounds.judged(progress, state, after)
        following = rounds.where(failed, _shorter(after), after)
        if number == 0:
            state, best, progress = following, after, updated
        else:
            now = (following, rounds.where(better, after, best), updated)
            state, best, progress = rounds.where(progress.ended, (state, best, progress), now)
        if np.all(progress.ended):
            break
    return Refined(best, progress)


def _shorter(state: FitState) -> FitState:
    """The same with shorter units."""
    return eqx.tree_at(lambda s: s.unit, state, jax.tree.map(lambda unit: unit / _SHORTER, state.unit))


def _around(state: FitState) -> Float[np.ndarray, "*d r k"] | None:
    """Candidates about the likeliest ratios, where a parabola through those tried has its top, and the present ones."""
    if state.noise is None:
        return None
    noise = state.noise
    ratios = np.asarray(noise.best)[..., None] * _AROUND
    with np.errstate(invalid="ignore"):  # a filter that diverged has no finite noise, and no ratio
        present = (np.asarray(noise.push) / np.asarray(noise.position))[..., None]
    # What the parameters were found with is tried again, or the next round might cost more; where it is among the
    # others, the largest is there twice in its place, as neighbours that coincide have no parabola.
    among = np.any(np.isclose(present, ratios), axis=-1, keepdims=True)
    last = np.where(among, ratios[..., -1:], present)
    return np.sort(np.concatenate([ratios, last], axis=-1), axis=-1)


def _of_friction(
    rounds: AbstractRounds, state: FitState, parts: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "*d r k"] | None:
    """Candidate ratios for an unmeasured force of so many `parts` of Coulomb friction."""
    for one in state.posterior.evidence:
        if isinstance(one, Observed | Positions):
            level = rounds.coulomb(state)
            return level[..., None, None] / np.asarray(one.batch.noise)[..., None] * parts
    return None


def _inconsistent(state: FitState, level: Float[np.ndarray, "*d"]) -> Bool[np.ndarray, "*d"]:
    """Whether one recording needs an unmeasured force far above that of another, and above what is usual at Coulomb
    friction `level`: its part of the model may be wrong."""
    if state.noise is None:
        return np.zeros(level.shape, dtype=bool)
    push = np.asarray(state.noise.push)
    return np.asarray(np.max(push, axis=-1) > _MUCH_MORE * np.maximum(np.min(push, axis=-1), _USUAL * level))


def _far_down(state: FitState) -> FitState:
    """Many damped steps, and ranges about where they end: with the large noise of the first descent a parameter that is
    poorly determined may be at an end of its range."""
    posterior = state.posterior
    unit = equal_curvature(posterior, state.vector)
    end = levenberg_marquardt(posterior, state.vector, unit, _MANY_STEPS, tolerance=NEAR_TOLERANCE)
    vector = posterior.within(end.vector)
    own = eqx.tree_at(lambda p: p.start, posterior, vector)
    return FitState(own, vector, state.noise, None, state.cost, state.ending)
