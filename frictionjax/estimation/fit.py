"""`fit`: the free parameters of a drive from all recordings jointly."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Estimate, Progress, require_x64, silent
from frictionjax.estimation.batch import Batch, make_batch
from frictionjax.estimation.least_squares import (
    Setting,
    equal_curvature,
    errors_of,
    levenberg_marquardt,
)
from frictionjax.estimation.parameters import (
    Free,
    at_a_bound,
    base_layout,
    effect_layout,
    pack,
    unpack,
)
from frictionjax.estimation.residuals import block_power, mismatch, weights
from frictionjax.estimation.uncertainty import estimates, normal_equations, sandwich
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect
from frictionjax.recordings import Recording
from frictionjax.simulation import observer_gains

FAST_BANDWIDTH, SLOW_BANDWIDTH = 100.0, 50.0
"""Bandwidth of the observer, Hz: the fast one is short-sighted and forgiving, the slow one sees weaker effects."""

_STEPS = 3  # of Levenberg-Marquardt, between two re-weightings
_SHORTER = 2  # times that a round without any gain is tried again
_PROLONGED = (0.5, 1.0, 2.0, 4.0, 8.0)  # of the way that a round went
_GRADUATION = (0.95, 0.8, 0.5)  # quantiles of the block powers that set the knee of the likelihood, in turn
_PRIOR_LOG, _PRIOR_STRENGTH, _PRIOR_DEFLECTION = 3.0, 1e3, 0.5  # standard deviations of the weak prior


class Problem(eqx.Module):
    """Recordings and layout of one model structure, ready to be fitted.

    **Attributes:** `layout` (free parameters), `setting` (everything else).
    """

    layout: tuple[Free, ...]
    setting: Setting

    def at_bandwidth(self, bandwidth: float) -> "Problem":
        """The same problem seen by an observer of `bandwidth` Hz."""
        dt = self.setting.batch.dt
        gains = observer_gains(min(bandwidth, 0.1 / float(jnp.max(dt))), dt)
        return Problem(self.layout, eqx.tree_at(lambda s: s.gains, self.setting, gains))

    def weighted(self, power: Float[Array, "r b"], knee: float) -> "Problem":
        """The same problem with the weights of the block powers `power` and the knee `knee` (in noise levels)."""
        weight = weights(power, jnp.asarray(knee), self.setting.batch)
        return eqx.tree_at(lambda p: p.setting.weight, self, weight)

    def errors(self, *vectors: Float[Array, " q"]) -> Float[Array, "k r n"]:
        """Standardised innovations of each of `vectors`, shape `(k, r, n)`."""
        return errors_of(self.layout, list(vectors), self.setting)

    def powers(self, *vectors: Float[Array, " q"]) -> Float[Array, "k r b"]:
        """Block powers of the standardised innovations of each of `vectors`, shape `(k, r, b)`."""
        return _block_powers(self.errors(*vectors), self.setting.batch)

    def misfits(self, *vectors: Float[Array, " q"]) -> Float[np.ndarray, " k"]:
        """Robust misfit per sample of each of `vectors`: 0 when every block is at the noise floor."""
        return _misfits(self.powers(*vectors), 1.0, self.setting.batch)

    def power(self, vector: Float[Array, " q"]) -> Float[Array, "r b"]:
        """Block powers of the standardised innovations, shape `(r, b)`."""
        return self.powers(vector)[0]

    def mismatch(self, vector: Float[Array, " q"]) -> float:
        """Robust misfit per sample: 0 when every block is at the noise floor."""
        return float(self.misfits(vector)[0])

    def drive(self, vector: Float[Array, " q"]) -> Drive:
        """The `Drive` of a free vector."""
        count = len(self.layout)
        return unpack(self.layout, self.setting.drive, vector[:count], self.setting.start[:count])


@eqx.filter_jit
def _block_powers(e, batch):
    return jax.vmap(lambda lane: block_power(lane, batch))(e)


def _misfits(powers: Float[Array, "k r b"], floor: float, batch: Batch) -> Float[np.ndarray, " k"]:
    """Robust misfit per sample against `floor` (1: noise); infinite where a trajectory is not finite."""
    values = np.asarray(jax.vmap(lambda power: mismatch(power, jnp.asarray(floor), batch))(powers))
    return np.where(np.isfinite(values), values, np.inf)


def make_problem(
    drive: Drive,
    batch: Batch,
    *,
    scales: dict[str, float] | None = None,
    known_inertia: bool = False,
    bandwidth: float = FAST_BANDWIDTH,
) -> tuple[Problem, Float[Array, " q"]]:
    """The problem of fitting `drive` (base parameters and those of its effects) to `batch`, and its first vector.

    **Arguments:**

    - `drive`: structure and start.
    - `batch`: the recordings.
    - `scales`: the plant's own sizes by name, for the effects' scales.
    - `known_inertia`: keep J.
    - `bandwidth`: of the observer, Hz.
    """
    dt = float(jnp.max(batch.dt))
    layout = base_layout(drive, dt, known_inertia=known_inertia) + effect_layout(drive, scales or {})
    recordings = batch.u.shape[0]
    start = jnp.concatenate([pack(layout, drive), jnp.zeros(recordings)])
    deviation = [_PRIOR_LOG if free.parameter.transform == "log" else _PRIOR_STRENGTH for free in layout]
    prior = 1.0 / jnp.asarray(deviation + [_PRIOR_DEFLECTION] * recordings)
    gains = observer_gains(bandwidth, batch.dt)
    problem = Problem(layout, Setting(drive, batch, gains, batch.valid, start, prior))
    return problem.at_bandwidth(bandwidth), start


def extend_problem(
    present: Problem, vector: Float[Array, " q"], effect: AbstractEffect, scales: dict[str, float]
) -> tuple[Problem, Float[Array, " q"], Drive]:
    """The problem of `present` with `effect` added, at the solution `vector`.

    Ranges, prior and observer stay those of `present`, so that the same vector gives the same misfit.

    **Arguments:**

    - `present`: the fitted problem.
    - `vector`: its solution, shape `(q,)`.
    - `effect`: the effect to add, at zero strength.
    - `scales`: the plant's own sizes by name.

    **Returns:**

    The problem, its vector (shape `(q + k,)`: the k parameters of the effect stand before the starting
    deflections), and the drive.
    """
    old = len(present.layout)
    drive = present.drive(vector).with_effects(effect)
    added = effect_layout(drive, scales, first=len(drive.effects) - 1)
    start = pack(added, drive)
    deviation = [_PRIOR_LOG if free.parameter.transform == "log" else _PRIOR_STRENGTH for free in added]

    def insert(values, more):
        return jnp.concatenate([values[:old], more, values[old:]])

    setting = present.setting
    setting = Setting(
        drive,
        setting.batch,
        setting.gains,
        setting.weight,
        insert(setting.start, start),
        insert(setting.prior, 1.0 / jnp.asarray(deviation)),
    )
    return Problem(present.layout + added, setting), insert(vector, start), drive


def descend(
    problem: Problem,
    vector: Float[Array, " q"],
    *,
    graduate: bool = True,
    rounds: int = 6,
    tolerance: float = 2e-3,
) -> tuple[Float[Array, " q"], float, bool]:
    """Minimise the robust misfit by re-weighted Levenberg-Marquardt.

    The knee of the likelihood comes down from the upper quantiles of the block powers to the noise floor: with
    the knee at the floor from the start, a regime that misfits would be ignored. After every round the way that it
    went is prolonged while that helps: re-weighting makes steps that are safe, and too short.

    **Arguments:**

    - `problem`, `vector`: what to fit, and where to start.
    - `graduate`: whether to begin with wide knees.
    - `rounds`: at most this many rounds with the knee at the floor.
    - `tolerance`: a round that takes less than this part off the misfit is the last (or less than 1e-4).

    **Returns:**

    Vector, misfit, and whether the last round still gained less than the tolerance (converged).
    """
    scored = np.asarray(problem.setting.batch.block_count) > 0
    power = problem.power(vector)
    best, best_value = vector, float(_misfits(power[None], 1.0, problem.setting.batch)[0])
    unit = None
    if graduate:
        for quantile in _GRADUATION:
            level = max(float(np.quantile(np.asarray(power)[scored], quantile)), 1.0)
            if level < 1.2:
                continue  # the next knee would be the floor: that is what the rounds below do
            vector, power, _, unit = _round(problem, vector, power, level, unit)
            value = float(_misfits(power[None], 1.0, problem.setting.batch)[0])
            if value < best_value:
                best, best_value = vector, value
        power = problem.power(best)
    shorter = 0
    for _ in range(rounds):
        vector, moved, value, unit = _round(problem, best, power, 1.0, unit)
        gained = best_value - value
        if gained > 0:
            best, power, best_value = vector, moved, value
        if gained < 1e-5 and shorter < _SHORTER:
            # Not one step was good: they went too far, through an event such as a break-away. Shorter units are more
            # damping.
            shorter, unit = shorter + 1, unit / 8.0
            continue
        if gained < max(1e-4, tolerance * best_value):
            return best, best_value, True
    return best, best_value, False


def _round(problem, vector, power, level, unit):
    """Three steps with the knee at the power `level`, and what prolongs them; the best vector by the misfit at that
    knee, its block powers, that misfit, and the units of the solver."""
    setting = problem.weighted(power, level**0.5).setting
    if unit is None:
        unit = equal_curvature(problem.layout, vector, setting)
    moved, _ = levenberg_marquardt(problem.layout, vector, setting, _STEPS, unit)
    reached = [vector + factor * (moved - vector) for factor in _PROLONGED]
    powers = problem.powers(*reached)
    values = _misfits(powers, level, setting.batch)
    best = int(np.argmin(values))
    return reached[best], powers[best], float(values[best]), unit


def _positive(drive: Drive) -> None:
    """A logarithm needs a positive start; zero would leave the fit where it began."""
    values = {"J": drive.J} | {p.name: getattr(drive.friction, p.name) for p in drive.friction.parameters}
    bad = [f"{name} = {float(value):g}" for name, value in values.items() if not float(value) > 0.0]
    if bad:
        raise ValueError(
            f"`drive` starts at {', '.join(bad)}; a fit needs positive starting values, however small."
        )


class FitResult(eqx.Module):
    """A fitted drive.

    **Attributes:**

    - `drive`: the fitted `Drive`.
    - `parameters`: label -> `Estimate` in physical units, standard errors by the clustered sandwich.
    - `covariance`: of the free vector (scaled and transformed), shape `(q, q)`.
    - `mismatch`: robust misfit per sample (0: noise).
    - `success`, `message`: whether the fit converged, and why it stopped or which bound it touches.
    - `problem`, `vector`: for those who go on from here.
    """

    drive: Drive
    parameters: dict[str, Estimate] = eqx.field(static=True)
    covariance: Float[np.ndarray, "q q"]
    mismatch: float
    success: bool
    message: str = eqx.field(static=True)
    problem: Problem
    vector: Float[Array, " q"]

    @property
    def stderr(self) -> dict[str, float]:
        """Label -> standard error in physical units."""
        return {name: estimate.stderr for name, estimate in self.parameters.items()}


def finish(problem: Problem, vector: Float[Array, " q"], converged: bool, units: dict[str, str]) -> FitResult:
    """Standard errors and message for the end of a fit; `units` maps force, position, input to unit names."""
    final = problem.weighted(problem.power(vector), 1.0)
    hessian, gradients = (np.asarray(a) for a in normal_equations(final.layout, vector, final.setting))
    computable = bool(np.all(np.isfinite(hessian)) and np.all(np.isfinite(gradients)))
    covariance = (
        sandwich(hessian, gradients, np.asarray(final.setting.prior))
        if computable
        else np.full(hessian.shape, np.inf)
    )
    count = len(problem.layout)
    ends = at_a_bound(problem.layout, vector[:count], problem.setting.start[:count])
    message = "The fit converged." if converged else "The fit stopped while still improving slightly."
    if ends:
        message += f" At the end of its range: {', '.join(ends)}."
    if not computable:
        message += " The derivatives overflow at the solution: no standard errors can be given."
    return FitResult(
        drive=problem.drive(vector),
        parameters=estimates(problem.layout, vector, final.setting, covariance, units),
        covariance=covariance,
        mismatch=problem.mismatch(vector),
        success=converged and computable,
        message=message,
        problem=final,
        vector=vector,
    )


def fit(
    drive: Drive | Sequence[Drive],
    recordings: Sequence[Recording],
    *,
    encoder_step: float | None = None,
    known_inertia: bool = False,
    scales: dict[str, float] | None = None,
    units: dict[str, str] | None = None,
    progress: Progress = silent,
) -> FitResult:
    """Fit inertia, LuGre parameters and the effects of `drive` to all `recordings` jointly.

    Prediction errors of a fixed-gain observer (robust to the drift of open-loop integration), block-wise Cauchy
    likelihood, Levenberg-Marquardt in scaled coordinates with forward-mode Jacobians; observer at 100 Hz first,
    then at 50 Hz.

    **Arguments:**

    - `drive`: structure and starting values, or several starts of one structure: the best goes on.
    - `recordings`: force-driven recordings.
    - `encoder_step`: quantum of the position sensor; None: the smallest step in the data.
    - `known_inertia`: keep J at the value of `drive`.
    - `scales`: sizes of the plant by name (see `frictionjax.diagnosis`); needed when effects are present.
    - `units`: names for `force`, `position` and `input`.
    - `progress`: called as the fit goes on.

    **Returns:**

    A `FitResult`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when there is no recording, one is too short, a
    positive parameter starts at zero or below, or no start gives finite predictions.
    """
    require_x64()
    if not recordings:
        raise ValueError("`recordings` is empty; `fit` needs at least one recording.")
    starts = (drive,) if isinstance(drive, Drive) else tuple(drive)
    batch = make_batch(tuple(recordings), encoder_step=encoder_step)
    for start in starts:
        _positive(start)
    # One template for all starts: the vector carries the start, and nothing is compiled twice.
    problem, _ = make_problem(starts[0], batch, scales=scales, known_inertia=known_inertia)
    slow = problem.at_bandwidth(SLOW_BANDWIDTH)
    # A model with something missing has several minima, and which is the best is not to be seen after a few steps:
    # every start goes down with the fast observer, and the two that come lowest go on with the slow one.
    reached = []
    for index, start in enumerate(starts):
        progress(f"base fit: start {index + 1} of {len(starts)}", 0.7 * index / len(starts))
        _, vector = make_problem(start, batch, scales=scales, known_inertia=known_inertia)
        vector, value, _ = descend(problem, vector, rounds=4)
        reached.append((value, index, vector))
    progress("base fit: slow observer", 0.7)
    ends = []
    for value, index, vector in sorted(reached, key=lambda end: end[:2])[:2]:
        if np.isfinite(value):
            vector, value, converged = descend(slow, vector, graduate=False, rounds=8)
            ends.append((value, index, vector, converged))
    if not ends:
        raise ValueError(
            "No starting value gives finite predictions; check `drive`, and the units of the recordings and of "
            "the motor constant."
        )
    _, _, vector, converged = min(ends, key=lambda end: end[:2])
    progress("base fit: standard errors", 0.95)
    return finish(slow, vector, converged, units or {})
