"""Name: every effect tested against the present model, with all base parameters free to absorb it.

For each form of each effect, finite steps of its strength are injected into the present model, as signals along the
motion that it observed; the innovations are regressed on them and on the Jacobian of the present model. The one-step
estimate, effect and base parameters together, is then simulated: what the misfit really gains ranks the candidates (a
linear gain can be a mirage), and the clustered score test gives the p-value. One compiled model serves all effects.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import f

from frictionjax.estimation.joint import CLUSTER_BLOCKS, LANES, Joint, extend, misfit_of
from frictionjax.estimation.parameters import unpack
from frictionjax.estimation.residuals import block_power
from frictionjax.physics.effects import AbstractEffect
from frictionjax.simulation import Gains, innovation_gain, observe
from frictionjax.simulation.injected import injected_innovations, signals_along
from frictionjax.simulation.observer import corrected_states
from frictionjax.simulation.ros2 import State

_DAMPING = (1.0, 0.4)
_LONGEST_STEP = 1.5
_SIMULATED = 2  # tests of a form whose one-step estimates are simulated: those that promise most
_THROWN = 1e4  # rms of a column's finite step over that of the innovations: beyond it a break-away has moved


class Trial(eqx.Module):
    """One effect form tested at one value of its nuisances with one finite step.

    **Attributes:** `effect` (name), `form` (the effect at zero strength), `joint`, `vector` (the best one-step vector),
    `gain` (drop of the misfit when that vector is simulated), `linear_gain` (drop promised by the regression),
    `p_value` (clustered score test), `one_step` and `detectable` (strength name -> one-step estimate, smallest
    detectable size, in the strength's unit).
    """

    effect: str = eqx.field(static=True)
    form: AbstractEffect
    joint: Joint
    vector: Float[Array, " q"]
    gain: float
    linear_gain: float
    p_value: float
    one_step: dict[str, float] = eqx.field(static=True)
    detectable: dict[str, float] = eqx.field(static=True)


class Present(eqx.Module):
    """The model to which effects are added.

    **Attributes:** `joint` and `vector` (fitted), `e` (innovations, shape `(r, n)`), `jacobian` (`(q, r, n)`; zero in
    recordings kept aside), `weights` (of each sample, one array for each knee), `misfit`, `motion` (the states that it
    observed, arrays of shape `(r, n, ...)`).
    """

    joint: Joint
    vector: Float[Array, " q"]
    e: Float[Array, "r n"]
    jacobian: Float[Array, "q r n"]
    weights: tuple[Float[Array, "r n"], ...]
    misfit: float
    motion: State

    def injected(self, joint: Joint, vectors: list) -> Float[Array, "k r n"]:
        """Standardised innovations for `vectors` of this model with one more effect (`joint`), whose signals along the
        observed motion are injected; shape `(k, r, n)`."""
        old, more = len(self.joint.layout), len(joint.layout)
        found = []
        for first in range(0, len(vectors), LANES):
            some = list(vectors[first : first + LANES])
            stack = jnp.stack(some + [some[-1]] * (LANES - len(some)))
            signals = _signals(joint.layout, stack, joint.setting, self.joint.drive(self.vector), self.motion)
            own = jnp.concatenate([stack[:, :old], stack[:, more:]], axis=1)
            found.append(_injected_lanes(self.joint.layout, own, self.joint.setting, signals)[: len(some)])
        return jnp.concatenate(found)


@eqx.filter_jit
def _motion(drive, deflection, batch, gains):
    def one(u, x, dt, position_gain, velocity_gain, x0, v0, z0, before):
        own = Gains(position_gain, velocity_gain)
        seen = observe(drive, drive.applied_force(u, dt), x, dt, own, (x0, v0, z0, before))
        return corrected_states(drive, seen, own)

    z0 = deflection * drive.friction.Fs / drive.friction.sigma0
    return jax.vmap(one)(
        batch.u,
        batch.x,
        batch.dt,
        gains.position,
        gains.velocity,
        batch.x0,
        batch.v0,
        z0,
        batch.before,
    )


@eqx.filter_jit
def _signals(layout, vectors, setting, drive, motion):
    batch, count = setting.batch, len(layout)

    def lane(vector):
        effect = unpack(layout, setting.drive, vector[:count], setting.start[:count]).effects[-1]
        return jax.vmap(lambda *own: signals_along(drive, effect, *own))(
            motion, batch.u, batch.dt, batch.before
        )

    return jax.vmap(lane)(vectors)


@eqx.filter_jit
def _injected_lanes(layout, vectors, setting, signals):
    batch, gains, count = setting.batch, setting.gains, len(layout)

    def lane(vector, signals):
        drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
        z0 = vector[count:] * drive.friction.Fs / drive.friction.sigma0

        def one(signals, x, dt, position_gain, velocity_gain, x0, v0, z, before):
            own = Gains(position_gain, velocity_gain)
            return injected_innovations(drive, signals, x, dt, own, (x0, v0, z, before))

        raw = jax.vmap(one)(
            signals,
            batch.x,
            batch.dt,
            gains.position,
            gains.velocity,
            batch.x0,
            batch.v0,
            z0,
            batch.before,
        )
        return raw / (batch.noise * innovation_gain(gains))[:, None] * batch.valid

    return jax.vmap(lane)(vectors, signals)


@eqx.filter_jit
def _lane_powers(e, batch):
    return jax.vmap(lambda lane: block_power(lane, batch))(e)


@eqx.filter_jit
def _weight(power, knee, batch, fitted):
    weight = 1.0 / (power + knee)
    return jnp.repeat(weight, batch.block, axis=-1) * batch.valid * fitted[:, None]


def present_model(joint: Joint, vector: Float[Array, " q"]) -> Present:
    """The fitted model, ready for tests."""
    e, jacobian = joint.errors_and_columns(vector)
    power = np.asarray(joint.powers([vector])[0])
    used = power[(np.asarray(joint.batch.block_count) > 0) & (np.asarray(joint.fitted)[:, None] > 0)]
    knees = dict.fromkeys((1.0, max(float(np.quantile(used, 0.7)), 1.0)))
    weights = tuple(_weight(jnp.asarray(power), jnp.asarray(k), joint.batch, joint.fitted) for k in knees)
    misfit = misfit_of(power, np.asarray(joint.fitted), joint.batch)
    gains, count = joint.setting.gains, len(joint.layout)
    motion = _motion(joint.drive(vector), jnp.asarray(vector)[count:], joint.batch, gains)
    return Present(joint, jnp.asarray(vector), e, jacobian, weights, misfit, motion)


def forms_to_try(
    form: type[AbstractEffect], scales: dict[str, float], periods: dict[str, tuple[float, ...]]
) -> list[AbstractEffect]:
    """Instances of one form at zero strength, one for every grid point of its nuisances.

    **Arguments:**

    - `form`: the class.
    - `scales`: the plant's sizes.
    - `periods`: name of a kind of period (`"odd_period"` ...) -> periods found in the data.
    """
    axes = []
    for nuisance in form.nuisances:
        if nuisance.grid == "period":
            axes.append([(nuisance.name, period) for period in periods[str(nuisance.scale)]])
        else:
            scale = nuisance.scale if isinstance(nuisance.scale, float) else scales[str(nuisance.scale)]
            axes.append([(nuisance.name, scale * value) for value in nuisance.grid])
    return [form(**dict(point)) for point in itertools.product(*axes)]


@eqx.filter_jit
def _regress(e, base, columns, weight, prior, block):
    """Normal equations of the innovations on [base, columns], and cluster gradients of the projected columns."""
    design = jnp.concatenate([base, columns])
    weighted = design * weight[None]
    gram = jnp.einsum("irn,jrn->ij", weighted, design)
    right = jnp.einsum("irn,rn->i", weighted, e)
    count = base.shape[0]
    own = gram[:count, :count] + jnp.diag(prior**2)
    coefficients = jnp.linalg.solve(own, gram[:count, count:])
    projected = columns - jnp.einsum("ij,irn->jrn", coefficients, base)
    product = projected * (e * weight)[None]
    length = block * CLUSTER_BLOCKS
    product = jnp.pad(product, ((0, 0), (0, 0), (0, -product.shape[-1] % length)))
    return gram, right, product.reshape(columns.shape[0], -1, length).sum(-1).T


class _Promise(eqx.Module):
    """What the regression on one finite step promises."""

    form: AbstractEffect
    joint: Joint
    where: tuple[int, ...] = eqx.field(static=True)
    candidates: list
    linear_gain: float
    p_value: float
    spread: np.ndarray


def try_form(present: Present, instances: list[AbstractEffect], scales: dict[str, float]) -> list[Trial]:
    """Test one form of an effect against the `present` model.

    **Arguments:**

    - `present`: the fitted model.
    - `instances`: the form at zero strength, at each point of its grid.
    - `scales`: the plant's sizes.

    **Returns:**

    One `Trial` per instance and finite step. Only the steps that promise most are simulated; the others have no gain.
    """
    promises = [promise for instance in instances for promise in _promises(present, instance, scales)]
    promises.sort(key=lambda promise: -promise.linear_gain)
    return [
        _simulated(present, promise) if rank < _SIMULATED else _unsimulated(promise)
        for rank, promise in enumerate(promises)
    ]


def _promises(present: Present, instance: AbstractEffect, scales) -> list[_Promise]:
    joint, vector = extend(present.joint, present.vector, instance, scales)
    old = len(present.joint.layout)
    names = [strength.name for strength in instance.strengths]
    where = [i for i in range(old, len(joint.layout)) if joint.layout[i].parameter.name in names]
    strengths = [joint.layout[i].parameter for i in where]
    if len(where) == 1:
        probes = [[(where[0], size)] for size in strengths[0].probes]
    else:
        probes = [[(i, p.probes[0]) for i, p in zip(where, strengths, strict=True)]]
    stepped = [vector.at[i].add(size) for probe in probes for i, size in probe]
    sizes = jnp.asarray([size for probe in probes for _, size in probe])
    changes = present.injected(joint, stepped) - present.e[None]
    columns = changes / sizes[:, None, None] * joint.fitted[None, :, None]
    found, first = [], 0
    typical = float(jnp.sqrt(jnp.mean(present.e**2)))
    for probe in probes:
        own = slice(first, first + len(probe))
        first += len(probe)
        # A step through a break-away event can throw the trajectory: such a column says nothing about a small effect.
        thrown = float(jnp.sqrt(jnp.mean(changes[own] ** 2)))
        if np.isfinite(thrown) and thrown < _THROWN * typical:
            found.append(_promise(present, instance, joint, vector, tuple(i for i, _ in probe), columns[own]))
    return found


def _promise(present: Present, instance, joint: Joint, vector, where, columns) -> _Promise:
    old, count = len(present.joint.layout), len(joint.layout)
    recordings = vector.shape[0] - count
    prior = present.joint.setting.prior
    # Present parameters (the first `old`), bristle deflections, then the strengths under test.
    position = np.concatenate([np.arange(old), np.arange(count, count + recordings), np.asarray(where)])
    candidates, linear, p_value, base = [], 0.0, 1.0, old + recordings
    spread = np.full(len(where), np.inf)
    for number, weight in enumerate(present.weights):
        gram, right, gradients = (
            np.asarray(a)
            for a in _regress(present.e, present.jacobian, columns, weight, prior, joint.batch.block)
        )
        if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(right))):
            continue
        ridge = np.concatenate([np.asarray(prior) ** 2, np.full(len(where), 1e-12)])
        step = -np.linalg.lstsq(gram + np.diag(ridge), right, rcond=None)[0]
        without = -np.linalg.lstsq(gram[:base, :base] + np.diag(ridge[:base]), right[:base], rcond=None)[0]
        samples = max(float(jnp.sum(weight > 0)), 1.0)
        linear = max(linear, float(-(right @ step) + right[:base] @ without) / samples)
        for damping in _DAMPING:
            change = np.zeros(vector.shape[0])
            change[position] = damping * np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            candidates.append(vector + jnp.asarray(change))
        if number == 0:
            p_value = _score_test(gradients)
            if len(where) == 1 and joint.layout[where[0]].parameter.lower == 0.0:
                # A strength that cannot be negative is tested on its own side.
                p_value = 0.5 * p_value if step[-1] > 0.0 else 1.0 - 0.5 * p_value
            information = np.linalg.pinv(gram + np.diag(ridge), hermitian=True)[base:, base:]
            spread = np.sqrt(np.diag(information @ (gradients.T @ gradients) @ information))
    return _Promise(instance, joint, where, candidates, linear, p_value, spread)


def _simulated(present: Present, promise: _Promise) -> Trial:
    if not promise.candidates:
        return _unsimulated(promise)
    powers = np.asarray(
        _lane_powers(present.injected(promise.joint, promise.candidates), promise.joint.batch)
    )
    fitted = np.asarray(promise.joint.fitted)
    values = [misfit_of(power, fitted, promise.joint.batch) for power in powers]
    best = int(np.argmin(values))
    return _trial(promise, promise.candidates[best], present.misfit - float(values[best]))


def _unsimulated(promise: _Promise) -> Trial:
    vector = promise.candidates[0] if promise.candidates else promise.joint.setting.start
    return _trial(promise, vector, -np.inf)


def _trial(promise: _Promise, vector, gain: float) -> Trial:
    free = [promise.joint.layout[i] for i in promise.where]
    values = np.asarray(vector)
    return Trial(
        effect=promise.form.name,
        form=promise.form,
        joint=promise.joint,
        vector=vector,
        gain=gain,
        linear_gain=promise.linear_gain,
        p_value=promise.p_value,
        one_step={
            p.parameter.name: float(np.clip(values[i] * p.scale, p.parameter.lower, p.parameter.upper))
            for p, i in zip(free, promise.where, strict=True)
        },
        detectable={
            p.parameter.name: float(4.0 * s * p.scale) for p, s in zip(free, promise.spread, strict=True)
        },
    )


def _score_test(gradients: np.ndarray) -> float:
    """p-value of "all strengths are zero" from cluster gradients, shape `(c, k)`: Hotelling's T^2 of their mean, robust
    to what correlates inside a cluster (0.5 s)."""
    used = gradients[np.any(gradients != 0.0, axis=1)]
    clusters, count = used.shape
    if clusters <= count + 1 or not np.all(np.isfinite(used)):
        return 1.0
    mean = used.mean(axis=0)
    covariance = np.atleast_2d(np.cov(used, rowvar=False))
    statistic = clusters * float(mean @ np.linalg.lstsq(covariance, mean, rcond=None)[0])
    return float(f.sf(statistic * (clusters - count) / (count * (clusters - 1)), count, clusters - count))
