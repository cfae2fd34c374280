"""The fitted model, linearised for the tests of effects: innovations, weighted Jacobian, effects injected into it."""

import dataclasses
from collections.abc import Iterable, Iterator, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.core.programs import compiled
from frictionjax.diagnosis.screening.imposed_effects import errors_with_effect
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.pieces import Piece, padded_lanes, put_together
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.evidence.power import block_power, sum_clusters
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.model import ParametricModel
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import all_columns
from frictionjax.physics import Drive, LuGre, Push
from frictionjax.physics.effects import AbstractEffect, Before
from frictionjax.simulation import ObserverGains, observe
from frictionjax.simulation.fixed import Start
from frictionjax.simulation.injected import (
    ModelVariables,
    Signals,
    along,
    force_signals,
    injected_innovations,
    signals_along,
)
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

    weight: Float[np.ndarray, "r n"]
    base: Float[np.ndarray, "q m"]
    gram: Float[np.ndarray, "q q"]
    right: Float[np.ndarray, " q"]
    clusters: Float[np.ndarray, "c q"]


class Present(PlainMethods, eqx.Module):
    """The model to which effects are added, with the fitted recordings alone.

    **Attributes:** its `posterior`, the fitted `vector` and the `drive` there, `e` (innovations, shape `(r, n)`),
    `fine` (the same at finer integration steps: these are tested, since the integration error of few steps, a fraction
    of the noise, is significant in long recordings), `weighings` (one for each scale of the loss), `misfit`, `samples`
    (number scored), `motion` (states and forces along the observed motion, piece by piece; None where the motion is
    imposed).
    """

    posterior: Posterior
    vector: Float[np.ndarray, " q"]
    drive: Drive
    e: Float[np.ndarray, "r n"]
    fine: Float[np.ndarray, "r n"]
    weighings: tuple[Weighing, ...]
    misfit: float
    samples: float
    motion: list[ModelVariables] | None

    def lanes(
        self, blocks: Iterable[tuple[Sequence[Posterior], Sequence[Float[Numbers, " _"]]]]
    ) -> Iterator[Float[np.ndarray, "lanes r n"]]:
        """Standardised innovations of this model with one more effect, for each of the `blocks`: posteriors of one
        layout and as many vectors. The signals of the effect along the observed motion are injected. A block has
        `BESIDE` lanes or more; copies of its last vector fill the rest. Where the motion is imposed the model with the
        effect is simulated itself."""
        ready: list[tuple[Float[np.ndarray, "k q"], list[Signals]]] = []
        for posteriors, vectors in blocks:
            filled = [*vectors, *[vectors[-1]] * (BESIDE - len(vectors))]
            posteriors = [*posteriors, *[posteriors[-1]] * (BESIDE - len(posteriors))]
            if self.motion is None:
                yield errors_with_effect(posteriors, filled)
                continue
            ready.append(self._ready(posteriors, filled))
            if len(ready) == _TOGETHER:
                # Only effects with many strengths have blocks of another shape.
                alike = len({str(jax.tree.map(np.shape, block)) for block in ready}) == 1
                run = _TOGETHER if alike else 1
                yield from self._run(ready[:run])
                ready = ready[run:]
        for block in ready:
            yield from self._run([block])

    def _ready(
        self, posteriors: Sequence[Posterior], vectors: Sequence[Float[Numbers, " longer"]]
    ) -> tuple[Float[np.ndarray, "k q"], list[Signals]]:
        """The `vectors` without the coordinates of the effect, and the signals of the effect at each of them, piece by
        piece."""
        assert self.motion is not None
        old, more = len(self.posterior.layout), len(posteriors[0].layout)
        effects = _effects_at(posteriors, vectors)
        model = (self.drive.friction, self.drive.J, self.drive.motor_constant)
        recordings = self.posterior.recordings
        assert isinstance(recordings, Observed)
        signals = [
            _signals_in(effects, model, motion, piece, part.batch)
            for motion, (piece, part) in zip(self.motion, recordings.in_pieces(), strict=True)
        ]
        stack = np.stack([np.asarray(vector) for vector in vectors])
        return np.concatenate([stack[:, :old], stack[:, more:]], axis=1), signals

    def _run(
        self, blocks: list[tuple[Float[np.ndarray, "k q"], list[Signals]]]
    ) -> list[Float[np.ndarray, "lanes r n"]]:
        """Innovations of each of the `blocks`. One compiled program serves all: it runs `_TOGETHER` of them, the last
        one repeated where there are fewer."""
        assert self.motion is not None
        filled = [*blocks, *[blocks[-1]] * (_TOGETHER - len(blocks))]
        vectors = np.concatenate([own for own, _ in filled])
        recordings, count, found = self.posterior.recordings, self.posterior.parameters, []
        assert isinstance(recordings, Observed)
        parts = zip(recordings.in_pieces(), self.motion, strict=True)
        for place, ((piece, observed), motion) in enumerate(parts):
            signals = tuple(own[place] for _, own in filled)
            push, z0 = Push(motion.push, motion.rise), vectors[:, count:][:, piece.lanes]
            e = _injected_lanes(self.posterior.model, observed, vectors[:, :count], z0, push, signals)
            found.append((piece, e))
        errors = put_together(found, recordings.rows, recordings.samples, axis=1)
        return np.split(errors, np.cumsum([len(own) for own, _ in filled])[:-1])[: len(blocks)]

    def with_forces(
        self, vectors: Float[np.ndarray, "k q"], forces: Float[np.ndarray, "k r n"]
    ) -> Float[np.ndarray, "k r n"]:
        """Standardised innovations of this model at each of the `vectors` with an opposing force of its own along each
        recording, force units. The motion must not be imposed."""
        recordings, found = self.posterior.recordings, []
        assert isinstance(recordings, Observed)
        for first in range(0, len(vectors), BESIDE * _TOGETHER):
            some = vectors[first : first + BESIDE * _TOGETHER]
            few = np.concatenate([np.arange(len(some)), np.repeat(len(some) - 1, -len(some) % BESIDE)])
            blocks = []
            for own in few.reshape(-1, BESIDE) + first:
                signals = [
                    force_signals(padded_lanes(forces[own], piece)) for piece, _ in recordings.in_pieces()
                ]
                blocks.append((vectors[own], signals))
            found.append(np.concatenate(self._run(blocks))[: len(some)])
        return np.concatenate(found)

    def injected(
        self, posteriors: Sequence[Posterior], vectors: Sequence[Float[Numbers, " q"]]
    ) -> Float[np.ndarray, "k r n"]:
        """`lanes` for any number of `vectors` of one effect, with as many `posteriors`, shape `(k, r, n)`."""
        parts = [slice(first, first + BESIDE) for first in range(0, len(vectors), BESIDE)]
        found = self.lanes((posteriors[part], vectors[part]) for part in parts)
        return np.concatenate(list(found))[: len(vectors)]


def _effects_at(posteriors: Sequence[Posterior], vectors: Sequence[Float[Numbers, " q"]]) -> AbstractEffect:
    """The last effect of each of the `posteriors` at a free vector, as one with leaves of shape `(k,)`."""
    drive = posteriors[0].drive
    effect, place = drive.effects[-1], len(drive.effects) - 1
    stack, values = np.stack([np.asarray(vector) for vector in vectors]), {}
    for index, free in enumerate(posteriors[0].layout):
        if not free.path.startswith(f"effects.{place}."):
            continue
        parameter, coordinate = free.parameter, stack[:, index]
        scale = np.array([float(one.layout[index].scale) for one in posteriors])
        value = np.exp(coordinate) if parameter.transform == "log" else coordinate * scale
        values[parameter.name] = np.clip(value, parameter.lower, parameter.upper)
    for field in dataclasses.fields(effect):
        if field.name not in values:
            own = [float(getattr(one.drive.effects[-1], field.name)) for one in posteriors]
            values[field.name] = np.array(own)
    # As they are: the effect's own converters would make arrays of JAX of them, one by one.
    return jax.tree.unflatten(
        jax.tree.structure(effect), [values[f.name] for f in dataclasses.fields(effect)]
    )


@compiled()
def _motion(
    drive: Drive, deflection: Float[Numbers, " w"], batch: Batch, gains: ObserverGains
) -> ModelVariables:
    def one(
        u: Float[Numbers, " n"],
        x: Float[Numbers, " n"],
        dt: Float[Numbers, ""],
        gains: ObserverGains,
        start: Start,
    ) -> ModelVariables:
        force, steps, samples = drive.applied_force(u, dt), batch.steps, batch.samples
        observed = observe(drive, force, x, dt, gains, start, substeps=steps, samples=samples)
        return along(drive, corrected_states(drive, observed, gains), u, dt)

    return batch.each(one, gains, deflection * drive.friction.Fs / drive.friction.sigma0)


def _signals_in(
    effects: AbstractEffect,
    model: tuple[LuGre, Float[Numbers, ""], Float[Numbers, ""]],
    motion: ModelVariables,
    piece: Piece,
    batch: Batch,
) -> Signals:
    """Signals of the `effects` in a `piece` of recordings, its `batch`, by its own `motion`; leaves of shape
    `(k, w, ...)`. One recording after the other: there is a program for each form, but not for each width."""
    found = []
    for row in range(piece.rows.size):
        known, dt, before = jax.tree.map(
            lambda leaf, row=row: np.asarray(np.asarray(leaf)[row]), (motion, batch.dt, batch.before)
        )
        found.append(_signals(effects, model, known, dt, before, batch.samples))
    found += [found[-1]] * (piece.lanes.size - piece.rows.size)
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves], axis=1), *found)


@compiled()
def _signals(
    effects: AbstractEffect,
    model: tuple[LuGre, Float[Numbers, ""], Float[Numbers, ""]],
    known: ModelVariables,
    dt: Float[Numbers, ""],
    before: Before,
    samples: Int[Numbers, ""],
) -> Signals:
    # Nothing here depends on the effects of the model: each form is compiled once.
    def lane(effect: AbstractEffect) -> Signals:
        return signals_along(*model, effect, known, dt, before, samples)

    return jax.vmap(lane)(effects)


@compiled()
def _injected_lanes(
    model: ParametricModel,
    recordings: Observed,
    parameters: Float[Numbers, "k p"],
    z0: Float[Numbers, "k w"],
    push: Push,
    signals: tuple[Signals, ...],
) -> Float[Numbers, "k w n"]:
    batch = recordings.batch
    drives = jax.vmap(model.drive_of)(parameters)
    deflection = z0 * (drives.friction.Fs / drives.friction.sigma0)[:, None]
    start = (batch.x0, batch.v0, deflection, batch.before)
    every = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *signals)
    raw = injected_innovations(
        drives,
        every,
        push,
        batch.x,
        batch.dt,
        recordings.gains,
        start,
        substeps=batch.steps,
        samples=batch.samples,
    )
    return recordings.over_noise(raw)


def _weighing(
    power: Float[np.ndarray, "r b"],
    scale: float,
    e: Float[np.ndarray, "r n"],
    fine: Float[np.ndarray, "r n"],
    jacobian: Float[np.ndarray, "q r n"],
    weights: Float[np.ndarray, "r n"],
    prior: Float[np.ndarray, " q"],
) -> Weighing:
    block = e.shape[1] // power.shape[1]
    weight = np.repeat(1.0 / (power + scale), block, axis=-1) * weights
    weighted = jacobian * weight[None]
    base = weighted.reshape(jacobian.shape[0], -1)
    gram = base @ jacobian.reshape(jacobian.shape[0], -1).T + 0.5 * np.diag(prior**2)
    return Weighing(weight, base, gram, base @ e.ravel(), sum_clusters(weighted * fine[None], block))


def present_model(posterior: Posterior, vector: Float[Numbers, " q"]) -> Present:
    """The model of a `posterior` at the fitted `vector`, linearised on its fitted recordings."""
    rows = np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
    # Evaluated with the held-out ones: that program is compiled already.
    evaluation = posterior.evaluated(vector)[0].of_recordings(rows)
    posterior, vector = posterior.of_fitted(vector)
    e, jacobian = evaluation.e, all_columns(evaluation)
    fine = posterior.with_substeps(_FINER * posterior.batch.substeps).errors_at([vector])[0]
    fine = np.where(np.isfinite(fine), fine, e)
    power = block_power(e, posterior.batch)
    used = power[np.asarray(posterior.batch.block_count) > 0]
    scales = dict.fromkeys((1.0, max(float(np.quantile(used, 0.7)), 1.0)))
    weights, prior = posterior.sample_weight, np.asarray(posterior.prior)
    weighings = [_weighing(power, scale, e, fine, jacobian, weights, prior) for scale in scales]
    drive, samples = posterior.drive_of(vector), float(np.sum(posterior.batch.valid))
    recordings, motion = posterior.recordings, None
    if isinstance(recordings, Observed):
        z0, motion = vector[posterior.parameters :], []
        for piece, part in recordings.in_pieces():
            motion.append(_motion(drive, z0[piece.lanes], part.batch, part.gains))
    misfit = misfit_of(power, np.asarray(posterior.fitted[0]), posterior.batch)
    return Present(posterior, vector, drive, e, fine, tuple(weighings), misfit, samples, motion)
