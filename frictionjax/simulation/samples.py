"""`scan_samples`: a loop along the samples of a recording, whose number may be a number of the case.

`jax.lax.scan` runs along all of its inputs, so that each length of a recording is a program of its own, to be traced,
lowered and compiled. Recordings are therefore padded to a few lengths, and the loop ends where the longest of them
does.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree

CHUNK = 64
"""Samples that are taken from the inputs, and written to the outputs, at once; padded lengths are multiples of it.

The states and outputs of so many samples stay in the first cache, and outputs of many lanes are written lane by lane.
"""


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
    - `samples`: how many of the n are to be run; outputs after these (and those up to the next multiple of `CHUNK`) are
      zero. Then n must be a multiple of `CHUNK`, and there is no reverse-mode derivative. None: all.
    """
    if samples is None:
        return jax.lax.scan(step, begin, inputs)[1]
    length = jax.tree.leaves(inputs)[0].shape[0]
    first = jax.tree.map(lambda leaf: leaf[0], inputs)
    shapes = jax.eval_shape(lambda state, now: step(state, now)[1], begin, first)
    empty = jax.tree.map(lambda one: jnp.zeros((length, *one.shape), one.dtype), shapes)

    def chunk(carry):
        place, state, outputs = carry
        some = jax.tree.map(lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, place, CHUNK), inputs)
        state, found = jax.lax.scan(step, state, some)
        outputs = jax.tree.map(
            lambda whole, own: jax.lax.dynamic_update_slice_in_dim(whole, own, place, 0), outputs, found
        )
        return place + CHUNK, state, outputs

    begin = (jnp.zeros((), samples.dtype), begin, empty)
    return jax.lax.while_loop(lambda carry: carry[0] < samples, chunk, begin)[2]
