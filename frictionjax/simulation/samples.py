"""`scan_samples`: a loop along the samples of a recording, whose number may be a number of the case.

`jax.lax.scan` runs along all of its inputs, so that each length of a recording is a program of its own, to be traced,
lowered and compiled. Recordings are therefore padded to a few lengths, and the loop ends where the longest of them
does.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree


def scan_samples(
    step: Callable[[PyTree, PyTree], tuple[PyTree, PyTree]],
    begin: PyTree,
    inputs: PyTree,
    samples: Int[Array, ""] | None = None,
) -> PyTree:
    """Outputs of `step`, which takes a state and the inputs of one sample to the next state and the outputs, stacked
    along the samples as by `jax.lax.scan`; for use inside compiled functions.

    **Arguments:**

    - `step`: (state, inputs) -> (state, outputs).
    - `begin`: the state at the first sample.
    - `inputs`: arrays of shape `(n, ...)`.
    - `samples`: how many of the n are to be run; later outputs are zero. There is then no reverse-mode derivative.
        None: all.
    """
    if samples is None:
        return jax.lax.scan(step, begin, inputs)[1]
    length = jax.tree.leaves(inputs)[0].shape[0]
    first = jax.tree.map(lambda leaf: leaf[0], inputs)
    shapes = jax.eval_shape(lambda state, now: step(state, now)[1], begin, first)
    empty = jax.tree.map(lambda one: jnp.zeros((length, *one.shape), one.dtype), shapes)

    def sample(carry: tuple[Int[Array, ""], PyTree, PyTree]) -> tuple[Int[Array, ""], PyTree, PyTree]:
        place, state, outputs = carry
        now = jax.tree.map(lambda leaf: jax.lax.dynamic_index_in_dim(leaf, place, keepdims=False), inputs)
        state, found = step(state, now)
        outputs = jax.tree.map(
            lambda whole, own: jax.lax.dynamic_update_index_in_dim(whole, own, place, 0), outputs, found
        )
        return place + 1, state, outputs

    begin = (jnp.zeros((), samples.dtype), begin, empty)
    return jax.lax.while_loop(lambda carry: carry[0] < samples, sample, begin)[2]
