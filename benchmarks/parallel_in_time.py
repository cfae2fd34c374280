"""One long record, all its steps at once: Newton's iteration with an associative scan, against the plain scan.

`python -m benchmarks parallel_in_time`. Each round linearises every step about the last guess of the whole run and
solves the linear recursion in parallel (Lim et al., "Parallelizing non-linear sequential models over the sequence
length", 2024). It pays where there are thousands of idle lanes; the rows say what it costs here.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from benchmarks.problem import DT, SAMPLE_RATE, STAGE, drive_of, force
from benchmarks.timing import first_call, medians, row
from frictionjax import simulate
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import advance

ROUNDS = 60


@eqx.filter_jit
def newton_in_time(drive, push):
    """Positions (n,) from rest and the number of rounds until no state moves by more than 1e-9 of its size."""
    bristles = drive.bristles()
    bend = drive.friction.Fs / drive.friction.sigma0
    scale = jnp.stack([bend, bend * jnp.sqrt(drive.friction.sigma0 / drive.J), bend])

    def step(state, u):
        x, v, z = state * scale
        after = advance(drive, bristles, initial_state(drive, x, v, z), u, jnp.asarray(DT), 1)
        return jnp.stack([after.x, after.v, after.bristle]) / scale

    def join(first, second):
        (a, b), (c, d) = first, second
        return c @ a, jnp.einsum("...ij,...j->...i", c, b) + d

    def sweep(carry):
        guess, _, rounds = carry
        before = jnp.concatenate([jnp.zeros((1, 3)), guess[:-1]])
        value = jax.vmap(step)(before, push)
        slope = jax.vmap(jax.jacfwd(step))(before, push)
        rest = value - jnp.einsum("nij,nj->ni", slope, before)
        better = jax.lax.associative_scan(join, (slope, rest))[1]
        better = jnp.where(jnp.isfinite(better), better, guess)
        return better, jnp.max(jnp.abs(better - guess) / (1.0 + jnp.abs(better))), rounds + 1

    def goes_on(carry):
        return (carry[1] > 1e-9) & (carry[2] < ROUNDS)

    start = (jnp.zeros((push.shape[0], 3)), jnp.asarray(jnp.inf), jnp.asarray(0))
    states, left, rounds = jax.lax.while_loop(goes_on, sweep, start)
    return jnp.concatenate([jnp.zeros(1), states[:-1, 0] * scale[0]]), left, rounds


def measure(*, small: bool = False) -> list[dict]:
    """Rounds and time, for noise below break-away and for noise that makes the stage slide."""
    samples = 500 if small else 8000
    drive, rows = drive_of(STAGE), []
    for part, what in ((0.25, "noise in presliding"), (1.0, "noise that breaks it away")):
        push = jnp.asarray(part * force(samples))
        runs = {
            "scan": lambda p=push: simulate(drive, p, SAMPLE_RATE, substeps=1).x,
            "newton": lambda p=push: newton_in_time(drive, p),
        }
        for run in runs.values():
            first_call(run)
        seconds = medians(runs, repeats=3)
        x, left, rounds = runs["newton"]()
        exact = runs["scan"]()
        label = f"{samples} steps, {what}"
        rows += [
            row(f"{label}: Newton rounds (at most {ROUNDS})", float(rounds), "1"),
            row(f"{label}: largest relative change in the last round", float(left), "1"),
            row(f"{label}: error over the motion", float(jnp.max(jnp.abs(x - exact)) / jnp.ptp(exact)), "1"),
            row(
                f"{label}: parallel in time, time over that of the scan",
                seconds["newton"] / seconds["scan"],
                "x",
            ),
        ]
    return rows
