"""`simulate_reference`: the same model by an adaptive implicit method, to verify the fixed-step scheme.

It shares the equations of `frictionjax.physics` with `simulate`, and nothing else. A step size adapted to a
smooth interval may skip a change of the input; so every sample instant is declared as a jump.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Real

from frictionjax.core import require_x64
from frictionjax.core.safe import real, sign
from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Trajectory, initial_state
from frictionjax.simulation.load_side import two_inertias

# Part of its yield deflection over which an elasto-slip element goes from sticking to slipping: at 1e-4 a run stalls.
_CORNER = 1e-2


def _scales(drive: Drive) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The break-away deflection, and the velocity of a free oscillation of that amplitude: divided by them, position,
    velocity and deflection have the same tolerances."""
    bend = drive.friction.Fs / drive.friction.sigma0
    return bend, bend * jnp.sqrt(drive.friction.sigma0 / drive.J)


def scaled_rates(
    drive: Drive, scaled: Float[Array, " states"], held: Float[Array, ""]
) -> Float[Array, " states"]:
    """Rates of the states of `drive` (per s) under a force, for any solver.

    **Arguments:**

    - `drive`: the `Drive`.
    - `scaled`: position, velocity, deflections of the bristles and states of effects, shape `(states,)`: the velocity
      over Fs/sqrt(sigma0 J), the others over the break-away deflection Fs/sigma0.
    - `held`: motor force, force units.

    **Returns:**

    The rates of `scaled`, shape `(states,)`, per s.
    """
    bristles = drive.bristles()
    bend, speed = _scales(drive)
    last = 2 + drive.bristle_count
    x, v, z, hidden = scaled[0] * bend, scaled[1] * speed, scaled[2:last] * bend, scaled[last:] * bend
    spring, sigma0 = drive.spring_force(z[0]), drive.friction.sigma0
    now = drive.instant(x, v, held, spring, hidden)
    level = drive.level_at(now)
    # An elasto-slip element loses its damping, then its motion, within _CORNER of its yield; LuGre's ignores this.
    gap = (1.0 - sign(v) * z / bristles.limit(level, sigma0)) / _CORNER
    w, fast = drive.bristle_speed(now), drive.slip_speed(now)
    slip = drive.slip(spring / level, fast)
    damping_rate = bristles.rate(w, fast, slip, w * jnp.clip(gap - 1.0, 0.0, 1.0))
    rate = bristles.rate(w, fast, slip, w * jnp.clip(gap, -100.0, 1.0))
    opposing = drive.opposing_force(bristles, now, z, damping_rate)
    source, forget = drive.relaxation(now)
    own = source - forget * hidden[: drive.state_count]
    a, load_rate = two_inertias(drive, held - opposing, v, hidden[drive.state_count :])
    hidden_rate = jnp.concatenate([own, load_rate])
    return jnp.concatenate([jnp.stack([v / bend, a / speed]), rate / bend, hidden_rate / bend])


@eqx.filter_jit
def _simulate_reference(
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    x0: Float[Array, ""],
    v0: Float[Array, ""],
    z0: Float[Array, ""],
    rtol: Float[Array, ""],
    atol: Float[Array, ""],
    max_steps: int,
) -> Trajectory:
    import diffrax  # it loads slowly, and only this reference needs it

    bristles = drive.bristles()
    force = drive.applied_force(u, dt)
    t = jnp.arange(u.shape[0], dtype=u.dtype) * dt
    bend, speed = _scales(drive)
    last = 2 + drive.bristle_count

    def field(instant, scaled, _):
        sample = jnp.clip(jnp.searchsorted(t, instant, side="right") - 1, 0, t.shape[0] - 1)
        held = mean_of(force)[sample]
        if isinstance(force, Push):
            held = held + force.rise[sample] * ((instant - t[sample]) / dt - 0.5)
        return scaled_rates(drive, scaled, held)

    start = initial_state(drive, x0, v0, z0)
    scaled = jnp.concatenate(
        [jnp.stack([start.x / bend, start.v / speed]), start.z / bend, start.hidden / bend]
    )
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Kvaerno5(),
        t0=t[0],
        t1=t[-1],
        dt0=None,
        y0=scaled,
        saveat=diffrax.SaveAt(ts=t),
        stepsize_controller=diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=rtol, atol=atol), jump_ts=t
        ),
        adjoint=diffrax.ForwardMode(),
        max_steps=max_steps,
        throw=False,
    )
    scaled = eqx.error_if(
        solution.ys,
        solution.result != diffrax.RESULTS.successful,
        "The reference did not reach the last sample: raise `max_steps`, or loosen `rtol`. "
        "If neither helps, the parameters of `drive` or the input `u` are not finite or not physical.",
    )
    x, v, z, hidden = (
        scaled[:, 0] * bend,
        scaled[:, 1] * speed,
        scaled[:, 2:last] * bend,
        scaled[:, last:] * bend,
    )
    friction = jax.vmap(lambda x, v, z, own, push: drive.friction_force(bristles, x, v, z, dt, own, push)[0])(
        x, v, z, hidden, mean_of(force)
    )
    return Trajectory(t, x, v, z, friction, jax.vmap(drive.measured)(x, t, hidden))


def simulate_reference(
    drive: Drive,
    u: Real[ArrayLike, "..."],
    sample_rate: Real[ArrayLike, ""],
    *,
    x0: Real[ArrayLike, ""] = 0.0,
    v0: Real[ArrayLike, ""] = 0.0,
    z0: Real[ArrayLike, ""] = 0.0,
    rtol: float = 1e-9,
    atol: float = 1e-12,
    max_steps: int = 10_000_000,
) -> Trajectory:
    """Simulate `drive` on the sampled input `u`, held between samples, as exactly as float64 allows.

    Kvaerno's implicit method of order 5 with adaptive steps: some hundred to a thousand times slower than `simulate`,
    for single runs. Works under jit and in forward-mode derivatives. Two things are not exact: a force that an effect
    of the input changes within a sample is a straight line, as in `simulate`; and elasto-slip elements go from sticking
    to slipping over the last hundredth of their yield (0.5 % of the motion), because an adaptive method stalls at a
    sharp corner.

    **Arguments:**

    - `drive`: the `Drive`.
    - `u`: input, shape `(n,)`, input units.
    - `sample_rate`: samples per second.
    - `x0`, `v0`, `z0`: position, velocity and bristle deflection at the first sample.
    - `rtol`, `atol`: relative tolerance, and absolute one in units of the break-away deflection Fs/sigma0 (position,
      deflection) and of Fs/sqrt(sigma0 J) (velocity).
    - `max_steps`: most steps before it stops with an error.

    **Returns:**

    A `Trajectory`, whose first sample is the initial state.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when `u` is not one-dimensional; a run-time error
    when the last sample is not reached.
    """
    require_x64()
    u = real(u)
    if u.ndim != 1:
        raise ValueError(f"`u` has shape {u.shape}; `simulate_reference` takes one input of shape (n,).")
    return _simulate_reference(
        drive, u, 1.0 / real(sample_rate), real(x0), real(v0), real(z0), real(rtol), real(atol), max_steps
    )
