"""Rigid-body dynamics and friction of an arm by weighted least squares on its logs.

The torques are linear in the base parameters b, and in the friction of each joint: a free function f of the velocity,
of its own in either direction, and a level that varies along the stroke:

    tau = Y(q, q', q'') b + f(q') + sgn q' (c1 q + c2 q^2)

Without friction of its own the fit would explain friction by inertia and gravity. Both sides pass the same filter. It
spreads the step of friction at a reversal over most of a period of its cut-off, in which no function of the velocity
holds, as presliding does not follow one either: there the equation of that joint is left out.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.arm.base_parameters import BaseParameters
from frictionjax.arm.log import ArmLog
from frictionjax.arm.rigid_body import RigidBody
from frictionjax.arm.smoothing import JointMotion, cut_off, smooth_motion, smoothed, wider

_SPEEDS = np.array([0.0, 0.05, 0.1, 0.2, 0.5, 1.0])
"""Of the top speed: between these friction runs on straight lines, closer where a Stribeck effect bends it."""
_POWERS = (1, 2)  # of the position, with which the level of friction may vary
_SPREAD = (
    0.75  # periods of the cut-off before and after a reversal: with half, friction enters armatures by 5 %
)
_OVERSAMPLED = 4.0  # samples a period of the cut-off that are kept after the filter
_BLOCKS = 20  # into which each log is cut for standard errors: what a model leaves is alike for some time
_PASSES = 3  # weights of the joints settle in two


class Balance(eqx.Module):
    """What the balance of torques found.

    **Attributes:**

    - `base`: base parameters, shape `(b,)`; `stderr`: their standard errors.
    - `determined`: whether the logs determine each of them; those that they do not are as the model has them.
    - `equations`: number of equations of each joint, shape `(j,)`.
    """

    base: Float[np.ndarray, " b"]
    stderr: Float[np.ndarray, " b"]
    determined: Bool[np.ndarray, " b"]
    equations: Int[np.ndarray, " j"]


class _Reach(eqx.Module):
    """How far the joints go: top speeds `top`, and positions from `low` to `high`, shape `(j,)`."""

    top: Float[np.ndarray, " j"]
    low: Float[np.ndarray, " j"]
    high: Float[np.ndarray, " j"]

    def friction(
        self, joint: int, x: Float[np.ndarray, " n"], v: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n k"]:
        """The columns of the friction of a `joint` at positions `x` and velocities `v`: a function of the velocity,
        linear between some speeds and of its own in either direction, and a level that varies along the stroke."""
        speed = np.abs(v) / (self.top[joint] or 1.0)
        hats = np.stack([np.interp(speed, _SPEEDS, row) for row in np.eye(_SPEEDS.size)], axis=1)
        centre, half = (self.high[joint] + self.low[joint]) / 2, (self.high[joint] - self.low[joint]) / 2
        along = [np.sign(v) * ((x - centre) / (half or 1.0)) ** power for power in _POWERS]
        return np.concatenate(
            [hats * (v > 0.0)[:, None], hats * (v <= 0.0)[:, None], np.stack(along, axis=1)], axis=1
        )


class _Equations(eqx.Module):
    """Filtered equations of a log: columns of the `base` parameters and of each joint's `friction`, the torque that the
    model as given is `lacking`, whether each is `used`, and the `block` of time of each sample."""

    base: Float[np.ndarray, "m j b"]
    friction: Float[np.ndarray, "m j f"]
    lacking: Float[np.ndarray, "m j"]
    used: Bool[np.ndarray, "m j"]
    block: Int[np.ndarray, " m"]


def motion_of(log: ArmLog) -> JointMotion:
    """The motion behind the positions of a `log`."""
    return smooth_motion(log.q, log.sample_rate, np.array([cut_off(x, log.sample_rate) for x in log.q.T]))


def balance(
    arm: RigidBody, base: BaseParameters, logs: Sequence[ArmLog], motions: Sequence[JointMotion]
) -> Balance:
    """Base parameters of an `arm`, with the friction of its joints free beside them.

    **Arguments:**

    - `arm`, `base`: the model and its base parameters.
    - `logs`, `motions`: those to fit, and the motion behind each.
    """
    given = base.of(arm.values)
    reach = _Reach(
        np.max([np.max(np.abs(motion.qd), axis=0) for motion in motions], axis=0),
        np.min([np.min(motion.q, axis=0) for motion in motions], axis=0),
        np.max([np.max(motion.q, axis=0) for motion in motions], axis=0),
    )
    parts = [_equations(arm, base, given, reach, *pair) for pair in zip(logs, motions, strict=True)]
    columns, friction, lacking, used = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("base", "friction", "lacking", "used")
    )
    blocks = np.concatenate([part.block + _BLOCKS * k for k, part in enumerate(parts)])
    columns, lacking = columns * used[:, :, None], lacking * used
    for k in range(used.shape[1]):  # what friction can take is taken first
        span = _orthonormal(friction[:, k] * used[:, k, None])
        columns[:, k] -= span @ (span.T @ columns[:, k])
        lacking[:, k] -= span @ (span.T @ lacking[:, k])
    count = np.maximum(np.sum(used, axis=0), 1)
    left, change, inverse, known = lacking, np.zeros(given.size), np.zeros((0, 0)), np.ones(given.size, bool)
    weights = np.ones(count.size)
    for _ in range(_PASSES):
        weights = 1.0 / np.maximum(np.sqrt(np.sum(left**2, axis=0) / count), np.finfo(float).tiny)
        change, inverse, known = _least_squares(columns * weights[:, None], lacking * weights)
        left = lacking - columns @ change
    stderr = _errors(columns * weights[:, None], left * weights, blocks, inverse)
    return Balance(given + change, stderr, known, np.sum(used, axis=0))


def _orthonormal(columns: Float[np.ndarray, "m f"]) -> Float[np.ndarray, "m r"]:
    """A basis of what `columns` span."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return u[:, s > s[0] * max(columns.shape) * np.finfo(float).eps]


def _least_squares(
    columns: Float[np.ndarray, "m j b"], target: Float[np.ndarray, "m j"]
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b b"], Bool[np.ndarray, " b"]]:
    """The shortest solution, in columns of unit size, the inverse of its normal matrix, and which of its numbers are
    determined."""
    flat = columns.reshape(-1, columns.shape[2])
    size = np.linalg.norm(flat, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    u, s, vt = np.linalg.svd(flat / size, full_matrices=False)
    rank = int(np.count_nonzero(s > s[0] * max(flat.shape) * np.finfo(float).eps))
    u, s, vt = u[:, :rank], s[:rank], vt[:rank]
    solution = (vt.T @ ((u.T @ target.ravel()) / s)) / size
    inverse = (vt.T / s**2) @ vt / np.outer(size, size)
    # A number outside of what the equations reach is not determined, or only together with others.
    known = np.sum(vt**2, axis=0) > 1.0 - np.sqrt(np.finfo(float).eps)
    return solution, inverse, known


def _equations(
    arm: RigidBody,
    base: BaseParameters,
    given: Float[np.ndarray, " b"],
    reach: _Reach,
    log: ArmLog,
    motion: JointMotion,
) -> _Equations:
    """The equations of a `log`."""
    n, joints = log.q.shape
    columns = base.regressor(arm, motion.q, motion.qd, motion.qdd)
    friction = np.stack([reach.friction(k, motion.q[:, k], motion.qd[:, k]) for k in range(joints)], axis=1)
    lacking = log.tau - columns @ given
    cut = wider(float(np.max(motion.cuts)), log.sample_rate)
    every = max(int(log.sample_rate / (_OVERSAMPLED * cut)), 1)
    kept = slice(motion.edge, n - motion.edge, every)
    used = _away_from_reversals(motion.qd, round(_SPREAD * log.sample_rate / cut))[kept]
    columns, friction, lacking = (
        smoothed(one, log.sample_rate, cut)[kept] for one in (columns, friction, lacking)
    )
    block = np.arange(lacking.shape[0]) * _BLOCKS // lacking.shape[0]
    return _Equations(columns, friction, lacking, used, block)


def _away_from_reversals(qd: Float[np.ndarray, "n j"], reach: int) -> Bool[np.ndarray, "n j"]:
    """Whether no joint of its column reverses within `reach` samples."""
    turns = np.zeros(qd.shape)
    turns[1:] = np.sign(qd[1:]) != np.sign(qd[:-1])
    passed = np.concatenate([np.zeros((1, qd.shape[1])), np.cumsum(turns, axis=0)])
    places = np.arange(qd.shape[0])
    after, before = np.minimum(places + reach + 1, qd.shape[0]), np.maximum(places - reach, 0)
    return passed[after] == passed[before]


def _errors(
    columns: Float[np.ndarray, "m j b"],
    left: Float[np.ndarray, "m j"],
    blocks: Int[np.ndarray, " m"],
    inverse: Float[np.ndarray, "b b"],
) -> Float[np.ndarray, " b"]:
    """Standard errors that hold where what is `left` is alike within `blocks`: the sandwich of clustered errors."""
    score = np.einsum("mjb,mj->mb", columns, left)
    own = np.unique(blocks)
    sums = np.stack([np.sum(score[blocks == block], axis=0) for block in own])
    covariance = inverse @ (sums.T @ sums) @ inverse * own.size / max(own.size - 1, 1)
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))
