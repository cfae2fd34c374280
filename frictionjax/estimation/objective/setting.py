"""What a fit of the diagnosis needs beside its free vector, and the errors and derivatives at that vector."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.evidence.residuals import standardised
from frictionjax.estimation.parameters import Free, unpack
from frictionjax.physics import Drive
from frictionjax.simulation import Gains


class Setting(eqx.Module):
    """Everything a residual needs beside the free vector.

    **Attributes:** `drive` (fixed parameters and structure), `batch`, `gains`, `weight` (1 where a fit of the
    diagnosis sees the sample, else 0, shape `(r, n)`), `start` and `prior` (centre and inverse standard deviation of
    the weak prior, shape `(p + r,)`).
    """

    drive: Drive
    batch: AbstractBatch
    gains: Gains
    weight: Float[Array, "r n"]
    start: Float[Array, " q"]
    prior: Float[Array, " q"]


def predicted_errors(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> Float[Array, "r n"]:
    """Standardised innovations, shape `(r, n)`, for the free vector of shape `(q,)`, q = p + r: p parameters, then
    the starting deflection of the bristle in each recording (over Fs/sigma0)."""
    count = len(layout)
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
    return standardised(drive, vector[count:], setting.batch, setting.gains)


def drives_at(layout: tuple[Free, ...], vectors: Float[Array, "k q"], setting: Setting) -> Drive:
    """The `Drive` of each of the free `vectors`: leaves of shape `(k, ...)`; inside compiled functions."""
    count = len(layout)
    return jax.vmap(lambda own: unpack(layout, setting.drive, own, setting.start[:count]))(vectors[:, :count])


def compact_jacobian(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> tuple[Float[Array, "r n"], Float[Array, "p1 r n"]]:
    """Standardised innovations and their forward-mode Jacobian by the p parameters and, last, of each recording by its
    own starting deflection, shape `(p + 1, r, n)`: it moves no other, so one column serves all of them."""
    count = len(layout)
    basis = jnp.eye(count + 1, vector.shape[0]).at[count, count:].set(1.0)
    return jax.vmap(
        lambda tangent: jax.jvp(lambda q: predicted_errors(layout, q, setting), (vector,), (tangent,)),
        out_axes=(None, 0),
    )(basis)


def all_columns(compact: Float[Array, "p1 r n"]) -> Float[Array, "q r n"]:
    """The Jacobian by all q = p + r free coordinates, of a `compact_jacobian`."""
    own = jnp.eye(compact.shape[1])[:, :, None] * compact[-1][None]
    return jnp.concatenate([compact[:-1], own])
