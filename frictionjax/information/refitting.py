"""A rival model fitted to the noise-free positions of the true one, and the distance that remains."""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import InputError
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import Free
from frictionjax.information.fisher import PRIOR, sensitivities
from frictionjax.information.planned import Plan, Start, scale_of, values_of
from frictionjax.physics import Drive

_STEADY = 0.02  # converged when a further step is predicted to lower the squared distance by a smaller part
# Steps that are tried in turn, as (damping, part): the Gauss-Newton step and parts of it, for a narrow straight
# minimum, then dampings (in coordinates whose columns have unit length), for a curved one. A step that reaches
# `_ENOUGH` of its predicted decrease ends the search.
_TRIED = ((0.0, 1.0), (0.0, 0.3), (0.0, 0.1), (1e-9, 1.0), (1e-6, 1.0), (1e-3, 1.0), (0.1, 1.0), (0.0, 0.01))
_ENOUGH = 0.3


class SimulatedSession(NamedTuple):
    """All records of a session by one model: positions over the noise `x`, their derivatives `columns`, the largest |x|
    and |v| as `peaks`, and the `stroke`."""

    x: Float[np.ndarray, " m"]
    columns: Float[np.ndarray, "m p"]
    peaks: dict[str, float]
    stroke: float

    @property
    def finite(self) -> bool:
        """Whether the run and its derivatives are."""
        return bool(np.all(np.isfinite(self.x)) and np.all(np.isfinite(self.columns)))


class Rival(NamedTuple):
    """A model: its `drive`, and the `layout` of the parameters that a refit moves."""

    drive: Drive
    layout: tuple[Free, ...]

    def run(self, session: Plan, q: Float[np.ndarray, " p"] | None = None) -> SimulatedSession:
        """The records of `session` with the coordinates moved by `q`, shape `(p,)` (None: not)."""
        q = np.zeros(len(self.layout)) if q is None else q
        xs, columns, peaks, stroke = [], [], {"x": 0.0, "v": 0.0}, 0.0
        for i, u in enumerate(session.inputs):
            dt = 1.0 / real(session.rates[i])
            found = _run(self.layout, self.drive, real(u), dt, session.starts[i], session.substeps, real(q))
            x, v, change = (np.asarray(part) for part in found)
            xs.append(x / session.noises[i])
            columns.append(change.T / session.noises[i])
            # `np.maximum` keeps a NaN, which exceeds every limit.
            peaks = {
                "x": float(np.maximum(peaks["x"], np.max(np.abs(x)))),
                "v": float(np.maximum(peaks["v"], np.max(np.abs(v)))),
            }
            stroke = max(stroke, float(np.ptp(x)))
        return SimulatedSession(np.concatenate(xs), np.concatenate(columns), peaks, stroke)


@eqx.filter_jit
def _run(
    layout: tuple[Free, ...],
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    start: Start,
    substeps: int,
    q: Float[Array, " p"],
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, "p n"]]:
    return sensitivities(layout, drive, u, dt, start, substeps, q)


class Distance(NamedTuple):
    """Distance of a rival from the truth, in standard deviations of the noise: `refitted`, and in `one_step` by the
    linear projection; and whether the refit `converged`."""

    refitted: float
    one_step: float
    converged: bool


def distance(
    rival: Rival, run: SimulatedSession, truth: SimulatedSession, session: Plan, place: int, steps: int
) -> Distance:
    """Distance of the `rival` from the `truth` after a refit of at most `steps` steps.

    **Arguments:**

    - `rival`: the model; its effect number `place`, if it has one, is its own.
    - `run`: the rival's own, before the refit.
    - `truth`: the run that it is fitted to, of the same `session`.

    The refit starts with the strengths of that effect as they are or at zero, whichever fits better; with the other if
    that does not converge.
    """
    values = values_of(rival.layout, rival.drive)
    scale = scale_of(rival.layout, rival.drive, truth.stroke, 1.0 / max(session.rates))
    strengths = rival.drive.effects[place].strengths if place < len(rival.drive.effects) else ()
    own = {f"effects.{place}.{one.name}" for one in strengths}
    without = np.where([one.path in own for one in rival.layout], -values, 0.0)
    refit = _Refit(rival, truth, session, 1.0 / (PRIOR * scale), values)
    starts = [(np.zeros(len(values)), run)]
    if np.any(without):
        starts.append((without, rival.run(session, without)))
    starts = sorted((one for one in starts if one[1].finite), key=lambda one: refit.misfit(*one))
    one_step = float(np.sqrt(refit.predicted(*starts[0])))
    if steps == 0:
        return Distance(one_step, one_step, False)
    left, settled = refit.descend(*starts[0], steps)
    if not settled and len(starts) > 1:
        left, settled = min((left, settled), refit.descend(*starts[1], steps))
    return Distance(float(np.sqrt(left)), one_step, settled)


class _Refit:
    """Least squares with a weak prior, by damped Gauss-Newton steps."""

    def __init__(
        self,
        rival: Rival,
        truth: SimulatedSession,
        session: Plan,
        weak: Float[np.ndarray, " p"],
        values: Float[np.ndarray, " p"],
    ) -> None:
        self.rival, self.truth, self.session, self.weak = rival, truth, session, weak
        # A strength stays in its admissible range; a logarithm has no range.
        ends = [
            (-np.inf, np.inf)
            if one.parameter.transform == "log"
            else (one.parameter.lower - v, one.parameter.upper - v)
            for one, v in zip(rival.layout, values, strict=True)
        ]
        self.low, self.high = np.asarray(ends).T

    def left(self, run: SimulatedSession) -> float:
        """Squared distance of the positions from those of the truth."""
        return float(np.sum((self.truth.x - run.x) ** 2))

    def misfit(self, q: Float[np.ndarray, " p"], run: SimulatedSession) -> float:
        """The same with the prior."""
        return self.left(run) + float(np.sum((self.weak * q) ** 2))

    def steps(
        self, q: Float[np.ndarray, " p"], run: SimulatedSession
    ) -> Iterator[tuple[Float[np.ndarray, " p"], float]]:
        """The steps to be tried, each with its predicted misfit; the first is the Gauss-Newton step."""
        rows = np.concatenate([run.columns, np.diag(self.weak)])
        size, missing = np.linalg.norm(rows, axis=0), np.concatenate([self.truth.x - run.x, -self.weak * q])
        left, values, right = np.linalg.svd(rows / size, full_matrices=False)
        along = left.T @ missing
        for damping, part in _TRIED:
            step = part * (right.T @ (values / (values**2 + damping) * along)) / size
            yield step, float(np.sum((missing - rows @ step) ** 2))

    def predicted(self, q: Float[np.ndarray, " p"], run: SimulatedSession) -> float:
        """Predicted squared distance and prior after a full Gauss-Newton step."""
        return next(self.steps(q, run))[1]

    def descend(self, q: Float[np.ndarray, " p"], run: SimulatedSession, steps: int) -> tuple[float, bool]:
        """Squared distance at the end, and whether the refit has converged."""
        for _ in range(steps):
            if self.settled(q, run):
                break
            now, best = self.misfit(q, run), (q, run)
            for step, predicted in self.steps(q, run):
                there = np.clip(q + step, self.low, self.high)
                then = self.rival.run(self.session, there)
                if then.finite and self.misfit(there, then) < self.misfit(*best):
                    best = (there, then)
                if now - self.misfit(*best) >= _ENOUGH * (now - predicted):
                    break
            if best[1] is run:
                break
            q, run = best
        return self.left(run), self.settled(q, run)

    def settled(self, q: Float[np.ndarray, " p"], run: SimulatedSession) -> bool:
        """Whether the predicted decrease of a further step is small; distances well below 1 cannot be distinguished."""
        now = self.misfit(q, run)
        return now - self.predicted(q, run) < max(_STEADY * now, _STEADY)


def finite_or_error(run: SimulatedSession, session: Plan) -> None:
    """An error when the `run` of a `session` overflows."""
    if not run.finite:
        raise InputError(
            f"the run of {' or '.join(session.labels)} overflows",
            place="`candidates`",
            cure="Raise `sample_rate` or `substeps`, or check the units of `drive` and the input.",
        )
