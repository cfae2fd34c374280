"""The fixed-step scheme against the adaptive reference, and the reference against a third road."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_lugre_numpy import by_radau
from helpers_plants import LARGE, MOVERS, PLANTS, ROTARY, TABLE_I, effect, in_large
from helpers_runs import in_steps, position_by_scipy
from scipy.integrate import solve_ivp

from frictionjax.simulation import simulate, simulate_reference

RATE, N = 2000.0, 160
T = np.arange(N) / RATE
RNG = np.random.default_rng(1)
SHAPES = {
    "smooth": 0.35 * np.sin(2 * np.pi * 12.5 * T) * np.sin(np.pi * T / T[-1]),
    "presliding loop": 0.9 * np.sin(2 * np.pi * 25.0 * T),
    "break-away": 2.0 * T / T[-1],
    "stick and slip": 1.3 * np.sin(2 * np.pi * 25.0 * T),
    "moves": 4.0 * np.where(np.sin(2 * np.pi * 12.5 * T + 1e-9) > 0.0, 1.0, -1.0),
    "noise": 0.3 * RNG.normal(size=N),
    "large noise": 1.5 * RNG.normal(size=N),
}
"""Motor force over break-away force."""

ERROR = dict(zip(SHAPES, (2e-4, 1.5e-3, 6e-5, 1.4e-3, 2e-4, 7e-3, 3e-2), strict=True))
"""Admissible rms error of the position at one step a sample, over its peak-to-peak value."""

_references = {}


def _case(plant, shape):
    """Drive, input and reference of a case; solved once."""
    drive = PLANTS[plant]
    u = SHAPES[shape] * float(drive.friction.Fs / drive.motor_constant)
    if (plant, shape) not in _references:
        _references[plant, shape] = simulate_reference(drive, u, RATE)
    return drive, u, _references[plant, shape]


def _error(drive, u, exact, substeps):
    """RMS error of the position over its peak-to-peak value, against the `exact` one."""
    error = np.asarray(in_steps(drive, u, RATE, substeps).x) - np.asarray(exact)
    return float(np.sqrt(np.mean(error**2)) / np.ptp(exact))


CASES = [("table_i", shape) for shape in SHAPES]
CASES += [("rotary", "presliding loop"), ("rotary", "stick and slip"), ("rotary", "large noise")]
CASES += [("stage", "break-away"), ("stage", "moves")]


@pytest.mark.parametrize(("plant", "shape"), CASES)
def test_fixed_steps_agree_with_the_reference(plant, shape):
    drive, u, reference = _case(plant, shape)
    assert _error(drive, u, reference.x, 1) < ERROR[shape]
    assert _error(drive, u, reference.x, 2) < ERROR[shape] / 2.5
    run = in_steps(drive, u, RATE, 16)
    for ours, theirs in ((run.v, reference.v), (run.z, reference.z), (run.friction, reference.friction)):
        np.testing.assert_allclose(ours, theirs, atol=2e-3 * float(jnp.ptp(theirs)))


STEPS = (1, 2, 4, 8, 16)


def _order(plant, shape):
    drive, u, reference = _case(plant, shape)
    errors = [_error(drive, u, reference.x, substeps) for substeps in STEPS]
    return -np.polyfit(np.log(STEPS), np.log(errors), 1)[0]


@pytest.mark.parametrize("plant", ["table_i", "rotary"])
def test_the_scheme_is_of_second_order(plant):
    assert 1.7 < _order(plant, "smooth") < 2.3


@pytest.mark.parametrize("shape", ["presliding loop", "stick and slip", "large noise"])
def test_the_order_holds_across_velocity_reversals(shape):
    """|v| has a corner there, which could cost an order in those steps; it costs some regularity, no more."""
    assert 1.6 < _order("table_i", shape) < 2.4


def test_tighter_tolerances_do_not_move_the_reference():
    drive, u, reference = _case("table_i", "stick and slip")
    tighter = simulate_reference(drive, u, RATE, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(tighter.x, reference.x, atol=1e-7 * float(jnp.ptp(reference.x)))


def test_the_two_references_agree():
    """Another method, another implementation of the physics, another way to take the jumps of the input."""
    drive, u, _ = _case("table_i", "presliding loop")
    ours = np.asarray(simulate_reference(drive, u, RATE, rtol=1e-11, atol=1e-14).x)
    x, _, _ = by_radau(drive, u, RATE)
    assert np.max(np.abs(ours - x)) < 1e-9 * np.ptp(x)  # measured over 120 samples: 2.7e-10
    tighter, _, _ = by_radau(drive, u, RATE, rtol=1e-12, atol=1e-14)
    assert np.max(np.abs(tighter - x)) < 1e-11 * np.ptp(x)  # 1e-13


def test_the_reference_agrees_with_an_implementation_of_its_own():
    """LuGre written out again in numpy and solved by scipy's Radau, sample after sample."""
    _, u, reference = _case("rotary", "stick and slip")
    s0, s1, s2, fc, fs, vs = 2000.0, 6.0, 0.06, 0.5, 0.62, 0.06
    n = 50

    def field(_, state, force):
        _, v, z = state * scale
        rate = v - s0 * abs(v) * z / (fc + (fs - fc) * np.exp(-((v / vs) ** 2)))
        return np.array([v, (force - s0 * z - s1 * rate - s2 * v) / 0.03, rate]) / scale

    scale = np.array([1e-3, 1e-1, 1e-4])
    state, x = np.zeros(3), [0.0]
    for force in 16.0 * u[: n - 1]:
        solution = solve_ivp(field, (0.0, 1 / RATE), state, "Radau", args=(force,), rtol=1e-8, atol=1e-10)
        state = solution.y[:, -1]
        x.append(state[0] * 1e-3)
    np.testing.assert_allclose(reference.x[:n], x, atol=2e-7 * np.ptp(x))
    np.testing.assert_allclose(reference.v[n - 1], state[1] * 0.1, rtol=1e-6)


def test_changes_of_the_input_are_not_stepped_over():
    """A single sample of force in a long rest: without declared jumps adaptive steps would miss it."""
    u = np.zeros(N)
    u[100] = 0.5
    x = simulate_reference(TABLE_I, u, RATE).x
    np.testing.assert_allclose(x[:101], 0.0, atol=1e-20)
    exact = simulate(TABLE_I, u, RATE, substeps=16).x
    np.testing.assert_allclose(x, exact, atol=1e-4 * float(jnp.max(exact)))


def test_a_single_sample_and_an_initial_state():
    run = simulate_reference(TABLE_I, np.zeros(1), RATE, x0=1e-3, v0=0.1, z0=1e-6)
    assert (float(run.x[0]), float(run.v[0])) == (pytest.approx(1e-3), pytest.approx(0.1))
    assert float(run.z[0, 0]) == pytest.approx(1e-6)


def test_giving_up_is_a_sentence():
    with pytest.raises(eqx.EquinoxRuntimeError, match="raise `max_steps`, or loosen `rtol`"):
        jax.block_until_ready(simulate_reference(ROTARY, SHAPES["moves"], RATE, max_steps=20))


def test_an_input_of_another_rank_is_refused():
    with pytest.raises(ValueError, match=r"`u` has shape \(2, 3\)"):
        simulate_reference(ROTARY, np.zeros((2, 3)), RATE)


@pytest.mark.parametrize("form", MOVERS)
def test_each_effect_agrees_with_the_reference(form):
    drive = in_large(form)
    u = 2.0 * SHAPES["stick and slip"]
    exact = position_by_scipy(drive, u, RATE)
    assert _error(drive, u, exact, 2) < (4e-3 if form == "Backlash" else 1e-3)
    without = _error(TABLE_I, u, exact, 8)
    assert _error(drive, u, exact, 8) < 0.1 * without


def test_the_reference_agrees_with_scipy_on_a_state_and_a_force_that_changes_within_a_sample():
    """The equations solved by two methods, with an effect that has a state of its own and a late input."""
    drive = TABLE_I.with_effects(
        effect("Creep", compliance=LARGE["Creep"][0]), effect("Delay", delay=LARGE["Delay"][0])
    )
    u = 2.0 * SHAPES["stick and slip"]
    exact = position_by_scipy(drive, u, RATE, 1e-9, 1e-11)
    assert np.max(np.abs(np.asarray(simulate_reference(drive, u, RATE).x) - exact)) < 1e-6 * np.ptp(exact)
    late = position_by_scipy(TABLE_I.with_effects(drive.effects[0]), u, RATE)
    assert np.max(np.abs(late - exact)) > 1e-3 * np.ptp(exact)


@jax.jit
def _explicit(drive, u):
    """Position of a drive with elasto-slip elements by 4000 explicit steps a sample, and a memory of what slips."""
    bristles, friction, h = drive.bristles(), drive.friction, 1.0 / RATE / 4000
    first = jnp.arange(drive.bristle_count) == 0

    def step(force, state):
        x, v, z, slips = state
        limit = friction.level(v) * bristles.slack / friction.sigma0
        now = jnp.where(first, z, jnp.clip(z, -limit, limit))
        following = jnp.where(
            first, z + h * (v - jnp.abs(v) * z / limit), jnp.clip(now + h * v, -limit, limit)
        )
        stopped = ~first & (now + h * v != following)
        rate = jnp.where(slips & stopped, 0.0, (following - now) / h)
        opposing = friction.sigma0 * jnp.sum(bristles.share * 0.5 * (now + following))
        opposing = opposing + friction.sigma1 * jnp.sum(bristles.share * rate) + friction.sigma2 * v
        faster = v + h * (force - opposing) / drive.J
        return x + h * faster, faster, following, stopped

    def sample(state, force):
        return jax.lax.fori_loop(0, 4000, lambda _, now: step(force, now), state), state[0]

    zero = jnp.zeros(())
    return jax.lax.scan(sample, (zero, zero, jnp.zeros(first.shape), jnp.zeros(first.shape, bool)), u)[1]


@pytest.mark.parametrize(
    ("shape", "gate"), [("presliding loop", 2e-3), ("stick and slip", 3e-3), ("moves", 5e-5), ("noise", 2e-3)]
)
def test_elasto_slip_agrees_with_small_explicit_steps(shape, gate):
    drive = TABLE_I.with_effects(effect("MaxwellSlip", share=0.5, spread=1.0))
    u = jnp.asarray(1.5 * SHAPES[shape])
    exact = _explicit(drive, u)
    assert _error(drive, u, exact, 1) < gate
    assert _error(drive, u, exact, 4) < 0.6 * gate
