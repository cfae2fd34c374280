"""A rotating arm like that of the paper's Fig. 3. Its code shares nothing with the models that are fitted to it.

What the paper says of its rig is kept: 10 kHz, 16 N m/V, a gear of 8.192, a static friction of 0.0389 V, a second-order
answer up to 150 Hz and more above it. Its Tables II and III and its estimates are lost: all other values are ours.
"""

import math
from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Real

from frictionjax.core import InputError, require_x64

SAMPLE_RATE = 10_000.0  # Hz, the paper's
GEAR = 8.192  # motor turns per arm turn, the paper's
COUNTS_PER_MOTOR_TURN = 80_000  # ours: 2000 lines, interpolated 40 times; 655 360 a turn of the arm
ELEMENTS = 12
_SUBSTITUTIONS = 3


class Twin(eqx.Module):
    """A motor with friction and an encoder, and behind its gear a spring and the arm; all referred to the arm.

    The friction torque at the motor is that of a bristle, a share of which may be replaced by parallel springs that
    each slip at a limit of their own (hysteresis with non-local memory). The bristle may soften as it bends, and the
    contact may creep:

        z' = w - |w| E(z) / G(w),   E(z) = sigma0 z / (1 + softening (sigma0 z / Fs)^2),   w = v - c'
        creep_time c' = creep F / sigma0 - c,   F the elastic torque

    With `share`, `softening` and `creep` zero it is the LuGre model.

    **Attributes:**

    - `name`: a word for figures and tables.
    - `motor_constant`: torque per volt, N m/V (the paper's).
    - `J`: inertia of motor, gear and arm together, kg m^2.
    - `arm_share`: part of `J` that sits behind the spring; 0 leaves a rigid machine.
    - `antiresonance`: at which the arm swings against a motor that stands still, Hz.
    - `arm_damping`: damping ratio of that.
    - `sigma0`, `sigma1`, `sigma2`: stiffness of the contact at rest, its damping, and the viscous friction, N m/rad
      and N m s/rad.
    - `Fc`, `Fs`: Coulomb and static friction, N m; `Fs` is the paper's 0.0389 V.
    - `vs`: Stribeck velocity, rad/s.
    - `share`: part of the friction carried by slipping springs.
    - `spread`: largest over smallest deflection at which one of them slips.
    - `softening`: how much the bristle softens; below 1/4, where it could not bear `Fs`.
    - `creep`: further deflection of a loaded contact that waits, as a part of the elastic one.
    - `creep_time`: in which it comes, s.
    - `delay`: samples between the computation of the voltage and its arrival at the motor.
    - `encoder_step`: quantum of the measured angle, rad.
    - `encoder_noise`: standard deviation before quantisation, in encoder steps.
    """

    name: str = eqx.field(static=True, default="LuGre")
    motor_constant: float = eqx.field(static=True, default=16.0)
    J: float = eqx.field(static=True, default=0.03)
    arm_share: float = eqx.field(static=True, default=0.25)
    antiresonance: float = eqx.field(static=True, default=330.0)
    arm_damping: float = eqx.field(static=True, default=0.02)
    sigma0: float = eqx.field(static=True, default=2000.0)
    sigma1: float = eqx.field(static=True, default=5.0)
    sigma2: float = eqx.field(static=True, default=0.06)
    Fc: float = eqx.field(static=True, default=0.5)
    Fs: float = eqx.field(static=True, default=16.0 * 0.0389)
    vs: float = eqx.field(static=True, default=0.06)
    share: float = eqx.field(static=True, default=0.0)
    spread: float = eqx.field(static=True, default=100.0)
    softening: float = eqx.field(static=True, default=0.0)
    creep: float = eqx.field(static=True, default=0.0)
    creep_time: float = eqx.field(static=True, default=0.3)
    delay: int = eqx.field(static=True, default=1)
    encoder_step: float = eqx.field(static=True, default=2.0 * math.pi / (COUNTS_PER_MOTOR_TURN * GEAR))
    encoder_noise: float = eqx.field(static=True, default=0.3)

    @property
    def static_voltage(self) -> float:
        """Voltage that breaks the arm away, V."""
        return self.Fs / self.motor_constant

    @property
    def resonance(self) -> float:
        """Where the mode of the transmission resonates, without friction, Hz; infinite for a rigid machine."""
        return self.antiresonance / math.sqrt(1.0 - self.arm_share) if self.arm_share else math.inf

    @property
    def limits(self) -> Float[np.ndarray, " elements"]:
        """Part of the friction level at which each spring slips, shape `(elements,)`; their sum is `share`."""
        limits = np.geomspace(1.0, self.spread, ELEMENTS)
        return self.share * limits / limits.sum()


def twins() -> tuple[Twin, ...]:
    """The four machines of the study: a LuGre arm, and one for each cause that the paper suspects."""
    return (
        Twin(name="LuGre"),
        Twin(name="non-local memory", share=0.8),
        Twin(name="creep", creep=1.0),
        Twin(name="softening bristle", softening=0.22),
    )


class Measured(eqx.Module):
    """What was recorded in several runs side by side.

    **Attributes:**

    - `u`: voltage as the computer wrote it, V, shape `(n, runs)`.
    - `x`: angle of the arm as the encoder gives it, rad, shape `(n, runs)`.
    - `true_x`: angle without noise and quantisation, rad, shape `(n, runs)`.
    """

    u: Float[np.ndarray, "n runs"]
    x: Float[np.ndarray, "n runs"]
    true_x: Float[np.ndarray, "n runs"]


Numbers = dict[str, Float[Array, " runs"] | Float[Array, "elements runs"]]
"""The numbers of the twins by name; of `limits` a row for each spring."""

Memory = tuple[Float[Array, "elements runs"], Float[Array, " runs"], Float[Array, " runs"]]
"""Forces of the springs, deflection of the bristle, and how far the contact has crept."""

State = tuple[
    Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"], Memory
]
"""Angle and velocity of the motor, of the arm, and the memory of the contact."""


def _friction(
    p: Numbers, memory: Memory, v: Float[Array, " runs"], w: Float[Array, " runs"], h: Float[Array, ""]
) -> tuple[Float[Array, " runs"], Memory]:
    """Mean torque of the friction over a step of `h` s at the mean velocity `w`, and the memory after it.

    A slipping spring is carried by its displacement and cut at its limit, which is exact however far it moves. The
    bristle's equation is linear while the velocity and its softening are constant: its end and mean are closed forms.
    """
    springs, z, crept = memory
    level = p["Fc"] + (p["Fs"] - p["Fc"]) * jnp.exp(-((w / p["vs"]) ** 2))

    def soft(bend: Float[Array, " runs"]) -> Float[Array, " runs"]:
        return 1.0 / (1.0 + p["softening"] * (bend * p["sigma0"] / p["Fs"]) ** 2)

    elastic = jnp.sum(springs, axis=0) + (1.0 - p["share"]) * p["sigma0"] * z * soft(z)
    creeping = (p["creep"] * elastic / p["sigma0"] - crept) / p["creep_time"]
    slip = w - creeping

    end = p["Fc"] + (p["Fs"] - p["Fc"]) * jnp.exp(-(((2.0 * w - v) / p["vs"]) ** 2))
    limit = p["limits"] * end[None, :]
    spring = p["sigma0"] * p["share"] / springs.shape[0]
    new_springs = jnp.clip(springs + (spring * slip * h)[None, :], -limit, limit)
    dry = jnp.sum(
        0.5 * (springs + new_springs) + (p["sigma1"] / (p["sigma0"] * h))[None, :] * (new_springs - springs),
        axis=0,
    )

    rate = p["sigma0"] * soft(z) * jnp.abs(slip) / level + 1e-12
    decay = -jnp.expm1(-rate * h)
    new_z = z + (slip / rate - z) * decay
    mean_z = slip / rate + (z - slip / rate) * decay / (rate * h)
    bristle = p["sigma0"] * mean_z * soft(mean_z) + p["sigma1"] * (new_z - z) / h
    torque = dry + (1.0 - p["share"]) * bristle + p["sigma2"] * w
    return torque, (new_springs, new_z, crept + h * creeping)


def _step(state: State, torque: Float[Array, " runs"], p: Numbers, h: Float[Array, ""]) -> State:
    """One step by the trapezoidal rule; mean velocities are found by substitution, which gains two decimals a pass."""
    motor, motor_v, arm, arm_v, memory = state

    def torques(
        w: Float[Array, " runs"], arm_w: Float[Array, " runs"]
    ) -> tuple[Float[Array, " runs"], Float[Array, " runs"], Memory]:
        twist = motor - arm + 0.5 * h * (w - arm_w)
        through = p["spring"] * twist + p["damper"] * (w - arm_w)
        friction, after = _friction(p, memory, motor_v, w, h)
        return torque - through - friction, through, after

    w, arm_w = motor_v, arm_v
    for _ in range(_SUBSTITUTIONS):
        on_motor, on_arm, _ = torques(w, arm_w)
        w, arm_w = motor_v + 0.5 * h / p["motor_J"] * on_motor, arm_v + 0.5 * h / p["arm_J"] * on_arm
    on_motor, on_arm, memory = torques(w, arm_w)
    return (
        motor + h * w,
        motor_v + h / p["motor_J"] * on_motor,
        arm + h * arm_w,
        arm_v + h / p["arm_J"] * on_arm,
        memory,
    )


@partial(jax.jit, static_argnames="substeps")
def _scan(
    p: Numbers,
    volts: Float[Array, "n runs"],
    reference: Float[Array, "n runs"],
    noise: Float[Array, "n runs"],
    sample_rate: Float[Array, ""],
    substeps: int,
) -> tuple[Float[Array, "n runs"], Float[Array, "n runs"], Float[Array, "n runs"]]:
    h = 1.0 / (sample_rate * substeps)

    def sample(
        carry: tuple[State, Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"]],
        inputs: tuple[Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"]],
    ) -> tuple[
        tuple[State, Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"]],
        tuple[Float[Array, " runs"], Float[Array, " runs"], Float[Array, " runs"]],
    ]:
        state, error, slope, waiting = carry
        volt, target, disturbance = inputs
        measured = jnp.round(state[0] / p["encoder_step"] + disturbance) * p["encoder_step"]
        # The controller's derivative is filtered at 200 Hz: raw differences of encoder counts are too noisy.
        blend = 1.0 - jnp.exp(-2.0 * jnp.pi * 200.0 / sample_rate)
        slope = slope + blend * ((target - measured - error) * sample_rate - slope)
        u = volt + p["kp"] * (target - measured) + p["kd"] * slope
        torque = p["motor_constant"] * jnp.where(p["delay"] > 0, waiting, u)
        after = jax.lax.fori_loop(0, substeps, lambda _, s: _step(s, torque, p, h), state)
        return (after, target - measured, slope, u), (u, measured, state[0])

    rest = jnp.zeros(volts.shape[1])
    memory = (jnp.zeros((p["limits"].shape[0], volts.shape[1])), rest, rest)
    return jax.lax.scan(
        sample, ((rest, rest, rest, rest, memory), rest, rest, rest), (volts, reference, noise)
    )[1]


def measure(
    twins: Sequence[Twin],
    volts: Real[ArrayLike, "..."],
    *,
    seed: int = 0,
    reference: Real[ArrayLike, "n runs"] | None = None,
    bandwidth: float = 0.0,
    sample_rate: float = SAMPLE_RATE,
    substeps: int = 3,
) -> Measured:
    """Run experiments side by side, one on each twin, each from rest and from an unloaded contact.

    **Arguments:**

    - `twins`: the machine of each run.
    - `volts`: input voltage, to which a controller adds, V, shape `(n, runs)`.
    - `seed`: of the encoders' noise.
    - `reference`: angle for a controller to follow, rad, shape `(n, runs)`; an open loop without it.
    - `bandwidth`: of that controller, Hz.
    - `sample_rate`: of computer and encoder, Hz.
    - `substeps`: steps of the integration in a sample.

    **Returns:** the `Measured`.

    **Raises:** `InputError` when `volts` does not have a column for each twin or a twin's `delay` is not 0 or 1;
        `PrecisionError` when JAX computes in float32.
    """
    require_x64()
    volts = np.asarray(volts, float)
    if volts.ndim != 2 or volts.shape[1] != len(twins):
        raise InputError(
            f"`volts` has the shape {volts.shape} for {len(twins)} twins", cure="Give a column for each twin."
        )
    if any(twin.delay not in (0, 1) for twin in twins):
        raise InputError("the `delay` of a twin is not 0 or 1 samples", cure="Choose one of these.")
    names = ("motor_constant", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "share", "softening", "creep")
    names += ("creep_time", "delay", "encoder_step")
    p = {name: np.array([float(getattr(twin, name)) for twin in twins]) for name in names}
    p["limits"] = np.stack([twin.limits for twin in twins], axis=1)
    J, arm = np.array([twin.J for twin in twins]), np.array([twin.J * twin.arm_share for twin in twins])
    pulsation = 2.0 * np.pi * np.array([twin.antiresonance for twin in twins])
    p["motor_J"], p["arm_J"] = J - arm, np.where(arm > 0.0, arm, 1.0)
    p["spring"] = arm * pulsation**2
    p["damper"] = 2.0 * arm * pulsation * np.array([twin.arm_damping for twin in twins])
    w = 2.0 * np.pi * bandwidth
    p["kp"], p["kd"] = J * w**2 / p["motor_constant"], 1.4 * J * w / p["motor_constant"]
    noise = np.random.default_rng(seed).standard_normal(volts.shape)
    noise = noise * np.array([twin.encoder_noise for twin in twins])
    target = np.zeros_like(volts) if reference is None else np.asarray(reference, float)
    u, x, true_x = _scan(p, volts, target, noise, sample_rate, substeps)
    return Measured(np.asarray(u), np.asarray(x), np.asarray(true_x))
