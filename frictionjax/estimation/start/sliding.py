"""Inertia, Coulomb and viscous friction from sliding motion, by inverse dynamics and least squares."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Float

from frictionjax.recordings import Recording

# s: smoothing of position and input alike, so that both are filtered alike. The longest serves servo moves;
# the shorter ones are for motion that is all vibration.
WINDOWS = (0.025, 0.008, 0.003)


# Of the sliding samples, in each direction: less cannot separate friction from a constant force.
_LEAST_SHARE = 0.05
# Times the median stroke: so much longer is the longest one where a machine shakes and also slides.
_MUCH_LONGER = 20.0
_SHORT = 0.03  # of the longest stroke: a shorter one is vibration


class SlidingMotion(eqx.Module):
    """Smoothed motion of one recording, shape `(n,)`: `x`, `v`, `a` and the motor force `force`."""

    x: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " n"]
    a: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]


class SlidingFit(eqx.Module):
    """Least-squares fit of force = J a + Fc sgn v + sigma2 v + offset (+ further columns) over sliding samples.

    **Attributes:** the four coefficients, those of the columns `beside` them, `top_speed`, `used` (number of samples),
    `spread` (robust standard deviation of what is left, force units), `unexplained` (that over the spread of the force
    itself), `credible`.
    """

    J: float = eqx.field(static=True)
    Fc: float = eqx.field(static=True)
    sigma2: float = eqx.field(static=True)
    offset: float = eqx.field(static=True)
    top_speed: float = eqx.field(static=True)
    used: int = eqx.field(static=True)
    spread: float = eqx.field(static=True)
    unexplained: float = eqx.field(static=True)
    beside: tuple[float, ...] = eqx.field(static=True, default=())

    @property
    def credible(self) -> bool:
        """True when inertia and Coulomb friction stand out of what is left unexplained."""
        return self.explains and self.J > 0.0 and self.Fc > 0.02 * self.spread

    @property
    def explains(self) -> bool:
        """True when little of the force is left unexplained, by whatever part."""
        return self.unexplained < 0.5 and self.used >= 200


def smooth_motion(recording: Recording, motor_constant: float, seconds: float = WINDOWS[0]) -> SlidingMotion:
    """Local cubic fits over `seconds` to position and motor force (`motor_constant` times u) of `recording`."""
    window = max(round(seconds * recording.sample_rate) | 1, 7)
    window = min(window, (recording.x.size - 1) | 1)
    dt = 1.0 / recording.sample_rate
    # The input is held between samples: on the average it acts half a sample later than its time stamp.
    held = 0.5 * (recording.u + np.concatenate([recording.u[:1], recording.u[:-1]]))
    x, v, a = (
        np.asarray(scipy.signal.savgol_filter(recording.x, window, 3, deriv=d, delta=dt)) for d in (0, 1, 2)
    )
    return SlidingMotion(x, v, a, motor_constant * np.asarray(scipy.signal.savgol_filter(held, window, 3)))


def _strokes(motion: SlidingMotion) -> Float[np.ndarray, " n"]:
    """For each sample the distance between the reversals before and after it."""
    ends = np.flatnonzero(np.diff(np.sign(motion.v)) != 0.0) + 1
    edges = np.concatenate([[0], ends, [motion.x.size]])
    marks = motion.x[np.minimum(edges, motion.x.size - 1)]
    return np.repeat(np.abs(np.diff(marks)), np.diff(edges))


def fit_sliding(
    motions: tuple[SlidingMotion, ...],
    *,
    inertia: float | None = None,
    beside: Sequence[Float[np.ndarray, "_ k"]] | None = None,
    offset: bool = True,
) -> SlidingFit:
    """Robust least squares (Huber weights) over all samples faster than 5 % of the top speed, in strokes (from one
    reversal to the next) that are not short: vibration in stick may be fast, too.

    **Arguments:**

    - `motions`: smoothed recordings.
    - `inertia`: known inertia, or None.
    - `beside`: for each motion k forces that may take a part, shape `(n, k)`: the position, as of a spring.
    - `offset`: let a constant force take a part, and with it what is constant in those `beside`.
    """
    top_speed = max(float(np.quantile(np.abs(m.v), 0.999)) for m in motions)
    strokes = [_strokes(m) for m in motions]
    longest = max(float(np.max(stroke)) for stroke in strokes)
    # Where all strokes are of similar length vibration cannot be separated from moves, and nothing is left out.
    separable = longest > _MUCH_LONGER * float(np.median(np.concatenate(strokes)))
    shortest = _SHORT * longest if separable else -1.0
    slides = [
        (np.abs(m.v) > 0.05 * top_speed) & (stroke > shortest)
        for m, stroke in zip(motions, strokes, strict=True)
    ]
    v, a, force = (
        np.concatenate([getattr(m, name)[own] for m, own in zip(motions, slides, strict=True)])
        for name in ("v", "a", "force")
    )
    # Motion in one direction cannot separate Coulomb friction from a constant force.
    both = offset and min(np.mean(v > 0.0), np.mean(v < 0.0)) > _LEAST_SHARE
    columns = [np.sign(v), v, np.ones_like(v) if both else np.zeros_like(v)]
    target = force
    if inertia is None:
        columns.insert(0, a)
    else:
        target = force - inertia * a
    more = [] if beside is None else [own[chosen] for own, chosen in zip(beside, slides, strict=True)]
    added = np.concatenate(more) if more else np.zeros((v.size, 0))
    own_part = added - np.mean(added, axis=0) if offset else added
    design = np.concatenate([own_part, np.stack(columns, axis=1)], axis=1)
    # A negative inertia or friction is no usable start: those coefficients are bounded at zero.
    lower = np.zeros(design.shape[1])
    lower[-1] = -np.inf
    lower[: added.shape[1]] = -np.inf
    size = np.sqrt(np.mean(design**2, axis=0)) + 1e-300
    weight = np.ones_like(v)
    solution, spread = np.zeros(design.shape[1]), np.inf
    for _ in range(10):
        root = np.sqrt(weight)[:, None]
        scaled = scipy.optimize.lsq_linear(
            design / size * root, target * root[:, 0], bounds=(lower, np.inf), method="bvls"
        )
        solution = scaled.x / size
        left = np.abs(target - design @ solution)
        spread = 1.4826 * float(np.median(left))
        weight = np.minimum(1.0, 2.0 * spread / np.maximum(left, 1e-300))
    J = inertia if inertia is not None else float(solution[-4])
    Fc, sigma2, constant = (float(s) for s in solution[-3:])
    unexplained = spread / max(1.4826 * float(np.median(np.abs(force))), 1e-300)
    taken = tuple(float(s) for s in solution[: added.shape[1]])
    return SlidingFit(J, Fc, sigma2, constant, top_speed, int(v.size), spread, unexplained, taken)
