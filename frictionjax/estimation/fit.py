"""`fit`: the free parameters of a drive from recordings and frequency responses of any kind, jointly."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from frictionjax.core import InputError, Progress, reporting, require_x64
from frictionjax.core.arrays import Numbers
from frictionjax.estimation.constraints import Constraints, resolve
from frictionjax.estimation.data.batch import Batch, make_batch
from frictionjax.estimation.data.given import (
    Data,
    keeps_inertia,
    pieces_of,
    plant_of,
    require_agreement,
    units_of,
)
from frictionjax.estimation.data.moving_mass import pieces_without_moving_mass
from frictionjax.estimation.data.observation import (
    Observation,
    Sorted,
    recordings_of,
    responses_of,
    sort_data,
)
from frictionjax.estimation.descent.refine import OneFit, Refined, at_start, refine
from frictionjax.estimation.descent.settle import robust_costs, settle
from frictionjax.estimation.evidence import AbstractEvidence, make_forces, make_response, observed
from frictionjax.estimation.objective.loss import AbstractLoss, Gaussian
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH
from frictionjax.estimation.parameters import changed, pack, part_of, weak_prior
from frictionjax.estimation.result import FitResult, make_result
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start.driven import starting_values
from frictionjax.estimation.start.imposed import starting_values_imposed
from frictionjax.physics import Drive

_SPREAD = 4.0  # factor by which random starts differ from the given one, at most
# Robust cost after the first descent: below it the model fits, and no other start is tried.
_MODEL_FITS = 0.02
_MOST_MINIMA = 3  # starts that are followed to a minimum, at most
_NO_OFFSET = (
    "The positions are integrated velocities, and the model has no offset of their sensor, which biases its friction: "
    "drive.with_effects(frictionjax.physics.VelocityOffset()) has one."
)
_NO_INERTIA = "All motion is imposed, so inertia cannot be identified: J stays at its starting value."


def fit(
    drive: Drive | Sequence[Drive],
    data: Data,
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    ties: Mapping[str, tuple[str, float]] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    loss: AbstractLoss | None = None,
    starts: int = 0,
    own_starts: bool = True,
    known_inertia: bool | None = None,
    encoder_step: float | None = None,
    substeps: int = 2,
    scales: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    key: Key[Array, ""] | None = None,
    progress: Progress | bool = True,
) -> FitResult:
    """Fit inertia, LuGre parameters and the effects of `drive` to all `data` jointly, by maximum likelihood.

    Positions are compared through a Kalman filter (`simulation/kalman.py`) whose noise, of the sensor and of a small
    unmeasured force, is estimated for each recording with the parameters. So drift in sliding does not bias the
    parameters; neither does a closed loop, whose input carries the sensor's noise (the innovations are independent of
    the past, Ljung, System Identification, 1999, sec. 13.4); and the innovations are white, so that the standard errors
    are right. From every start a robust cost with a fixed-gain observer is brought down first (`settle`).

    **Arguments:**

    - `drive`: structure and starting values, or several starts of one structure.
    - `data`: a `Case`, whose held-out recordings are left alone; the path of a case file or of a recording; a
        DataFrame; or a list of recordings (`drive = "force"` or `"motion"`), frequency responses in stick, and
        `Observation`s of either. What their case knows of the machine holds: its motor constant, inertia, encoder and
        units.
    - `free`: labels of the parameters to be found; None: all but the motor constant. `fixed`: labels that are not.
    - `ties`: label -> (other label, factor): the parameter is that many times the other.
    - `bounds`: label -> (least, most), in the parameter's unit.
    - `priors`: label -> (mean, standard deviation), in the parameter's unit: one more residual each.
    - `loss`: an `AbstractLoss`; None: `Gaussian`, least squares. `Cauchy` and `Huber` weigh down blocks of 0.05 s.
    - `starts`: so many random starts more, up to a factor 4 away in each positive parameter, side by side.
    - `own_starts`: also start from the `starting_values` of the recordings, if their robust cost is lower.
    - `known_inertia`: keep J, as `fixed=("J",)`; None: where the case of `data` knows the inertia and J is not
        in `free`, `ties` or `priors`.
    - `encoder_step`: quantum of the position sensor; None: as the case of `data` says, or the smallest step in them.
    - `substeps`: integration steps per sample.
    - `scales`: sizes of the plant by name, for strengths of effects; None: from the start and the recordings.
    - `units`: names for `force`, `position` and `input`; None: those of the case of `data`.
    - `key`: for random starts; None: `jax.random.key(0)`.
    - `progress`: called as the fit goes on; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    A `FitResult`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` for data or choices that contradict each other (see
    `sort_data`, `constraints.resolve`), and for a `drive` that contradicts the case of `data`; `ValueError` when a
    positive parameter starts at zero or below, or no start gives finite predictions.
    """
    require_x64()
    given = (drive,) if isinstance(drive, Drive) else tuple(drive)
    if not given:
        raise InputError("no start is given", place="`drive`", cure="Give a `Drive`.")
    for one in given:
        _require_positive(one)
    given_data = pieces_of(data)
    plant = plant_of(given_data)
    friction, taken_off = pieces_without_moving_mass(given_data)
    pieces = sort_data(friction)
    imposed = bool(pieces.forces) and not pieces.positions and not pieces.responses
    known_inertia = keeps_inertia(plant, known_inertia, {*(free or ()), *(priors or {}), *(ties or {})})
    for one in given:
        constant = not imposed and "motor_constant" not in (free or ())
        require_agreement(one, plant, motor_constant=constant, inertia=known_inertia)
    notes = (*pieces.notes, *taken_off)
    if any(one.integrated for one in recordings_of(pieces.positions)) and not given[0].sensor_integrates:
        notes += (_NO_OFFSET,)
    if "J" not in fixed and (
        known_inertia or (imposed and _inertia_is_unidentifiable(ties or {}, priors or {}))
    ):
        fixed = (*fixed, "J")
        free = None if free is None else tuple(name for name in free if name != "J")
        notes += () if known_inertia else (_NO_INERTIA,)
    if encoder_step is None and plant is not None:
        encoder_step = plant.encoder_step
    batch = _batch_of(pieces.positions, encoder_step)
    template, dt = given[0], _shortest(pieces)
    sizes = scales if scales is not None else _sizes(template, batch, pieces)
    constraints = resolve(
        template,
        dt,
        sizes,
        free=free,
        fixed=fixed,
        ties=ties or {},
        bounds=bounds or {},
        priors=priors or {},
        imposed=imposed,
    )
    posterior = _posterior(template, constraints, batch, pieces, loss or Gaussian())
    vectors = [_vector(posterior, one) for one in given]
    with reporting(progress) as report:
        if own_starts and (pieces.positions or pieces.forces):
            report("starting values", 0.0)
            own, undetermined = _own(template, pieces, constraints)
            vectors += [_vector(posterior, one) for one in own]
            notes += undetermined
        known = np.array([one.noise is not None for one in pieces.positions], dtype=bool)
        refined = _best(posterior, vectors, len(given), starts, key, substeps, known, report)
        report("standard errors", 0.95)
        return make_result(refined, _names_of(pieces), {**units_of(plant), **(units or {})}, notes)


def _names_of(pieces: Sorted) -> tuple[tuple[str, ...], ...]:
    """A name for each recording and response, evidence by evidence; a second one of a name has its number."""
    taken: dict[str, int] = {}

    def unique(name: str) -> str:
        taken[name] = taken.get(name, 0) + 1
        return name if taken[name] == 1 else f"{name} ({taken[name]})"

    names = [
        tuple(unique(one.name) for one in recordings_of(kind))
        for kind in (pieces.positions, pieces.forces)
        if kind
    ]
    return (*names, *((f"response {index + 1}",) for index in range(len(pieces.responses))))


def _shortest(pieces: Sorted) -> float:
    rates = [one.data.sample_rate for one in (*pieces.positions, *pieces.forces, *pieces.responses)]
    return 1.0 / float(np.max(np.asarray(rates, dtype=float)))


def _batch_of(observations: tuple[Observation, ...], encoder_step: float | None) -> Batch | None:
    if not observations:
        return None
    batch = make_batch(recordings_of(observations), encoder_step=encoder_step)
    for name in ("noise", "x0", "v0"):
        values = np.array(getattr(batch, name))
        for row, one in enumerate(observations):
            if getattr(one, name) is not None:
                values[row] = getattr(one, name)
        batch = eqx.tree_at(lambda b, name=name: getattr(b, name), batch, values)
    return batch


def _sizes(drive: Drive, batch: Batch | None, pieces: Sorted) -> Mapping[str, float]:
    if batch is not None:
        return plant_scales(drive, batch)
    if pieces.forces:
        return plant_scales(drive, make_forces(recordings_of(pieces.forces)))
    return {}


def _posterior(
    drive: Drive, constraints: Constraints, batch: Batch | None, pieces: Sorted, loss: AbstractLoss
) -> Posterior:
    evidence: list[AbstractEvidence] = []
    weights = []
    if batch is not None:
        evidence.append(observed(batch, FAST_BANDWIDTH))
        blocks = batch.x.shape[1] // batch.block
        weights.append(np.repeat([one.weight for one in pieces.positions], blocks))
    if pieces.forces:
        forces = make_forces(recordings_of(pieces.forces), tuple(one.noise for one in pieces.forces))
        evidence.append(forces)
        weights.append(np.repeat([one.weight for one in pieces.forces], forces.x.shape[1] // forces.block))
    for one, frf in zip(pieces.responses, responses_of(pieces.responses), strict=True):
        response = make_response(frf, one.band, hold=one.hold)
        evidence.append(response)
        weights.append(np.full(response.count.shape[0], one.weight))
    rows = sum(one.rows for one in evidence)
    start = np.concatenate([pack(constraints.layout, drive), np.zeros(rows)])
    return Posterior(
        constraints,
        drive,
        start,
        weak_prior(constraints.layout, rows),
        tuple(evidence),
        tuple(np.asarray(weight, dtype=float) for weight in weights),
        loss,
        tuple(np.ones(max(one.rows, 1)) for one in evidence),
        (None,) * len(evidence),
    )


def _vector(posterior: Posterior, drive: Drive) -> Float[Numbers, " q"]:
    count = posterior.parameters
    return changed(posterior.start, slice(count), pack(posterior.constraints.layout, drive))


def _own(template: Drive, pieces: Sorted, constraints: Constraints) -> tuple[list[Drive], tuple[str, ...]]:
    """Starts from the recordings, with the effects, the motor constant and all that is not free of `template`; and
    what imposed motions do not determine, in sentences."""
    free = [one.label for one in constraints.layout]
    motor_constant = float(template.motor_constant)
    if pieces.positions:
        found = starting_values(recordings_of(pieces.positions), motor_constant=motor_constant)
    else:
        found = starting_values_imposed(
            recordings_of(pieces.forces),
            inertia=None if "J" in free else float(template.J),
            responses=responses_of(pieces.responses),
            motor_constant=motor_constant,
        )
    own = []
    for one in found.drives:
        drive = eqx.tree_at(lambda d: (d.J, d.friction), template, (one.J, one.friction))
        # Some coordinates are ratios to a parameter that may be fixed: it is then that of `template`.
        for path in ("J", *(f"friction.{parameter.name}" for parameter in template.friction.parameters)):
            if path.removeprefix("friction.") not in free:
                drive = eqx.tree_at(lambda d, path=path: part_of(d, path), drive, part_of(template, path))
        own.append(drive)
    return own, () if pieces.positions else found.notes


def _inertia_is_unidentifiable(
    ties: Mapping[str, tuple[str, float]], priors: Mapping[str, tuple[float, float]]
) -> bool:
    """Whether J, where all motion is imposed, rests on its starting value alone."""
    return "J" not in priors and "J" not in ties and all(source != "J" for source, _ in ties.values())


def _best(
    posterior: Posterior,
    vectors: list[Float[Numbers, " q"]],
    given: int,
    starts: int,
    key: Key[Array, ""] | None,
    substeps: int,
    known: Bool[np.ndarray, " r"],
    progress: Progress,
) -> Refined:
    """The best minimum: from the most promising start, and from the next ones where that one looks wrong."""
    stacked = np.stack(vectors)
    costs = np.concatenate([robust_costs(_about(posterior, vector), vector[None]) for vector in vectors])
    if not np.any(np.isfinite(costs)):
        raise ValueError(
            "No starting value gives finite predictions; check `drive`, and the units of the recordings and of "
            "the motor constant."
        )
    order = [place for place in np.argsort(costs) if np.isfinite(costs[place])]
    progress("settling", 0.05)
    if starts:
        moved = _random(posterior, vectors[order[0]], starts, jax.random.key(0) if key is None else key)
        reached, finals = settle(
            _about(posterior, vectors[order[0]]), np.concatenate([stacked[np.array(order)], moved])
        )
        chosen = [reached[i][None] for i in np.argsort(finals) if np.isfinite(finals[i])]
    else:
        # The best of the user's own starts is followed in any case.
        best = min((place for place in order if place < given), key=lambda place: costs[place], default=None)
        if best is not None and best not in order[:_MOST_MINIMA]:
            order.insert(_MOST_MINIMA - 1, best)
        chosen = [vectors[place][None] for place in order]
    found: list[Refined] = []
    for number, first in enumerate(chosen[:_MOST_MINIMA]):
        # Each range is about its own start: what is read off recordings may be far from what the user guessed.
        near = _about(posterior, first[0])
        end, cost = (first, np.zeros(1)) if starts else settle(near, first)
        progress("refining", 0.4 + 0.5 * number / _MOST_MINIMA)
        # The range is about this vector from now on: a bad start may have been further off than the range is wide.
        settled = near.within(end[0])
        found.append(refine(OneFit(known, substeps), at_start(_about(posterior, settled), settled)))
        if cost[0] < _MODEL_FITS and not found[-1].inconsistent:
            break
    return min(found, key=lambda one: one.cost)


def _about(posterior: Posterior, vector: Float[Numbers, " q"]) -> Posterior:
    """`posterior` with its ranges and its weak prior about `vector`."""
    return eqx.tree_at(lambda p: p.start, posterior, vector)


def _random(
    posterior: Posterior, vector: Float[Numbers, " q"], starts: int, key: Key[Array, ""]
) -> Float[Numbers, "k q"]:
    count = posterior.parameters
    logs = np.array([one.parameter.transform == "log" for one in posterior.constraints.layout])
    away = np.log(_SPREAD) * np.asarray(jax.random.uniform(key, (starts, count), minval=-1.0, maxval=1.0))
    moved = np.tile(vector, (starts, 1))
    moved[:, :count] += away * logs
    return moved


def _require_positive(drive: Drive) -> None:
    """Raise the `ValueError` for a `drive` that does not start positive: at zero a logarithm has no slope."""
    values = {"J": drive.J} | {p.name: getattr(drive.friction, p.name) for p in drive.friction.parameters}
    bad = [f"{name} = {float(value):g}" for name, value in values.items() if not float(value) > 0.0]
    if bad:
        raise ValueError(
            f"`drive` starts at {', '.join(bad)}; a fit needs positive starting values, however small."
        )
