"""How the demo's arm moves: play operators and one bristle, in an implicit step."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Real

from frictionjax.demo.arm import Arm

SAMPLE_RATE = 2000.0  # Hz, of the controller, of its output and of the recordings
SUBSTITUTIONS = 3


@dataclass(frozen=True)
class SimulatedMotion:
    """The simulated motion in `lanes` experiments side by side.

    **Attributes:**

    - `u`: voltage that was applied, held between samples, V, shape `(n, lanes)`.
    - `x`: true position at the samples, rad, shape `(n, lanes)`.
    - `v`: true velocity at the samples, rad/s, shape `(n, lanes)`.
    - `measured`: position as the encoder gives it, rad, shape `(n, lanes)`.
    """

    u: Float[np.ndarray, "n lanes"]
    x: Float[np.ndarray, "n lanes"]
    v: Float[np.ndarray, "n lanes"]
    measured: Float[np.ndarray, "n lanes"]


Numbers = dict[str, Float[Array, ""] | Float[Array, " elements"]]
"""The numbers of the arm by name; `yield_shares` has one for each element."""

State = tuple[
    Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, "elements lanes"], Float[Array, " lanes"]
]
"""Position, velocity, force of each element and deflection of the bristle."""


def _stribeck(p: Numbers, v: Float[Array, " lanes"]) -> Float[Array, " lanes"]:
    """Torque of steady sliding at velocity `v` without its viscous part, N*m."""
    return p["Fc"] + (p["Fs"] - p["Fc"]) * jnp.exp(-((v / p["vs"]) ** 2))


def _step(state: State, torque: Float[Array, " lanes"], p: Numbers, h: float) -> State:
    """One internal step of `h` seconds under a constant `torque`, shape `(lanes,)`.

    The mean velocity `w` over the step satisfies `J (w - v) = h / 2 (torque - friction(w))`, the trapezoidal rule,
    with `friction(w)` the mean friction over the step. Each element's force is carried by the displacement
    `h w` and clipped at its limit, which is exact for a play operator whatever the size of the displacement. The
    step is small enough (`h sigma1 << 2 J`) for `w` to be found by substitution: every pass gains two to three
    decimals, and settles which elements slip.
    """
    x, v, force, z = state
    # Torque per velocity of an element's spring over one step, and of its damper in units of the spring's change.
    spring, damper = p["sigma0"] * p["share"] * h / force.shape[0], p["sigma1"] / (p["sigma0"] * h)

    def friction(
        w: Float[Array, " lanes"],
    ) -> tuple[Float[Array, " lanes"], Float[Array, "elements lanes"], Float[Array, " lanes"]]:
        limit = p["yield_shares"][:, None] * _stribeck(p, 2.0 * w - v)[None, :]
        new_force = jnp.clip(force + spring * w[None, :], -limit, limit)
        slip = jnp.sum(0.5 * (force + new_force) + damper * (new_force - force), axis=0)
        # The bristle's equation z' = w - rate z is linear while w is constant: end value and mean are closed forms.
        rate = p["sigma0"] * jnp.abs(w) / _stribeck(p, w) + 1e-12
        decay = -jnp.expm1(-rate * h)
        new_z = z + (w / rate - z) * decay
        mean_z = w / rate + (z - w / rate) * decay / (rate * h)
        bristle = p["sigma0"] * mean_z + p["sigma1"] * (new_z - z) / h
        return slip + (1.0 - p["share"]) * bristle + p["sigma2"] * w, new_force, new_z

    w = v
    for _ in range(SUBSTITUTIONS):
        w = v + 0.5 * h / p["J"] * (torque - friction(w)[0])
    # Position, forces and deflection advance with the same w, so that loops close to the last digit.
    total, new_force, new_z = friction(w)
    return x + h * w, v + h / p["J"] * (torque - total), new_force, new_z


@partial(jax.jit, static_argnames="substeps")
def _scan(
    p: Numbers,
    volts: Float[Array, "n lanes"],
    reference: Float[Array, "n lanes"],
    noise: Float[Array, "n lanes"],
    kp: Float[Array, " lanes"],
    kd: Float[Array, " lanes"],
    substeps: int,
) -> tuple[
    Float[Array, "n lanes"], Float[Array, "n lanes"], Float[Array, "n lanes"], Float[Array, "n lanes"]
]:
    h = 1.0 / (SAMPLE_RATE * substeps)
    lanes = volts.shape[1]

    def sample(
        carry: tuple[State, Float[Array, " lanes"], Float[Array, " lanes"]],
        inputs: tuple[Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, " lanes"]],
    ) -> tuple[
        tuple[State, Float[Array, " lanes"], Float[Array, " lanes"]],
        tuple[Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, " lanes"]],
    ]:
        state, error, slope = carry
        volt, target, disturbance = inputs
        # The controller acts on the encoder's position without delay; the drive holds its output until the next
        # sample. Its derivative is filtered at 200 Hz: raw differences of encoder counts are too noisy.
        measured = jnp.round(state[0] / p["encoder_step"] + disturbance) * p["encoder_step"]
        new_error = target - measured
        blend = 1.0 - jnp.exp(-2.0 * jnp.pi * 200.0 / SAMPLE_RATE)
        slope = slope + blend * ((new_error - error) * SAMPLE_RATE - slope)
        u = volt + kp * new_error + kd * slope
        torque = p["motor_constant"] * u
        state_next = jax.lax.fori_loop(0, substeps, lambda _, s: _step(s, torque, p, h), state)
        return (state_next, new_error, slope), (u, state[0], state[1], measured)

    rest = jnp.zeros(lanes)
    start = (rest, rest, jnp.zeros((p["yield_shares"].shape[0], lanes)), rest)
    return jax.lax.scan(sample, (start, rest, rest), (volts, reference, noise))[1]


def move(
    arm: Arm,
    volts: Real[ArrayLike, "n lanes"],
    *,
    reference: Real[ArrayLike, "n lanes"] | None = None,
    noise: Real[ArrayLike, "n lanes"] | None = None,
    kp: Real[ArrayLike, " lanes"] | None = None,
    kd: Real[ArrayLike, " lanes"] | None = None,
    substeps: int = 20,
) -> SimulatedMotion:
    """Run experiments side by side, each from rest, from zero position and from unloaded friction.

    The equation of motion is `J x'' = motor_constant u - friction`, with
    `u = volts + kp (reference - measured) + kd d/dt (reference - measured)`.

    **Arguments:**

    - `arm`: the machine.
    - `volts`: input voltage, to which a controller adds, V, shape `(n, lanes)`.
    - `reference`: position for a controller to follow, rad, shape `(n, lanes)`; zero if left out.
    - `noise`: sensor noise before quantisation, in encoder steps, shape `(n, lanes)`; none if left out.
    - `kp`, `kd`: gains of the controller, V/rad and V*s/rad, shape `(lanes,)`; zero, an open loop, if left out.
    - `substeps`: internal steps per sample of 0.5 ms; 20 make 40 kHz.

    **Returns:** the `SimulatedMotion`.

    **Raises:** `RuntimeError` when JAX computes in float32.
    """
    if jnp.result_type(float) != jnp.float64:
        raise RuntimeError(
            "The demo's arm needs float64: a bristle moves nanometres while the arm turns by radians. "
            'Call `jax.config.update("jax_enable_x64", True)` before anything else that uses JAX.'
        )
    volts = jnp.asarray(volts, jnp.float64)
    still, open_loop = jnp.zeros_like(volts), jnp.zeros(volts.shape[1])
    numbers = ("motor_constant", "J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "share", "encoder_step")
    p = {name: jnp.asarray(getattr(arm, name), jnp.float64) for name in (*numbers, "yield_shares")}
    out = _scan(
        p,
        volts,
        still if reference is None else jnp.asarray(reference, jnp.float64),
        still if noise is None else jnp.asarray(noise, jnp.float64),
        open_loop if kp is None else jnp.asarray(kp, jnp.float64),
        open_loop if kd is None else jnp.asarray(kd, jnp.float64),
        substeps,
    )
    return SimulatedMotion(*(np.asarray(part) for part in out))
