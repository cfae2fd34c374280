"""Search for a load behind a gap, whose first sign is that a machine is lighter in stick than in sliding.

Shaken in stick the motor moves within the gap, and its load hangs free: the inertia is that of the motor alone. In
sliding it takes the load along. What the two differ by is the load, and is known before anything is searched.

When the load touches in shaking is chaotic, and nobody sees it: there even the true model errs, and a gap that is too
wide to touch errs less. In sliding the motor catches the load after each reversal, and what went before is forgotten;
when it does, the gap and the load's own viscous friction decide, each to a few per cent, and a few per cent off they
cost as much as far off. So both are sought on a grid, by the recordings that slide; all else descends, by the blocks in
which the load is where it is whatever shakes the machine (`told`).

Each model keeps the viscous friction of the whole, sigma2 + drag ratio J, which any sliding shows.
"""

import itertools
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.evidence.noise_floor import predictable
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive

SHAKING = 5e-4
"""Unmeasured force over Fc under which the motion of a machine must stay what it is, for its gap to be told by it."""
_LIGHTER = 0.05  # part of the inertia that stick must lack for a load to be believed in
_HEAVIEST = 0.9  # part of the inertia that may be the load's
# Over the bristle's break-away deflection: each a sixth wider than the last.
_GAPS = np.geomspace(0.3, 20.0, 30)
_SHARES = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)  # of the viscous friction that is the load's
_FREQUENCY, _DAMPING = 200.0, 0.25  # of the contact, Hz and 1: what the machine does hardly depends on them
_RATIOS = (0.2, 0.35, 0.5)  # where stick does not tell
_TURNS = ((10.0, 0.5), (10.0, 0.25), (1.0, 0.1))  # knee, and half-width of the grid around the best so far
_FINER = 15, 5  # gaps and shares of these grids
_DESCENT = 8  # steps of a descent between two grids
_FAR_OFF = 10.0  # deflections in a block (50 ms): a machine that gets so far slides
_SLIDES = 0.1  # of the blocks of a recording
_PROMISING = 0.1  # of what the rigid machine costs above the noise in sliding, that the first turn must gain
_LEAST_LEFT = 0.05  # of the viscous friction that stays with the motor


def load_ratio(joint: Posterior, vector: Float[Array, " q"], stick_inertia: float | None) -> float | None:
    """Part of the inertia that stick lacks, of the model `vector`: told by the inertia at which its fit began, where it
    ended, and the `stick_inertia` that noise in stick showed, where there was any; None where they agree."""
    seen = [float(joint.drive_of(joint.start).J), float(joint.drive_of(vector).J)]
    seen += [stick_inertia] if stick_inertia is not None else []
    ratio = 1.0 - min(seen) / max(seen)
    return ratio if _LIGHTER < ratio < _HEAVIEST else None


def told(joint: Posterior, vector: Float[Array, " q"]) -> Posterior:
    """`joint` without the blocks in which the model `vector` parts from itself under a small unmeasured force: no fit
    sees what is chaotic."""
    whole = eqx.tree_at(lambda j: j.weights, joint, (jnp.ones_like(joint.weights[0]),))
    return predictable(whole, vector, SHAKING, draws=1)[0]


def searched(
    joint: Posterior, vector: Float[Array, " q"], deflection: float, ratio: float | None
) -> Float[Array, " q"] | None:
    """A model with a load behind a gap that predicts sliding best.

    **Arguments:**

    - `joint`: a model whose last effect is a second inertia behind a gap.
    - `vector`: the rigid machine, shape `(q,)`.
    - `deflection`: of the bristle at break-away, position units.
    - `ratio`: of the load to the whole (`load_ratio`); None: several are tried.

    **Returns:** a vector of shape `(q,)`; None where no recording slides, or where no gap is clearly better there than
    none.
    """
    rows = _sliding(joint.batch, deflection) * np.asarray(joint.fitted[0])
    if not np.any(rows):
        return None
    grid = [
        model
        for own in (_RATIOS if ratio is None else (ratio,))
        for model in _around(_hanging(joint, vector, own), joint, _GAPS * deflection, _SHARES)
    ]
    found, _ = _best(joint, grid, rows, _TURNS[0][0])
    for turn, (knee, width) in enumerate(_TURNS):
        found = descend(told(joint, found), found, steps=_DESCENT, tolerance=0.01).vector
        side = joint.drive_of(found).load_side
        assert side is not None
        if not float(side.ratio) > 0.0:
            return None
        gaps = 2.0 * float(side.half_gap) * np.exp(np.linspace(-width, width, _FINER[0]))
        shares = _share(joint.drive_of(found)) + width * np.linspace(-0.5, 0.5, _FINER[1])
        finer = _around(found, joint, gaps, shares[(shares > 0.0) & (shares < 1.0)])
        found, cost = _best(joint, [found, *finer], rows, knee)
        if turn == 0:
            rigid = misfit_of(joint.powers([vector])[0], rows, joint.batch, knee)
            at_noise = 0.5 * np.log((1.0 + knee) / (2.0 * knee))
            if cost > rigid - _PROMISING * (rigid - at_noise):
                return None
    return found


def heavier(joint: Posterior, vector: Float[Array, " q"], times: float | Array) -> Float[Array, " q"]:
    """`vector` with the inertia `times` as large, where it is free; stiffness and damping stay what they were."""
    places, more = {free.path: place for place, free in enumerate(joint.layout)}, float(np.log(times))
    if "J" not in places:
        return vector
    shifts = {"J": more, "friction.sigma0": -more, "friction.sigma1": -0.5 * more}
    new = np.array(vector)
    for path, shift in shifts.items():
        new[places[path]] += shift
    return jnp.asarray(new)


def _sliding(batch: AbstractBatch, deflection: float) -> Float[np.ndarray, " r"]:
    """1 for the recordings that slide for a tenth of their time, else 0."""
    ends = np.asarray(batch.x)[:, :: batch.block]
    travelled = np.abs(np.diff(ends, axis=1, append=ends[:, -1:]))
    scored = np.asarray(batch.block_count) > 0
    far = np.sum((travelled > _FAR_OFF * deflection) & scored, axis=1)
    return np.where(far > _SLIDES * np.sum(scored, axis=1), 1.0, 0.0)


def _hanging(joint: Posterior, vector: Float[Array, " q"], ratio: float) -> Float[Array, " q"]:
    """`vector` with a load of this `ratio`, and with the inertia of sliding: stiffness and damping stay what they
    were."""
    place = len(joint.drive.effects) - 1
    new = _with(joint, vector, {"ratio": ratio, "frequency": _FREQUENCY, "damping": _DAMPING}, place)
    # The fit of a rigid machine ends as heavy as it was in sliding, where it began, or as light as in stick.
    now, begun = (float(joint.drive_of(one).J) for one in (vector, joint.start))
    return heavier(joint, new, max(now, begun) / now)


def _around(
    vector: Float[Array, " q"],
    joint: Posterior,
    gaps: Float[np.ndarray, " g"],
    shares: Sequence[float] | Float[np.ndarray, " s"],
) -> list[Float[Array, " q"]]:
    """`vector` at each of the `gaps` (position units), with each of these `shares` of the viscous friction the
    load's."""
    drive, place = joint.drive_of(vector), len(joint.drive.effects) - 1
    viscous, inertia = _viscous(drive), float(drive.load_side.ratio * drive.J)  # type: ignore[union-attr]
    models = []
    for gap, share in itertools.product(gaps, shares):
        new = _with(joint, vector, {"gap": gap, "drag": share * viscous / inertia}, place)
        left = max(1.0 - share, _LEAST_LEFT) * viscous
        sigma2 = next(i for i, free in enumerate(joint.layout) if free.path == "friction.sigma2")
        models.append(new.at[sigma2].add(np.log(left / float(drive.friction.sigma2))))
    return models


def _with(
    joint: Posterior, vector: Float[Array, " q"], values: dict[str, float], place: int
) -> Float[Array, " q"]:
    """`vector` with these values of the effect at the `place`."""
    new = np.array(vector)
    for index, free in enumerate(joint.layout):
        name = free.parameter.name
        if free.path == f"effects.{place}.{name}" and name in values:
            log = free.parameter.transform == "log"
            new[index] = np.log(values[name]) if log else values[name] / float(free.scale)
    return jnp.asarray(new)


def _best(
    joint: Posterior, models: list[Float[Array, " q"]], rows: Float[np.ndarray, " r"], knee: float
) -> tuple[Float[Array, " q"], float]:
    """The best of the `models` by the recordings `rows` with the Cauchy knee at the power `knee`, and its cost."""
    costs = [misfit_of(power, rows, joint.batch, knee) for power in joint.powers(models)]
    best = int(np.argmin(costs))
    return models[best], costs[best]


def _viscous(drive: Drive) -> float:
    """Viscous friction of the motor and, where it has one of its own, of the load."""
    return float(drive.friction.sigma2) + _of_the_load(drive)


def _share(drive: Drive) -> float:
    """Part of the viscous friction that is the load's."""
    return _of_the_load(drive) / _viscous(drive)


def _of_the_load(drive: Drive) -> float:
    side = drive.load_side
    return 0.0 if side is None else float(side.drag * side.ratio * drive.J)
