"""The fitted model as the tests of effects see it: innovations, weighed Jacobian, and effects injected into it."""

from collections.abc import Iterable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.screening.imposed_effects import errors_with_effect
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.evidence.power import block_power, sum_clusters
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import all_columns
from frictionjax.physics import Drive, Push
from frictionjax.physics.effects import AbstractEffect
from frictionjax.simulation import innovation_gain, observe
from frictionjax.simulation.injected import Along, Signals, along, injected_innovations, signals_along
from frictionjax.simulation.observer import corrected_states

BESIDE = 4
"""Vectors of one effect that are tested side by side; most forms have no more."""
_TOGETHER = 2  # so many effects go together: with more the rows leave the first cache
_FINER = 4  # times as many integration steps: a sixteenth of the error of the scheme is left


class Weighing(eqx.Module):
    """What the regressions of all effects share: a weight of each sample `(r, n)`, the weighted Jacobian `(q, m)`, its
    Gram matrix with the prior `(q, q)`, its product with the innovations `(q,)`, and that with the `fine` ones of each
    cluster `(c, q)`."""

    weight: Float[Array, "r n"]
    base: Float[Array, "q m"]
    gram: np.ndarray
    right: np.ndarray
    clusters: np.ndarray


class Present(eqx.Module):
    """The model to which effects are added, before the fitted recordings alone.

    **Attributes:** `joint`, `vector` (fitted), the `drive` that it makes, `e` (innovations, shape `(r, n)`), `fine`
    (with finer integration steps: what is tested for significance, since the error of few steps, a fraction of the
    noise, is significant in long recordings), `weighings` (one for each knee), `misfit`, `samples` (scored), `motion`
    (what it knows along the observed motion, arrays of shape `(r, n)`; None where the motion is imposed).
    """

    joint: Posterior
    vector: Float[Array, " q"]
    drive: Drive
    e: Float[Array, "r n"]
    fine: Float[Array, "r n"]
    weighings: tuple[Weighing, ...]
    misfit: float
    samples: float
    motion: Along | None

    def lanes(self, blocks: Iterable[tuple[list[Posterior], list]]) -> Iterator[Float[Array, "lanes r n"]]:
        """Standardised innovations for the vectors of each of the `blocks`: of this model with one more effect, joints
        of one layout and as many vectors, whose signals along the observed motion are injected. There are `BESIDE`
        lanes or more to a block; the last of its vectors fills those that are left. Where the motion is imposed the
        model with the effect is run as it is."""
        ready: list[tuple[Array, Signals]] = []
        for joints, vectors in blocks:
            filled = [*vectors, *[vectors[-1]] * (BESIDE - len(vectors))]
            joints = [*joints, *[joints[-1]] * (BESIDE - len(joints))]
            if self.motion is None:
                yield errors_with_effect(joints, filled)
                continue
            ready.append(self._ready(joints, filled))
            if len(ready) == _TOGETHER:
                # Blocks are alike but for those of effects with many strengths.
                alike = len({str(jax.tree.map(jnp.shape, block)) for block in ready}) == 1
                run = _TOGETHER if alike else 1
                yield from self._run(ready[:run])
                ready = ready[run:]
        for block in ready:
            yield from self._run([block])

    def _ready(self, joints: list[Posterior], vectors: list) -> tuple[Float[Array, "k q"], Signals]:
        """The `vectors` without what is the effect's, and the signals of the effect at each of them."""
        assert self.motion is not None
        old, more = len(self.joint.layout), len(joints[0].layout)
        drive, batch = self.drive, self.joint.batch
        each = [_effect_at(joint, vector) for joint, vector in zip(joints, vectors, strict=True)]
        effects = jax.tree.map(lambda *leaves: np.stack(leaves), *each)
        model = (drive.friction, drive.J, drive.motor_constant)
        signals = _signals(effects, model, self.motion, batch.dt, batch.before)
        stack = np.stack([np.asarray(vector) for vector in vectors])
        return jnp.asarray(np.concatenate([stack[:, :old], stack[:, more:]], axis=1)), signals

    def _run(self, blocks: list) -> list[Float[Array, "lanes r n"]]:
        """Those of each of the `blocks`. One program serves all: it runs `_TOGETHER` of them, the last again where
        there are fewer."""
        assert self.motion is not None
        push = Push(self.motion.push, self.motion.rise)
        filled = [*blocks, *[blocks[-1]] * (_TOGETHER - len(blocks))]
        vectors, signals = zip(*filled, strict=True)
        return _injected_lanes(self.joint, vectors, push, signals)[: len(blocks)]

    def injected(self, joints: list[Posterior], vectors: list) -> Float[Array, "k r n"]:
        """`lanes` for any number of vectors of one effect, shape `(k, r, n)`."""
        parts = [slice(first, first + BESIDE) for first in range(0, len(vectors), BESIDE)]
        found = self.lanes((joints[part], vectors[part]) for part in parts)
        return jnp.concatenate(list(found))[: len(vectors)]


def _effect_at(joint: Posterior, vector) -> AbstractEffect:
    """The last effect of `joint` at a free `vector`."""
    effect, place = joint.drive.effects[-1], len(joint.drive.effects) - 1
    values, point = {}, np.asarray(vector)
    for index, free in enumerate(joint.layout):
        if not free.path.startswith(f"effects.{place}."):
            continue
        parameter, coordinate = free.parameter, point[index]
        value = np.exp(coordinate) if parameter.transform == "log" else coordinate * float(free.scale)
        values[parameter.name] = np.clip(value, parameter.lower, parameter.upper)
    fixed = {
        name: getattr(effect, name)
        for name in (parameter.name for parameter in effect.strengths + effect.nuisances)
        if name not in values
    }
    return type(effect)(**values, **fixed)


@eqx.filter_jit
def _motion(drive, deflection, batch, gains):
    def one(u, x, dt, gains, start):
        seen = observe(drive, drive.applied_force(u, dt), x, dt, gains, start, substeps=batch.substeps)
        return along(drive, corrected_states(drive, seen, gains), u, dt)

    return batch.each(one, gains, deflection * drive.friction.Fs / drive.friction.sigma0)


@eqx.filter_jit
def _signals(effects, model, motion, dt, before):
    # Nothing here depends on what effects the model has: each form is compiled once.
    def lane(effect):
        friction, inertia, motor_constant = model

        def one(known, dt, before):
            return signals_along(friction, inertia, motor_constant, effect, known, dt, before)

        return jax.vmap(one)(motion, dt, before)

    return jax.vmap(lane)(effects)


@eqx.filter_jit
def _injected_lanes(joint, vectors, push, signals):
    batch, gains, count = joint.batch, joint.recordings.gains, joint.parameters
    stack = jnp.concatenate(vectors)
    drives = jax.vmap(joint.drive_of)(stack)
    z0 = stack[:, count:] * (drives.friction.Fs / drives.friction.sigma0)[:, None]
    start = (batch.x0, batch.v0, z0, batch.before)
    every = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *signals)
    raw = injected_innovations(drives, every, push, batch.x, batch.dt, gains, start, substeps=batch.substeps)
    e = raw / (batch.noise * innovation_gain(gains))[None, :, None] * batch.valid[None]
    return jnp.split(e, np.cumsum([len(own) for own in vectors])[:-1])


@eqx.filter_jit
def _fine(joint, vector, e):
    drive = joint.drive_of(vector)
    fine = joint.recordings.standardised(drive, vector[joint.parameters :], finer=_FINER)
    return jnp.where(jnp.isfinite(fine), fine, e)


@eqx.filter_jit
def _weighing(power, knee, e, fine, jacobian, weights, prior):
    block = e.shape[1] // power.shape[1]
    weight = jnp.repeat(1.0 / (power + knee), block, axis=-1) * weights
    weighted = jacobian * weight[None]
    base = weighted.reshape(jacobian.shape[0], -1)
    gram = base @ jacobian.reshape(jacobian.shape[0], -1).T + 0.5 * jnp.diag(prior**2)
    return weight, base, gram, base @ e.ravel(), sum_clusters(weighted * fine[None], block)


def present_model(joint: Posterior, vector: Float[Array, " q"]) -> Present:
    """The fitted model before its fitted recordings, ready for tests."""
    rows = np.flatnonzero(np.asarray(joint.fitted[0]) > 0)
    # Evaluated with the held-out ones: that program is there already.
    evaluation = joint.evaluated(vector)[0].of_recordings(rows)
    joint, vector = joint.of_fitted(vector)
    e, jacobian = evaluation.e, all_columns(evaluation)
    fine = _fine(joint, vector, e)
    power = np.asarray(block_power(e, joint.batch))
    used = power[np.asarray(joint.batch.block_count) > 0]
    knees = dict.fromkeys((1.0, max(float(np.quantile(used, 0.7)), 1.0)))
    weighings = []
    for knee in knees:
        weight, base, *small = _weighing(
            jnp.asarray(power), jnp.asarray(knee), e, fine, jacobian, joint.sample_weight, joint.prior
        )
        weighings.append(Weighing(weight, base, *(np.asarray(part) for part in small)))
    drive, samples = joint.drive_of(vector), float(jnp.sum(joint.batch.valid))
    seen, motion = joint.recordings, None
    if isinstance(seen, Observed):
        motion = _motion(drive, vector[joint.parameters :], seen.batch, seen.gains)
    misfit = misfit_of(power, np.asarray(joint.fitted[0]), joint.batch)
    return Present(joint, vector, drive, e, fine, tuple(weighings), misfit, samples, motion)
