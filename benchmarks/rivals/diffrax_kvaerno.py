"""diffrax as its documentation would have it for a stiff system: Kvaerno5 with adaptive steps, under `jax.vmap`."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp


@eqx.filter_jit
def simulate_all(parameters, force, dt, rtol):
    """Positions (b, n) of all drives from rest; `parameters` (b, 7), absolute tolerance 1e-3 `rtol` in scaled units.

    Every change of the input is declared, or the steps would pass over it.
    """
    t = jnp.arange(force.shape[0]) * dt

    def one(p):
        J, s0, s1, s2, Fc, Fs, vs = p
        scale = jnp.stack([Fs / s0, Fs / s0 * jnp.sqrt(s0 / J), Fs / s0])

        def field(now, y, _):
            _, v, z = y * scale
            push = force[jnp.clip(jnp.searchsorted(t, now, side="right") - 1, 0, t.shape[0] - 1)]
            rate = v - jnp.abs(v) * s0 * z / (Fc + (Fs - Fc) * jnp.exp(-((v / vs) ** 2)))
            return jnp.stack([v, (push - s0 * z - s1 * rate - s2 * v) / J, rate]) / scale

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Kvaerno5(),
            t0=t[0],
            t1=t[-1],
            dt0=None,
            y0=jnp.zeros(3),
            saveat=diffrax.SaveAt(ts=t),
            stepsize_controller=diffrax.ClipStepSizeController(
                diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol), jump_ts=t
            ),
            max_steps=1_000_000,
        )
        return solution.ys[:, 0] * scale[0]

    return jax.vmap(one)(parameters)
