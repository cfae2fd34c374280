"""`simulate`: free run of a drive on a sampled input, with fixed steps."""

import dataclasses
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int, Real

from frictionjax.core import public_verb, require_x64
from frictionjax.core.display import SIGNALS, AbstractDisplayed, Display, TextGrid, signal_row
from frictionjax.core.frames import to_dataframe, to_xarray
from frictionjax.core.programs import Jitted
from frictionjax.core.safe import real
from frictionjax.physics import Drive, mean_of
from frictionjax.physics.effects import Before
from frictionjax.simulation.ros2 import DriveState, Substeps, advance
from frictionjax.simulation.samples import scan_samples


class Trajectory(AbstractDisplayed):
    """A simulated experiment; arrays have shape `(n,)` (`z`: `(n, bristles)`), values at the sample instants.

    **Attributes:** `t` (s), `x` (position), `v` (position/s), `z` (deflection of each bristle, position),
    `friction` (opposing force: friction (1) and the force effects, force), `measured` (output of the position sensor:
    `x` as modified by effects on the sensor, without noise or quantisation); `substeps` (steps per sample),
    `error` (estimated largest error of `x`, position; None unless `substeps` was `"auto"`); `u` (input that a
    controller gave, input units; None in an open loop).
    """

    t: Float[Array, " n"]
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    z: Float[Array, "n bristles"]
    friction: Float[Array, " n"]
    measured: Float[Array, " n"]
    substeps: int | None = eqx.field(static=True, default=None)
    error: float | None = eqx.field(static=True, default=None)
    u: Float[Array, " n"] | None = None

    def _display(self) -> Display:
        rows = [("t", self.t, "s"), ("x", self.x, "position"), ("v", self.v, "position/s")]
        rows += [("z", self.z, "position"), ("friction", self.friction, "force")]
        rows += [("measured", self.measured, "position")]
        rows += [] if self.u is None else [("u", self.u, "input")]
        title = f"Trajectory of {self.t.shape[-1]} samples"
        return Display(title, (), (TextGrid(SIGNALS, tuple(signal_row(*row) for row in rows)),))

    def plot(self, **how: Any) -> Any:
        """Draw position, velocity and friction force over time: `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame over `t`: `x`, `v`, `friction`, `measured`, and `z1`, `z2`, ... for the bristles."""
        bristles = {f"z{k + 1}": self.z[:, k] for k in range(self.z.shape[1])}
        signals = {name: getattr(self, name) for name in self._signals()}
        return to_dataframe({"t": self.t, **signals, **bristles}, {"t": "s", **_UNITS}, index="t")

    def to_xarray(self) -> Any:
        """An xarray Dataset over `t`, with `z` over `bristle`, too."""
        arrays = {name: (("t",), getattr(self, name)) for name in self._signals()}
        coordinates = {"t": self.t, "bristle": range(self.z.shape[1])}
        units = {name: _UNITS[name] for name in arrays}
        return to_xarray(
            {**arrays, "z": (("t", "bristle"), self.z)}, coordinates, {"t": "s", **units, "z": "position"}
        )

    def _signals(self) -> tuple[str, ...]:
        return ("x", "v", "friction", "measured", *(() if self.u is None else ("u",)))


_UNITS = {"x": "position", "v": "position/s", "friction": "force", "measured": "position", "u": "input"}


Start = (
    tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]
    | tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""], Before]
)
"""Position, velocity and bristle deflection at the first sample, and the history before it where that is known."""


def initial_state(
    drive: Drive,
    x0: Float[Array, ""],
    v0: Float[Array, ""],
    z0: Float[Array, ""],
    before: Before | None = None,
) -> DriveState:
    """State of `drive` at the first sample; every bristle starts at deflection `z0`, and states of effects follow from
    the history `before` (None: a second of rest)."""
    hidden = drive.initial_states(Before() if before is None else before)
    return DriveState(x0, v0, jnp.asarray(z0), z0 * jnp.ones(drive.bristle_count - 1), hidden)


def state_at(drive: Drive, start: Start) -> DriveState:
    """`initial_state` of `drive` for a `start`."""
    before = start[3] if len(start) == 4 else None
    return initial_state(drive, start[0], start[1], start[2], before)


_MOST_STEPS = 256


def run_free(
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    start: Start,
    substeps: Substeps,
    samples: Int[Array, ""] | None = None,
    unmeasured: Float[Array, " n"] | None = None,
) -> Trajectory:
    """Free run of `drive`, for use inside compiled functions.

    **Arguments:** `u`: input, shape `(n,)`; `dt`: s per sample; `start`: state at the first sample; `substeps`: steps
    per sample; `samples`: as in `scan_samples`; `unmeasured`: a force beside that of the motor, held over each sample,
    force units, shape `(n,)`; None: none.
    """
    bristles = drive.bristles()

    def sample(state, force):
        return advance(drive, bristles, state, force, dt, substeps), state

    push = drive.applied_force(u, dt)
    if unmeasured is not None:
        push = push + unmeasured
    run = scan_samples(sample, state_at(drive, start), push, samples)
    return trajectory_of(drive, run, mean_of(push), dt, substeps)


def trajectory_of(
    drive: Drive, run: DriveState, push: Float[Array, " n"], dt: Float[Array, ""], substeps: Substeps
) -> Trajectory:
    """The trajectory of `drive` whose states are a `run`, arrays of shape `(n, ...)`, under motor forces of mean
    `push`, shape `(n,)`."""
    bristles = drive.bristles()

    def friction_of(state, push):
        return drive.friction_force(bristles, state.x, state.v, state.z, dt, state.hidden, push)[0]

    # After the run, vectorised over the samples: inside the loop it would take longer.
    friction = jax.vmap(friction_of)(run, push)
    t = jnp.arange(push.shape[0], dtype=push.dtype) * dt
    measured = jax.vmap(drive.measured)(run.x, t, run.hidden)
    steps = substeps if isinstance(substeps, int) else None
    return Trajectory(t, run.x, run.v, run.z, friction, measured, steps)


@Jitted
def _simulate(
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    x0: Float[Array, ""],
    v0: Float[Array, ""],
    z0: Float[Array, ""],
    substeps: int,
    before: Before | None = None,
) -> Trajectory:
    start = (x0, v0, z0) if before is None else (x0, v0, z0, before)
    return run_free(drive, u, dt, start, substeps)


def simulate(
    drive: Drive,
    u: Real[ArrayLike, "..."],
    sample_rate: Real[ArrayLike, ""],
    *,
    x0: Real[ArrayLike, ""] = 0.0,
    v0: Real[ArrayLike, ""] = 0.0,
    z0: Real[ArrayLike, ""] = 0.0,
    substeps: int | Literal["auto"] = 2,
    encoder_step: float | None = None,
    tolerance: float | None = None,
    before: Before | None = None,
) -> Trajectory:
    """Simulate `drive` on the sampled input `u`, held between samples. Works under jit, vmap and grad.

    Second-order Rosenbrock scheme (see `frictionjax.simulation.ros2`), `substeps` equal steps a sample.

    **Arguments:**

    - `drive`: the `Drive`.
    - `u`: input, shape `(n,)`, input units.
    - `sample_rate`: samples per second.
    - `x0`, `v0`, `z0`: position, velocity and bristle deflection at the first sample.
    - `substeps`: steps per sample. In a fit at 2 kHz, 1 biases vs by 17 %, 2 by 3 % and 4 by less than 1 %
        (`python -m benchmarks accuracy`). `"auto"`: doubled until the largest error of the position, estimated from
        the last doubling, is below `tolerance`.
    - `encoder_step`: quantum of the position sensor, position units; a tenth of it is the default of `tolerance`.
    - `tolerance`: admissible error of the position, position units.
    - `before`: history before the first sample, for effects with memory (dwell, warm-up).

    **Returns:**

    A `Trajectory`, whose first sample is the initial state.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when `u` is not one-dimensional, or when `"auto"` has
    no tolerance, cannot reach it, or is asked for inside a compiled function.
    """
    require_x64()
    u = real(u)
    if u.ndim != 1:
        raise ValueError(
            f"`u` has shape {u.shape}; `simulate` takes one input of shape (n,). Batch with jax.vmap."
        )
    start = (real(x0), real(v0), real(z0))
    before = Before() if before is None else before
    if substeps == "auto":
        if tolerance is None and encoder_step is not None:
            tolerance = 0.1 * encoder_step
        return _refined(drive, u, 1.0 / real(sample_rate), start, tolerance, before)
    return _simulate(drive, u, 1.0 / real(sample_rate), *start, int(substeps), before)


def _refined(
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    start: tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]],
    tolerance: float | None,
    before: Before,
) -> Trajectory:
    """Double the steps until the error, 4/3 of the difference of two second-order runs, is below `tolerance`."""
    if tolerance is None or not tolerance > 0.0:
        raise ValueError(
            '`substeps="auto"` needs a positive `encoder_step` or `tolerance`, in position units.'
        )
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((drive, u, dt, start))):
        raise ValueError(
            '`substeps="auto"` needs concrete numbers: call it once outside jit, vmap and grad, and pass the '
            "number of steps that it finds."
        )
    x0, v0, z0 = start
    coarse = _simulate(drive, u, dt, x0, v0, z0, 1, before)
    error = jnp.inf
    steps = 1
    while steps < _MOST_STEPS:
        fine = _simulate(drive, u, dt, x0, v0, z0, 2 * steps, before)
        error = 4.0 / 3.0 * float(jnp.max(jnp.abs(fine.x - coarse.x)))
        if error < tolerance:
            return dataclasses.replace(coarse, substeps=steps, error=error)
        coarse, steps = fine, 2 * steps
    raise ValueError(
        f"{_MOST_STEPS} steps a sample leave an error of {error / 4.0:.2g}, more than the tolerance {tolerance:.2g}. "
        "Repeated stick-slip amplifies every error: raise `tolerance`, or shorten the run."
    )
