"""`simulate_batch`: many drives at once, distributed over the devices in blocks that fit the cache."""

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, ArrayLike, Float, PyTree, Real

from frictionjax.core import Progress, require_x64, silent
from frictionjax.core.safe import real
from frictionjax.physics import Drive
from frictionjax.simulation.fixed import Trajectory, simulate

# Drives that go side by side on a CPU: enough to fill the vector units, few enough for the innermost cache.
_LANES = 64
_AXIS = "drives"


def position(run: Trajectory) -> Float[Array, " n"]:
    """The position of a run, shape `(n,)`: what `simulate_batch` returns by default."""
    return run.x


def simulate_batch(
    drives: Drive,
    u: Real[ArrayLike, "..."],
    sample_rate: Real[ArrayLike, ""],
    *,
    x0: Real[ArrayLike, ""] | Real[ArrayLike, " b"] = 0.0,
    v0: Real[ArrayLike, ""] | Real[ArrayLike, " b"] = 0.0,
    z0: Real[ArrayLike, ""] | Real[ArrayLike, " b"] = 0.0,
    substeps: int = 2,
    of: Callable[[Trajectory], Any] = position,
    memory: float = 2.0**30,
    progress: Progress = silent,
) -> Any:
    """Simulate `b` drives, by the scheme of `simulate`, on all devices: Monte Carlo, sweeps, starts.

    Arrays with a leading axis differ from drive to drive; the others are shared. Beyond `memory` the batch is divided
    into pieces, whose results are collected on the host. Inside jit, vmap or a derivative it is one piece on one
    device.
    Batches are several times faster after `configure_jax()`.

    **Arguments:**

    - `drives`: a `Drive` some of whose parameters have shape `(b,)`.
    - `u`: input, shape `(n,)` or `(b, n)`, input units.
    - `sample_rate`: samples per second.
    - `x0`, `v0`, `z0`: position, velocity and bristle deflection at the first sample; numbers, or shape `(b,)`.
    - `substeps`: steps per sample, see `simulate`.
    - `of`: what to keep of a run: a function of one drive's `Trajectory`. Only what it uses is computed, and only what
        it returns leaves the device. Pass the same function object each time: a new one is compiled again.
    - `memory`: bytes that the results of one piece may take.
    - `progress`: called with the fraction of drives that are done.

    **Returns:**

    What `of` returns, each array with a leading axis of `b`; numpy arrays (JAX arrays inside compiled functions).

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when nothing has a leading axis, when their lengths
    differ, or when the results are larger than the machine's memory.
    """
    require_x64()
    numbers, structure = eqx.partition(drives, eqx.is_array)
    run = (numbers, real(u), (real(x0), real(v0), real(z0)))
    batched = jax.tree.map(lambda leaf: leaf.ndim > 0, run)
    batched = eqx.tree_at(lambda tree: tree[1], batched, run[1].ndim > 1)
    count = _count(run, batched)
    flags = tuple(jax.tree.leaves(batched))
    place = len(jax.tree.leaves(numbers))
    how = _How(structure, jax.tree.structure(run), flags, place, int(substeps), of)
    dt = 1.0 / real(sample_rate)
    leaves = tuple(jax.tree.leaves(run))
    if any(isinstance(leaf, Tracer) for leaf in (*leaves, dt)):
        return _in_blocks(leaves, dt, how, -(-count // _LANES))
    devices = tuple(jax.local_devices(backend=jax.default_backend()))
    kept = _kept(
        how,
        tuple(leaf.shape[1:] if flag else leaf.shape for leaf, flag in zip(leaves, how.batched, strict=True)),
    )
    bytes_each = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(kept))
    _check_room(count * bytes_each)
    blocks, lanes = _cut(count, int(memory // max(bytes_each, 1)), devices)
    piece = blocks * lanes * len(devices)
    results = jax.tree.map(lambda leaf: np.empty((count, *leaf.shape), leaf.dtype), kept)
    shared, table = _packed(leaves, dt, how)
    for first in range(0, count, piece):
        # The last piece is padded with its last drive, so that all pieces share one compiled program.
        taken = np.minimum(np.arange(first, first + piece), count - 1)
        push = run[1][taken] if run[1].ndim > 1 and piece != count else run[1]
        found = _on_all(shared, table[:, taken], push, how, blocks, devices)
        last = min(first + piece, count)
        for whole, new in zip(jax.tree.leaves(results), jax.tree.leaves(found), strict=True):
            _collect(whole, first, last, new)
        progress("drives", last / count)
    return results


def _collect(whole: np.ndarray, first: int, last: int, new: Array) -> None:
    """Copy the shards of `new` into rows `first` to `last` of `whole`, all devices at once."""

    def copy(shard):
        begin = first + (shard.index[0].start or 0)
        some = np.asarray(shard.data)[: max(last - begin, 0)]
        whole[begin : begin + some.shape[0]] = some

    with ThreadPoolExecutor(len(new.addressable_shards)) as threads:
        list(threads.map(copy, new.addressable_shards))


def _packed(
    leaves: Sequence[Float[Array, "..."]], dt: Float[Array, ""], how: "_How"
) -> tuple[Float[np.ndarray, " shared"], Float[np.ndarray, "differing b"]]:
    """All shared numbers, dt first, and a table with a row for each number that differs: two arrays instead of the
    dozen of a drive, as each transfer to a device costs a tenth of a millisecond."""
    scalars, columns = [np.asarray(dt)], []
    for index, (leaf, flag) in enumerate(zip(leaves, how.batched, strict=True)):
        if index != how.input:
            (columns if flag else scalars).append(np.asarray(leaf))
    return np.stack(scalars), np.stack(columns) if columns else np.zeros((0, leaves[how.input].shape[0]))


def _unpacked(
    shared: Float[Array, " shared"],
    table: Float[Array, "differing b"],
    push: Float[Array, "..."],
    how: "_How",
) -> tuple[Float[Array, ""], tuple[Float[Array, "..."], ...]]:
    """The inverse of `_packed`: dt and the leaves."""
    scalars, columns = iter(shared), iter(table)
    dt = next(scalars)
    return dt, tuple(
        push if index == how.input else next(columns if flag else scalars)
        for index, flag in enumerate(how.batched)
    )


class _How(eqx.Module):
    """The static part of a batch: `drive` without its arrays, the `tree` of the leaves, which of them are `batched`,
    which is the `input`, `substeps`, and `of`."""

    drive: Drive
    tree: Any = eqx.field(static=True)
    batched: tuple[bool, ...] = eqx.field(static=True)
    input: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    of: Callable[[Trajectory], Any] = eqx.field(static=True)


def _count(run: tuple[PyTree, Float[Array, "..."], PyTree], batched: PyTree) -> int:
    """Number of drives."""
    lengths = {
        leaf.shape[0]
        for leaf, flag in zip(jax.tree.leaves(run), jax.tree.leaves(batched), strict=True)
        if flag
    }
    if run[1].ndim not in (1, 2):
        raise ValueError(f"`u` has shape {run[1].shape}; it must be (n,), shared, or (b, n).")
    if not lengths:
        raise ValueError(
            "Nothing differs from drive to drive: give a parameter, a start or `u` a leading axis, or use `simulate`."
        )
    if len(lengths) > 1:
        raise ValueError(
            f"The leading axes have lengths {sorted(lengths)}; all that differ must have one length."
        )
    return lengths.pop()


def _check_room(needed: int) -> None:
    """Refuse results larger than the machine's memory, where the system reports its size."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return
    room = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > room:
        raise ValueError(
            f"The results take {needed / 2**30:.3g} GiB, and this machine has {room / 2**30:.3g}: let `of` return less "
            "of a run, such as its last position or its mean square error, or simulate part of the drives."
        )


def _cut(count: int, most: int, devices: tuple[Any, ...]) -> tuple[int, int]:
    """Blocks per device and drives per block of one piece of at most about `most` drives."""
    share = -(-min(count, max(most, 1)) // len(devices))
    # A GPU simulates all of its share at once; a CPU as many as fit its cache.
    blocks = -(-share // _LANES) if devices[0].platform == "cpu" else 1
    return blocks, -(-share // blocks)


def _single(leaves: Sequence[Float[Array, "..."]], dt: Float[Array, ""], how: _How) -> Any:
    """The result of one drive."""
    numbers, u, (x0, v0, z0) = jax.tree.unflatten(how.tree, leaves)
    drive = eqx.combine(numbers, how.drive)
    return how.of(simulate(drive, u, 1.0 / dt, x0=x0, v0=v0, z0=z0, substeps=how.substeps))


@functools.lru_cache(maxsize=256)
def _kept(how: _How, shapes: tuple[tuple[int, ...], ...]) -> Any:
    """Shapes and types of the result of one drive, cached: tracing at every call would cost more than a small batch."""
    leaves, dt = [jax.ShapeDtypeStruct(shape, float) for shape in shapes], jax.ShapeDtypeStruct((), float)
    return jax.eval_shape(lambda leaves, dt: _single(leaves, dt, how), leaves, dt)


def _in_blocks(leaves: Sequence[Float[Array, "..."]], dt: Float[Array, ""], how: _How, blocks: int) -> Any:
    """The results of all drives, one block after the other."""
    split = [leaf for leaf, flag in zip(leaves, how.batched, strict=True) if flag]
    count = split[0].shape[0]
    lanes = -(-count // blocks)
    spare = blocks * lanes - count

    def block(part):
        rest = iter(part)
        mixed = [next(rest) if flag else leaf for leaf, flag in zip(leaves, how.batched, strict=True)]
        axes = [0 if flag else None for flag in how.batched]
        return jax.vmap(lambda leaves: _single(leaves, dt, how), in_axes=(axes,))(mixed)

    if blocks == 1:
        return block(split)
    padded = [jnp.concatenate([leaf, jnp.repeat(leaf[-1:], spare, axis=0)]) for leaf in split]
    found = jax.lax.map(block, [leaf.reshape(blocks, lanes, *leaf.shape[1:]) for leaf in padded])
    return jax.tree.map(lambda leaf: leaf.reshape(blocks * lanes, *leaf.shape[2:])[:count], found)


@eqx.filter_jit
def _on_all(
    shared: Float[Array | np.ndarray, " shared"],
    table: Float[Array | np.ndarray, "differing b"],
    push: Float[Array, "..."],
    how: _How,
    blocks: int,
    devices: tuple[Any, ...],
) -> Any:
    """`_in_blocks` on every device, for its share of the drives."""

    def share(shared, table, push):
        dt, leaves = _unpacked(shared, table, push, how)
        return _in_blocks(leaves, dt, how, blocks)

    rows = PartitionSpec(_AXIS) if how.batched[how.input] else PartitionSpec()
    return jax.shard_map(
        share,
        mesh=Mesh(np.array(devices), (_AXIS,)),
        in_specs=(PartitionSpec(), PartitionSpec(None, _AXIS), rows),
        out_specs=PartitionSpec(_AXIS),
        check_vma=False,
    )(shared, table, push)
