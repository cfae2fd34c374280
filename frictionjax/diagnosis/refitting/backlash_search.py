"""Search for a load behind a gap, whose first sign is that a machine is lighter in stick than in sliding.

Under noise in stick the motor moves within the gap, and the load does not follow: the inertia is that of the motor
alone. In sliding it takes the load along. What the two differ by is the load, known before anything is searched.

When the load touches in stick is chaotic: there even the true model errs, and a gap too wide to touch errs less. In
sliding the motor catches the load after each reversal, and what went before is forgotten; when it does, the gap and the
load's own viscous friction decide, each to a few per cent, and a few per cent off they cost as much as far off. So both
are searched on a grid, by the recordings that slide; all else descends, by the blocks in which the load is where it is
whatever disturbs the machine (`without_chaos`).

Each model keeps the viscous friction of the whole, sigma2 + drag ratio J, which any sliding shows.
"""

import itertools
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.effort import BacklashEffort, Effort
from frictionjax.diagnosis.evidence.noise_floor import gap_force, predictable
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.misfit import block_misfits, misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import changed
from frictionjax.physics import Drive

_FREQUENCY, _DAMPING = 200.0, 0.25  # of the contact, Hz and 1: what the machine does hardly depends on them
_LEAST_LEFT = 0.05  # of the viscous friction that stays with the motor


def load_ratio(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    stick_inertia: float | None,
    *,
    effort: Effort = Effort(),
) -> float | None:
    """Part of the inertia that stick lacks, of the model `vector`: from the inertia at which its fit started, where it
    ended, and the `stick_inertia` that noise in stick showed, where there was any; None where they agree."""
    inertias = [float(posterior.drive_of(posterior.start).J), float(posterior.drive_of(vector).J)]
    inertias += [stick_inertia] if stick_inertia is not None else []
    ratio = 1.0 - min(inertias) / max(inertias)
    return ratio if effort.backlash.lightest < ratio < effort.backlash.heaviest else None


def without_chaos(posterior: Posterior, vector: Float[Numbers, " q"], *, rule: Rule = Rule()) -> Posterior:
    """`posterior` without the blocks in which two runs of the model `vector` part under a small unmeasured force:
    what is chaotic is not fitted."""
    whole = eqx.tree_at(lambda j: j.weights, posterior, (np.ones_like(posterior.weights[0]),))
    return predictable(whole, vector, gap_force(0.0, rule), draws=1, rule=rule)[0]


def search_backlash(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    deflection: float,
    ratio: float | None,
    *,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> Float[Numbers, " q"] | None:
    """The model with a load behind a gap that predicts sliding best.

    **Arguments:**

    - `posterior`: a model whose last effect is a second inertia behind a gap.
    - `vector`: the rigid machine, shape `(q,)`.
    - `deflection`: of the bristle at break-away, position units.
    - `ratio`: of the load to the whole (`load_ratio`); None: several are tried.
    - `rule`: which blocks are unpredictable; `effort`: where it is searched.

    **Returns:** a vector of shape `(q,)`; None where no recording slides, or where no gap is clearly better there than
    none.
    """
    own = effort.backlash
    rows = _sliding(posterior.batch, deflection, own) * np.asarray(posterior.fitted[0])
    if not np.any(rows):
        return None
    gaps = np.geomspace(own.narrowest, own.widest, own.gaps) * deflection
    grid = [
        model
        for one in (own.ratios if ratio is None else (ratio,))
        for model in _around(_free_load(posterior, vector, one), posterior, gaps, own.shares)
    ]
    found, _ = _best(posterior, grid, rows, own.turns[0][0])
    for turn, (scale, width) in enumerate(own.turns):
        calm = without_chaos(posterior, found, rule=rule)
        found = descend(calm, found, steps=own.steps, tolerance=own.tolerance).vector
        side = posterior.drive_of(found).load_side
        assert side is not None
        if not float(side.ratio) > 0.0:
            return None
        gaps = 2.0 * float(side.half_gap) * np.exp(np.linspace(-width, width, own.finer_gaps))
        shares = _share(posterior.drive_of(found)) + width * np.linspace(-0.5, 0.5, own.finer_shares)
        finer = _around(found, posterior, gaps, shares[(shares > 0.0) & (shares < 1.0)])
        found, cost = _best(posterior, [found, *finer], rows, scale)
        if turn == 0:
            rigid = misfit_of(posterior.powers([vector])[0], rows, posterior.batch, scale)
            at_noise = float(block_misfits(np.ones(1), 1.0, scale)[0])
            if cost > rigid - own.least_gain * (rigid - at_noise):
                return None
    return found


def heavier(posterior: Posterior, vector: Float[Numbers, " q"], times: float | Array) -> Float[Numbers, " q"]:
    """`vector` with the inertia `times` as large, where it is free; stiffness and damping stay what they were."""
    places, more = {free.path: place for place, free in enumerate(posterior.layout)}, float(np.log(times))
    if "J" not in places:
        return vector
    shifts = {"J": more, "friction.sigma0": -more, "friction.sigma1": -0.5 * more}
    new = np.array(vector)
    for path, shift in shifts.items():
        new[places[path]] += shift
    return np.asarray(new)


def _sliding(batch: AbstractBatch, deflection: float, budget: BacklashEffort) -> Float[np.ndarray, " r"]:
    """1 for the recordings that slide for a part of their time, else 0."""
    ends = np.asarray(batch.x)[:, :: batch.block]
    travelled = np.abs(np.diff(ends, axis=1, append=ends[:, -1:]))
    scored = np.asarray(batch.block_count) > 0
    far = np.sum((travelled > budget.travel * deflection) & scored, axis=1)
    return np.where(far > budget.slides * np.sum(scored, axis=1), 1.0, 0.0)


def _free_load(posterior: Posterior, vector: Float[Numbers, " q"], ratio: float) -> Float[Numbers, " q"]:
    """`vector` with a load of this `ratio`, and with the inertia of sliding: stiffness and damping stay what they
    were."""
    place = len(posterior.drive.effects) - 1
    new = _with(posterior, vector, {"ratio": ratio, "frequency": _FREQUENCY, "damping": _DAMPING}, place)
    # The fit of a rigid machine ends as heavy as it was in sliding, where it started, or as light as in stick.
    now, first = (float(posterior.drive_of(one).J) for one in (vector, posterior.start))
    return heavier(posterior, new, max(now, first) / now)


def _around(
    vector: Float[Numbers, " q"],
    posterior: Posterior,
    gaps: Float[np.ndarray, " g"],
    shares: Sequence[float] | Float[np.ndarray, " s"],
) -> list[Float[Numbers, " q"]]:
    """`vector` at each of the `gaps` (position units), with each of these `shares` of the viscous friction the
    load's."""
    drive, place = posterior.drive_of(vector), len(posterior.drive.effects) - 1
    viscous, inertia = _viscous(drive), float(drive.load_side.ratio * drive.J)  # type: ignore[union-attr]
    models = []
    for gap, share in itertools.product(gaps, shares):
        new = _with(posterior, vector, {"gap": gap, "drag": share * viscous / inertia}, place)
        left = max(1.0 - share, _LEAST_LEFT) * viscous
        for index, free in enumerate(posterior.layout):
            if free.path == "friction.sigma2":  # unless it is fixed
                new = changed(new, index, new[index] + np.log(left / float(drive.friction.sigma2)))
        models.append(new)
    return models


def _with(
    posterior: Posterior, vector: Float[Numbers, " q"], values: dict[str, float], place: int
) -> Float[Numbers, " q"]:
    """`vector` with these values of the effect at the `place`."""
    new = np.array(vector)
    for index, free in enumerate(posterior.layout):
        name = free.parameter.name
        if free.path == f"effects.{place}.{name}" and name in values:
            log = free.parameter.transform == "log"
            new[index] = np.log(values[name]) if log else values[name] / float(free.scale)
    return np.asarray(new)


def _best(
    posterior: Posterior, models: list[Float[Numbers, " q"]], rows: Float[np.ndarray, " r"], scale: float
) -> tuple[Float[Numbers, " q"], float]:
    """The best of the `models` by the recordings `rows` with a Cauchy loss of the power `scale`, and its cost."""
    costs = [misfit_of(power, rows, posterior.batch, scale) for power in posterior.powers(models)]
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
