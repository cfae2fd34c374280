"""Recordings of a simulated machine at the inputs, rates and noise of recordings that were made.

The input is applied as it was recorded, in closed loops, too: the simulated machine has no controller, and may end its
moves elsewhere. An imposed motion stays as it is, and the force is simulated.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.core import InputError
from frictionjax.core.programs import Jitted
from frictionjax.estimation.data.batch import AbstractBatch, Batch, make_batch
from frictionjax.estimation.data.imposed_batch import ImposedBatch, make_imposed_batch
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.recordings import Recording
from frictionjax.simulation import sensor_noise
from frictionjax.simulation.fixed import run_free

_FINER = 8  # integration steps, for each of a fit: those at which parameters are reported


class Conditions(eqx.Module):
    """How recordings were made: what a simulated machine is measured with.

    **Attributes:** `recordings` (whose inputs are applied, or motions imposed), `batch` (the same in arrays: rates,
    starts, noise), `force` (root mean square of the unmeasured force, constant over each sample, force units),
    `encoder_step` (position units; zero: unknown).
    """

    recordings: tuple[Recording, ...]
    batch: AbstractBatch
    force: float = eqx.field(static=True)
    encoder_step: float = eqx.field(static=True)


def conditions_of(recordings: Sequence[Recording], *, force: float, encoder_step: float | None) -> Conditions:
    """The conditions of `recordings`, all force-driven or all of an imposed motion; `force` and `encoder_step` as in
    `Conditions`, the latter None where it is unknown."""
    some = tuple(recordings)
    if some[0].drive == "motion":
        return Conditions(some, make_imposed_batch(some), force, 0.0)
    return Conditions(some, make_batch(some, encoder_step=encoder_step), force, encoder_step or 0.0)


def recordings_like(
    conditions: Conditions,
    drive: Drive,
    deflection: Float[np.ndarray, " r"],
    rng: np.random.Generator,
) -> tuple[Recording, ...]:
    """What the recordings would be if `drive` had been the machine, with noise of its own.

    **Arguments:**

    - `conditions`: how they were made.
    - `drive`: the machine.
    - `deflection`: of the bristle at the first sample of each, over Fs/sigma0, shape `(r,)`.
    - `rng`: of the sensor's noise and the unmeasured force.

    **Returns:** one recording for each, in the same order, without measured velocity but where it is the only measured
    channel.

    **Raises:** `InputError` where the machine runs away.
    """
    batch = conditions.batch
    z0 = np.asarray(deflection) * float(drive.friction.Fs / drive.friction.sigma0)
    noise = np.asarray(batch.noise)
    if isinstance(batch, ImposedBatch):
        answer = np.asarray(_forces(drive, batch, jnp.asarray(z0)))
        # The unmeasured force is measured with the friction here, and so is part of the noise of each recording.
        found = answer + noise[:, None] * rng.standard_normal(answer.shape)
        return tuple(
            _changed(one, found[row, : one.x.size], "force") for row, one in enumerate(conditions.recordings)
        )
    assert isinstance(batch, Batch)
    push = conditions.force * rng.standard_normal(np.asarray(batch.u).shape)
    start = (jnp.asarray(batch.x0), jnp.asarray(batch.v0), jnp.asarray(z0))
    steps = jnp.asarray(_FINER * batch.substeps)
    u, dt = jnp.asarray(batch.u), jnp.asarray(batch.dt)
    x = np.asarray(_positions(drive, u, jnp.asarray(push), dt, start, batch.before, steps))
    step = conditions.encoder_step
    white = np.sqrt(np.maximum(noise**2 - step**2 / 12.0, 0.0))
    found = x + white[:, None] * sensor_noise(rng.standard_normal(x.shape), np.asarray(batch.integrated))
    if step:
        found = step * np.round(found / step)
    return tuple(
        _changed(one, found[row, : one.x.size], "x") for row, one in enumerate(conditions.recordings)
    )


@Jitted
def _positions(
    drive: Drive,
    u: Float[Array, "r n"],
    push: Float[Array, "r n"],
    dt: Float[Array, " r"],
    start: tuple[Float[Array, " r"], Float[Array, " r"], Float[Array, " r"]],
    before: Before,
    substeps: Int[Array, ""],
) -> Float[Array, "r n"]:
    def one(
        u: Float[Array, " n"],
        push: Float[Array, " n"],
        dt: Float[Array, ""],
        x0: Float[Array, ""],
        v0: Float[Array, ""],
        z0: Float[Array, ""],
        before: Before,
    ) -> Float[Array, " n"]:
        return run_free(drive, u, dt, (x0, v0, z0, before), substeps, unmeasured=push).measured

    return jax.vmap(one)(u, push, dt, *start, before)


@Jitted
def _forces(drive: Drive, batch: ImposedBatch, z0: Float[Array, " r"]) -> Float[Array, "r n"]:
    return batch.along(drive, z0)[2]


def _changed(one: Recording, answer: Float[np.ndarray, " n"], channel: str) -> Recording:
    if not np.all(np.isfinite(answer)):
        raise InputError(
            "the simulated machine runs away at this input",
            place=f"recording {one.name}",
            cure="Leave it out",
        )
    # Differences of an integrated velocity have its noise, white.
    v = np.diff(answer, prepend=answer[0]) * one.sample_rate if one.integrated else None
    # The input no longer answers to what is measured.
    changed: dict[str, Any] = {channel: answer}
    return dataclasses.replace(one, v=v, warnings=(), loop="open", **changed)
