"""The fitted model, linearised for the tests of effects: innovations, weighted Jacobian, effects injected into it."""

from collections.abc import Iterable, Iterator, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.screening.imposed_effects import errors_with_effect
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.evidence.power import block_power, sum_clusters
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import all_columns
from frictionjax.physics import Drive, LuGre, Push
from frictionjax.physics.effects import AbstractEffect, Before
from frictionjax.simulation import Gains, innovation_gain, observe
from frictionjax.simulation.fixed import Start
from frictionjax.simulation.injected import Along, Signals, along, injected_innovations, signals_along
from frictionjax.simulation.observer import corrected_states

BESIDE = 4
"""Vectors of one effect that are simulated in one batch; most forms have no more."""
_TOGETHER = 2  # effects in one batch: the rows of more do not fit the first cache
_FINER = 4  # times as many integration steps: a sixteenth of the integration error remains


class Weighing(eqx.Module):
    """What the regressions of all effects share.

    **Attributes:** `weight` of each sample, shape `(r, n)`; the weighted Jacobian, `base`, `(q, m)`; its Gram matrix
    with the prior, `gram`, `(q, q)`; its product with the innovations, `right`, `(q,)`; and its product with the `fine`
    innovations in each cluster, `clusters`, `(c, q)`.
    """

    weight: Float[Array, "r n"]
    base: Float[Array, "q m"]
    gram: Float[np.ndarray, "q q"]
    right: Float[np.ndarray, " q"]
    clusters: Float[np.ndarray, "c q"]


class Present(eqx.Module):
    """The model to which effects are added, with the fitted recordings alone.

    **Attributes:** its `posterior`, the fitted `vector` and the `drive` there, `e` (innovations, shape `(r, n)`),
    `fine` (the same at finer integration steps: these are tested, since the integration error of few steps, a fraction
    of the noise, is significant in long recordings), `weighings` (one for each scale of the loss), `misfit`, `samples`
    (number scored), `motion` (states and forces along the observed motion, arrays of shape `(r, n)`; None where the
    motion is imposed).
    """

    posterior: Posterior
    vector: Float[Array, " q"]
    drive: Drive
    e: Float[Array, "r n"]
    fine: Float[Array, "r n"]
    weighings: tuple[Weighing, ...]
    misfit: float
    samples: float
    motion: Along | None

    def lanes(
        self, blocks: Iterable[tuple[Sequence[Posterior], Sequence[Float[Array | np.ndarray, " q"]]]]
    ) -> Iterator[Float[Array, "lanes r n"]]:
        """Standardised innovations of this model with one more effect, for each of the `blocks`: posteriors of one
        layout and as many vectors. The signals of the effect along the observed motion are injected. A block has
        `BESIDE` lanes or more; copies of its last vector fill the rest. Where the motion is imposed the model with the
        effect is simulated itself."""
        ready: list[tuple[Float[Array, "k p"], Signals]] = []
        for posteriors, vectors in blocks:
            filled = [*vectors, *[vectors[-1]] * (BESIDE - len(vectors))]
            posteriors = [*posteriors, *[posteriors[-1]] * (BESIDE - len(posteriors))]
            if self.motion is None:
                yield errors_with_effect(posteriors, filled)
                continue
            ready.append(self._ready(posteriors, filled))
            if len(ready) == _TOGETHER:
                # Only effects with many strengths have blocks of another shape.
                alike = len({str(jax.tree.map(jnp.shape, block)) for block in ready}) == 1
                run = _TOGETHER if alike else 1
                yield from self._run(ready[:run])
                ready = ready[run:]
        for block in ready:
            yield from self._run([block])

    def _ready(
        self, posteriors: Sequence[Posterior], vectors: Sequence[Float[Array | np.ndarray, " q"]]
    ) -> tuple[Float[Array, "k p"], Signals]:
        """The `vectors` without the coordinates of the effect, and the signals of the effect at each of them."""
        assert self.motion is not None
        old, more = len(self.posterior.layout), len(posteriors[0].layout)
        drive, batch = self.drive, self.posterior.batch
        each = [_effect_at(one, vector) for one, vector in zip(posteriors, vectors, strict=True)]
        effects = jax.tree.map(lambda *leaves: np.stack(leaves), *each)
        model = (drive.friction, drive.J, drive.motor_constant)
        signals = _signals(effects, model, self.motion, batch.dt, batch.before)
        stack = np.stack([np.asarray(vector) for vector in vectors])
        return jnp.asarray(np.concatenate([stack[:, :old], stack[:, more:]], axis=1)), signals

    def _run(self, blocks: list[tuple[Float[Array, "k p"], Signals]]) -> list[Float[Array, "lanes r n"]]:
        """Innovations of each of the `blocks`. One compiled program serves all: it runs `_TOGETHER` of them, the last
        one repeated where there are fewer."""
        assert self.motion is not None
        push = Push(self.motion.push, self.motion.rise)
        filled = [*blocks, *[blocks[-1]] * (_TOGETHER - len(blocks))]
        vectors, signals = zip(*filled, strict=True)
        return _injected_lanes(self.posterior, vectors, push, signals)[: len(blocks)]

    def injected(
        self, posteriors: Sequence[Posterior], vectors: Sequence[Float[Array | np.ndarray, " q"]]
    ) -> Float[Array, "k r n"]:
        """`lanes` for any number of `vectors` of one effect, with as many `posteriors`, shape `(k, r, n)`."""
        parts = [slice(first, first + BESIDE) for first in range(0, len(vectors), BESIDE)]
        found = self.lanes((posteriors[part], vectors[part]) for part in parts)
        return jnp.concatenate(list(found))[: len(vectors)]


def _effect_at(posterior: Posterior, vector: Float[Array | np.ndarray, " q"]) -> AbstractEffect:
    """The last effect of the `posterior` at a free `vector`."""
    effect, place = posterior.drive.effects[-1], len(posterior.drive.effects) - 1
    values, point = {}, np.asarray(vector)
    for index, free in enumerate(posterior.layout):
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
def _motion(drive: Drive, deflection: Float[Array, " r"], batch: Batch, gains: Gains) -> Along:
    def one(
        u: Float[Array, " n"], x: Float[Array, " n"], dt: Float[Array, ""], gains: Gains, start: Start
    ) -> Along:
        observed = observe(drive, drive.applied_force(u, dt), x, dt, gains, start, substeps=batch.substeps)
        return along(drive, corrected_states(drive, observed, gains), u, dt)

    return batch.each(one, gains, deflection * drive.friction.Fs / drive.friction.sigma0)


@eqx.filter_jit
def _signals(
    effects: AbstractEffect,
    model: tuple[LuGre, Float[Array, ""], Float[Array, ""]],
    motion: Along,
    dt: Float[Array, " r"],
    before: Before,
) -> Signals:
    # Nothing here depends on the effects of the model: each form is compiled once.
    def lane(effect: AbstractEffect) -> Signals:
        friction, inertia, motor_constant = model

        def one(known: Along, dt: Float[Array, ""], before: Before) -> Signals:
            return signals_along(friction, inertia, motor_constant, effect, known, dt, before)

        return jax.vmap(one)(motion, dt, before)

    return jax.vmap(lane)(effects)


@eqx.filter_jit
def _injected_lanes(
    posterior: Posterior, vectors: tuple[Float[Array, "k p"], ...], push: Push, signals: tuple[Signals, ...]
) -> list[Float[Array, "k r n"]]:
    recordings, count = posterior.recordings, posterior.parameters
    assert isinstance(recordings, Observed)
    batch, gains = recordings.batch, recordings.gains
    stack = jnp.concatenate(vectors)
    drives = jax.vmap(posterior.drive_of)(stack)
    z0 = stack[:, count:] * (drives.friction.Fs / drives.friction.sigma0)[:, None]
    start = (batch.x0, batch.v0, z0, batch.before)
    every = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *signals)
    raw = injected_innovations(drives, every, push, batch.x, batch.dt, gains, start, substeps=batch.substeps)
    e = raw / (batch.noise * innovation_gain(gains))[None, :, None] * batch.valid[None]
    return jnp.split(e, np.cumsum([len(own) for own in vectors])[:-1])


@eqx.filter_jit
def _fine(posterior: Posterior, vector: Float[Array, " q"], e: Float[Array, "r n"]) -> Float[Array, "r n"]:
    drive = posterior.drive_of(vector)
    fine = posterior.recordings.standardised(drive, vector[posterior.parameters :], finer=_FINER)
    return jnp.where(jnp.isfinite(fine), fine, e)


@eqx.filter_jit
def _weighing(
    power: Float[Array, "r b"],
    scale: Float[Array, ""],
    e: Float[Array, "r n"],
    fine: Float[Array, "r n"],
    jacobian: Float[Array, "q r n"],
    weights: Float[Array, "r n"],
    prior: Float[Array, " q"],
) -> tuple[
    Float[Array, "r n"], Float[Array, "q m"], Float[Array, "q q"], Float[Array, " q"], Float[Array, "c q"]
]:
    block = e.shape[1] // power.shape[1]
    weight = jnp.repeat(1.0 / (power + scale), block, axis=-1) * weights
    weighted = jacobian * weight[None]
    base = weighted.reshape(jacobian.shape[0], -1)
    gram = base @ jacobian.reshape(jacobian.shape[0], -1).T + 0.5 * jnp.diag(prior**2)
    return weight, base, gram, base @ e.ravel(), sum_clusters(weighted * fine[None], block)


def present_model(posterior: Posterior, vector: Float[Array, " q"]) -> Present:
    """The model of a `posterior` at the fitted `vector`, linearised on its fitted recordings."""
    rows = np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
    # Evaluated with the held-out ones: that program is compiled already.
    evaluation = posterior.evaluated(vector)[0].of_recordings(rows)
    posterior, vector = posterior.of_fitted(vector)
    e, jacobian = evaluation.e, all_columns(evaluation)
    fine = _fine(posterior, vector, e)
    power = np.asarray(block_power(e, posterior.batch))
    used = power[np.asarray(posterior.batch.block_count) > 0]
    scales = dict.fromkeys((1.0, max(float(np.quantile(used, 0.7)), 1.0)))
    weighings = []
    for scale in scales:
        weight, base, *small = _weighing(
            jnp.asarray(power),
            jnp.asarray(scale),
            e,
            fine,
            jacobian,
            posterior.sample_weight,
            posterior.prior,
        )
        weighings.append(Weighing(weight, base, *(np.asarray(part) for part in small)))
    drive, samples = posterior.drive_of(vector), float(jnp.sum(posterior.batch.valid))
    recordings, motion = posterior.recordings, None
    if isinstance(recordings, Observed):
        motion = _motion(drive, vector[posterior.parameters :], recordings.batch, recordings.gains)
    misfit = misfit_of(power, np.asarray(posterior.fitted[0]), posterior.batch)
    return Present(posterior, vector, drive, e, fine, tuple(weighings), misfit, samples, motion)
