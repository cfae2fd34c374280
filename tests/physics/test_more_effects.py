"""Effects against their closed forms outside steady sliding: states, slip laws, input and sensor paths, load sides."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
from helpers_plants import FORMS, SMALL, TABLE_I, effect, some_slow
from helpers_runs import in_steps

from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation import simulate
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.load_side import contact, two_inertias
from frictionjax.simulation.ros2 import advance

RATE = 2000.0
FC, FS, VS, S0 = 1.0, 1.5, 1e-3, 1e5
HEAVY = Drive(1e12, TABLE_I.friction)
"""A mass that nothing slows down: its velocity is what it began with."""


@eqx.filter_jit
def _coast(drive, state, n):
    def sample(state, _):
        return advance(drive, drive.bristles(), state, jnp.zeros(()), jnp.asarray(1.0 / RATE), 2), state

    return jax.lax.scan(sample, state, length=n)[1]


def _at(speed, made, *, n=400, z0=0.0, before=None):
    """`n` samples of the states of a heavy drive that moves at `speed`, and the drive."""
    drive = HEAVY.with_effects(made)
    start = initial_state(drive, jnp.zeros(()), jnp.asarray(speed), jnp.asarray(z0), before)
    return _coast(drive, start, n), drive


@eqx.filter_jit
def _levels(drive, run):
    """The friction level at every sample."""
    return jax.vmap(lambda x, v, hidden: drive.level_at(drive.instant(x, v, hidden=hidden)))(
        run.x, run.v, run.hidden
    )


T = np.arange(400) / RATE


# States


def test_a_late_friction_follows_a_step_of_velocity():
    """w = v (1 - exp(-t/lag)), and the level is that of w."""
    run, drive = _at(3e-3, effect("FrictionLag", lag=0.05))
    w = 3e-3 * (1.0 - np.exp(-T / 0.05))
    np.testing.assert_allclose(run.hidden[:, 0], w, rtol=1e-9)
    np.testing.assert_allclose(_levels(drive, run), FC + (FS - FC) * np.exp(-((w / VS) ** 2)), rtol=1e-9)


def test_a_shorter_lag_leaves_less_of_itself():
    u = 2.5 * np.sin(2 * np.pi * 15.0 * np.arange(400) / RATE)
    base = simulate(TABLE_I, u, RATE, substeps=4).x

    def far(lag):
        made = effect("FrictionLag", lag=lag)
        return float(jnp.max(jnp.abs(simulate(TABLE_I.with_effects(made), u, RATE, substeps=4).x - base)))

    off = [far(lag) for lag in (0.0, 1e-4, 1e-3, 1e-2)]
    assert off[0] == 0.0
    assert 0.0 < off[1] < off[2] < off[3]


@pytest.mark.parametrize("form", ["DwellStrengthening", "SaturatingStrengthening"])
def test_contacts_age_at_rest_and_renew_in_motion(form):
    """theta = rest + t at rest; in sliding it goes to length/|v| with the path."""
    run, drive = _at(0.0, effect(form, growth=0.05), before=Before(rest=7.0))
    np.testing.assert_allclose(run.hidden[:, 0], 7.0 + T, rtol=1e-12)
    rise = {
        "DwellStrengthening": np.log(1.0 + 7.0 / 0.1),
        "SaturatingStrengthening": 1.0 - np.exp(-7.0 / 0.3),
    }
    level = drive.level_at(drive.instant(run.x[0], run.v[0], hidden=run.hidden[0]))
    assert float(level) == pytest.approx(FS + 0.05 * FC * rise[form], rel=1e-12)

    # With the bristle bent as in sliding: one that only bends keeps its contact.
    bent = -float(TABLE_I.friction.level(-2e-4) / TABLE_I.friction.sigma0)
    run, _ = _at(-2e-4, effect(form, growth=0.05), z0=bent, before=Before(rest=7.0))
    held = 1.5e-5 / 2e-4  # both lengths are 15 um here
    np.testing.assert_allclose(run.hidden[:, 0], held + (7.0 - held) * np.exp(-T / held), rtol=1e-8)


def test_break_away_grows_with_the_rest_before():
    """A ramp that takes two seconds: the highest motor force before the mass runs off."""

    @eqx.filter_jit
    def highest(drive, before):
        push = jnp.linspace(0.0, 2.4, 4000)

        def sample(state, force):
            return advance(drive, drive.bristles(), state, force, jnp.asarray(1.0 / RATE), 2), state.x

        zero = jnp.zeros(())
        x = jax.lax.scan(sample, initial_state(drive, zero, zero, zero, before), push)[1]
        return push[jnp.argmax(x > 3e-4)]

    drive = TABLE_I.with_effects(effect("DwellStrengthening", growth=0.04))
    short, long = (float(highest(drive, Before(rest=rest))) for rest in (0.1, 1e4))
    assert short < long - 0.02
    base = float(highest(TABLE_I, Before()))
    assert base < short


def test_warm_up_by_time_begins_where_the_clock_stands():
    run, _ = _at(0.01, effect("WarmupByTime", fall=0.3, time_constant=4.0), before=Before(clock=3.0))
    np.testing.assert_allclose(run.hidden[:, 0], 1.0 - np.exp(-(3.0 + T) / 4.0), rtol=1e-9)
    cold, _ = _at(0.01, effect("WarmupByTime", fall=0.3), before=Before())
    assert float(cold.hidden[0, 0]) == 0.0


def test_warm_up_by_heat_begins_with_what_is_left_of_earlier_paths():
    before = Before(path=jnp.asarray([0.5, 0.2]), age=jnp.asarray([8.0, 2.0]))
    run, _ = _at(-0.05, effect("WarmupByHeat", fall=0.1, time_constant=4.0, distance=0.1), before=before)
    begin = (0.5 * np.exp(-2.0) + 0.2 * np.exp(-0.5)) / 0.1
    steady = 0.05 / 0.1 * 4.0
    np.testing.assert_allclose(run.hidden[:, 0], steady + (begin - steady) * np.exp(-T / 4.0), rtol=1e-9)


def test_warm_up_by_temperature_follows_what_was_measured():
    """Nine temperatures over the recording, straight lines between; fall is per kelvin."""
    kelvin = np.array([0.0, 5.0, 7.0, 6.0, 9.0, 12.0, 11.0, 14.0, 20.0])
    before = Before(temperature=jnp.asarray(kelvin), duration=T[-1])
    run, drive = _at(0.01, effect("WarmupByTemperature", fall=0.02), before=before)
    levels = _levels(drive, run)
    cold = _levels(TABLE_I, eqx.tree_at(lambda run: run.hidden, run, jnp.zeros((T.size, 0))))[0]
    warm = np.interp(T, np.linspace(0.0, T[-1], 9), kelvin)
    np.testing.assert_allclose(levels, float(cold) / (1.0 + 0.02 * warm), rtol=1e-9)


def test_friction_that_would_fall_below_zero_stays_positive():
    made = effect("WarmupByHeat", fall=0.1)
    drive = TABLE_I.with_effects(made)
    level = float(drive.level_at(drive.instant(jnp.zeros(()), jnp.asarray(0.1), hidden=jnp.asarray([30.0]))))
    assert level == pytest.approx(0.1 * FC, rel=1e-9)


def test_viscoelastic_elements_relax_at_their_three_times():
    """A bristle bent by z0 and held: the added force falls as a sum of three exponentials."""
    z0 = 2e-6
    run, drive = _at(0.0, effect("ViscoelasticDamping", stiffness=0.1, shortest=2e-3), z0=z0)
    np.testing.assert_allclose(run.z[:, 0], z0, rtol=1e-8)
    force = 0.1 * (3.0 * S0 * z0 - S0 * np.sum(run.hidden, axis=1))
    expected = 0.1 * S0 * z0 * sum(np.exp(-T / tau) for tau in (2e-3, 2e-2, 2e-1))
    np.testing.assert_allclose(force, expected, rtol=1e-7)
    parallel = drive.parallel_force(drive.instant(run.x[0], run.v[0], 0.0, S0 * z0, run.hidden[0]))
    assert float(parallel) == pytest.approx(expected[0], rel=1e-12)


@pytest.mark.parametrize("stiffness", [0.1, 1.0])
def test_viscoelastic_elements_run_stably(stiffness):
    u = 2.5 * np.sin(2 * np.pi * 10.0 * np.arange(600) / RATE)
    drive = TABLE_I.with_effects(effect("ViscoelasticDamping", stiffness=stiffness, shortest=1e-3))
    coarse, fine = (in_steps(drive, u, RATE, steps).x for steps in (2, 16))
    assert float(jnp.max(jnp.abs(coarse - fine))) < 0.01 * float(jnp.ptp(fine))


# Slip laws


@eqx.filter_jit
def _slips(made, bend, direction):
    return jax.vmap(lambda b: made.slip(b, direction))(bend)


def _slip(made, bend, direction=1.0):
    return _slips(made, jnp.asarray(bend), jnp.asarray(direction))


@pytest.mark.parametrize("core", [0.0, 0.3, 0.8, 0.97])
def test_an_elastic_core_does_not_slip_and_sliding_is_steady(core):
    made = effect("ElastoPlastic", plasticity=1.0, core=core)
    bend = np.array([0.0, 0.5 * core, core, 0.5 * (1.0 + core), 1.0, 1.2])
    expected = np.array([0.0, 0.0, 0.0, 0.25 * (1.0 + core), 1.0, 1.2])
    np.testing.assert_allclose(_slip(made, bend), expected, atol=1e-15)
    np.testing.assert_allclose(_slip(made, -bend, -1.0), -expected, atol=1e-15)
    np.testing.assert_array_equal(_slip(made, bend, -1.0), 0.0 * bend)  # nothing slips on the way back
    half = effect("ElastoPlastic", plasticity=0.5, core=core)
    np.testing.assert_allclose(_slip(half, bend), 0.5 * (bend + expected), atol=1e-15)


def test_overtones_of_the_rise_cover_other_rises():
    """Over its whole range it never falls; one value of it is, to 0.3 %, the cubic 3 w^2 - 2 w^3."""
    way = np.linspace(0.0, 1.0, 401)
    bend = 0.4 + 0.6 * way

    def alpha(overtone):
        made = effect("ElastoPlastic", plasticity=1.0, core=0.4, overtone=overtone)
        return np.asarray(_slip(made, bend)) / bend

    parameter = {p.name: p for p in type(effect("ElastoPlastic")).nuisances}["overtone"]
    for overtone in (parameter.lower, 0.0, parameter.upper):
        rise = alpha(overtone)
        assert rise[0] == pytest.approx(0.0, abs=1e-12) and rise[-1] == pytest.approx(1.0)
        assert np.min(np.diff(rise)) > -1e-12
    cubic = way**2 * (3.0 - 2.0 * way)
    assert np.max(np.abs(alpha(0.0) - cubic)) > 8e-3
    assert min(np.max(np.abs(alpha(c) - cubic)) for c in np.linspace(0.005, 0.02, 16)) < 3e-3


def test_an_elastic_core_does_not_creep_under_vibration():
    """Two thirds of break-away with a vibration of a fifth: LuGre drifts, an elastic core stays."""
    t = np.arange(4000) / RATE
    u = np.minimum(t / 0.2, 1.0) * (0.8 + 0.2 * np.sin(2 * np.pi * 20.0 * t))

    def drift(drive):
        x = np.asarray(simulate(drive, u, RATE).x).reshape(-1, 100)  # periods
        return float(np.mean(x[-1]) - np.mean(x[20]))

    elastic = drift(TABLE_I.with_effects(effect("ElastoPlastic", plasticity=1.0, core=0.8)))
    assert drift(TABLE_I) > 1e-6
    assert abs(elastic) < 1e-9


def test_a_quadratic_yield_has_a_hyperbolic_tangent_for_its_virgin_curve():
    """dz/dx = 1 - (sigma0 z/Fs)^2 at slow motion."""
    run, _ = _at(1e-4, effect("SharpYield", exponent_change=1.0), n=800)
    level = FC + (FS - FC) * np.exp(-((1e-4 / VS) ** 2))
    np.testing.assert_allclose(run.z[:, 0], level / S0 * np.tanh(S0 * np.asarray(run.x) / level), rtol=1e-5)


@pytest.mark.parametrize("change", [-0.7, -0.2, 0.0, 1.5, 15.0])
def test_a_sharp_yield_is_odd_finite_and_one_in_sliding(change):
    made = effect("SharpYield", exponent_change=change)
    bend = jnp.asarray([0.0, 1e-9, 1e-5, 0.1, 0.5, 1.0, 1.1])
    slip = _slip(made, bend)
    np.testing.assert_allclose(slip[2:], np.asarray(bend[2:]) ** (1.0 + change), rtol=1e-12)
    np.testing.assert_array_equal(_slip(made, -bend), -slip)
    slope = jax.jit(jax.vmap(jax.grad(lambda b: made.slip(b, jnp.ones(())))))(bend)
    assert bool(jnp.all(jnp.isfinite(slope)))
    if change == 0.0:
        np.testing.assert_array_equal(slope, 1.0)


@pytest.mark.parametrize("form", ["ElastoPlastic", "SharpYield"])
@pytest.mark.parametrize("most", [False, True])
def test_slip_laws_run_stably(form, most):
    """Presliding, then sliding in both directions, at the ends of the admissible range: second order, no runaway."""
    strength = FORMS[form].strengths[0]
    value = (
        strength.upper if most else max(strength.lower, 0.1 if form == "ElastoPlastic" else strength.lower)
    )
    made = effect(form, **{strength.name: value})
    t = np.arange(480) / RATE
    u = np.where(t < 0.12, np.sin(2 * np.pi * 50.0 * t), 3.0 * np.sin(2 * np.pi * 25.0 * t))
    drive = TABLE_I.with_effects(made)
    coarse, fine = (in_steps(drive, u, RATE, steps).x for steps in (2, 32))
    assert float(jnp.max(jnp.abs(coarse - fine))) < 0.01 * float(jnp.ptp(fine))


# Damping, force and level


def test_micro_damping_falls_from_one():
    made = effect("MicroDamping", fall=0.7, speed=2e-3)
    for v in (0.0, 1e-3, -4e-3, 1.0):
        expected = 1.0 - 0.7 * (1.0 - np.exp(-((v / 2e-3) ** 2)))
        assert float(made.damping(TABLE_I.friction, jnp.asarray(v))) == pytest.approx(expected, rel=1e-12)


def test_load_dependence_knows_no_sign():
    drive = TABLE_I.with_effects(effect("LoadDependence", growth=0.3))
    x, v = jnp.zeros(()), jnp.asarray(0.1)
    levels = [float(drive.level_at(drive.instant(x, v, push))) for push in (-2.0, 0.0, 2.0)]
    assert levels == [pytest.approx(FC + 0.6), pytest.approx(FC), pytest.approx(FC + 0.6)]


# Input


U = jnp.asarray([-1.0, -0.3, -0.01, 0.0, 1e-3, 0.2, 0.7, 1.0])
DT = jnp.asarray(1e-3)


def test_a_dead_zone_takes_its_width_off():
    out = effect("DriveDeadzone", width=0.25).apply(U, DT)
    np.testing.assert_allclose(out, [-0.75, -0.05, 0.0, 0.0, 0.0, 0.0, 0.45, 0.75], atol=1e-15)


def test_the_first_bit_of_hard_saturation_is_felt_by_the_largest_inputs_and_the_input_passes():
    by_cut = jax.jit(jax.jacfwd(lambda cut: effect("HardSaturation", cut=cut, largest=1.0).apply(U, DT)))(0.0)
    np.testing.assert_array_equal(by_cut, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    by_input = jax.jit(jax.jacfwd(lambda u: effect("HardSaturation", largest=1.0).apply(u, DT)))(U)
    np.testing.assert_array_equal(by_input, np.eye(8))


def test_an_input_of_zero_has_no_derivative_in_the_dead_zone():
    by_width = jax.jit(jax.jacfwd(lambda width: effect("DriveDeadzone", width=width).apply(U, DT)))(0.0)
    np.testing.assert_array_equal(by_width, -np.sign(U))


# Sensor


def test_sensors_show_what_they_should():
    x, t, none = jnp.asarray(1.3e-4), jnp.asarray(0.0123), jnp.zeros(0)
    wave = 2e-7 * np.sin(2 * np.pi * 1.3e-4 / 4e-4) + 3e-7 * np.cos(2 * np.pi * 1.3e-4 / 4e-4)
    made = effect("EncoderError", sine=2e-7, cosine=3e-7)
    assert float(made.measured(x, t, none)) == pytest.approx(1.3e-4 + wave, rel=1e-12)
    overtone = 1e-7 * np.sin(4 * np.pi * 1.3e-4 / 4e-4) - 4e-7 * np.cos(4 * np.pi * 1.3e-4 / 4e-4)
    made = effect("EncoderErrorWithOvertone", sine=2e-7, cosine=3e-7, sine2=1e-7, cosine2=-4e-7)
    assert float(made.measured(x, t, none)) == pytest.approx(1.3e-4 + wave + overtone, rel=1e-12)
    turn = 2 * np.pi * 60.0 * 0.0123
    hum = 2e-7 * np.sin(turn) + 3e-7 * np.cos(turn) - 1e-7 * np.cos(2 * turn) + 4e-8 * np.sin(3 * turn)
    made = effect("MainsPickup", sine=2e-7, cosine=3e-7, cosine2=-1e-7, sine3=4e-8, frequency=60.0)
    assert float(made.measured(x, t, none)) == pytest.approx(1.3e-4 + hum, rel=1e-12)


@pytest.mark.parametrize("lag", [0.0, 1e-4, 2.5e-3])
def test_a_slow_sensor_filters_the_position(lag):
    """Against SciPy's filter y of lag y' = x - y on positions of a step ten times finer, from rest."""
    u = 3.0 * np.sin(2 * np.pi * 12.0 * np.arange(2000) / RATE)
    drive = TABLE_I.with_effects(effect("SensorLag", lag=lag))

    seen = simulate(drive, u, RATE, substeps=4).measured
    x = np.asarray(simulate(TABLE_I, np.repeat(u, 10), 10 * RATE, substeps=4).x)
    t = np.arange(x.size) / (10 * RATE)
    y = x if lag == 0.0 else scipy.signal.lsim(([1.0], [lag, 1.0]), x, t)[1]
    np.testing.assert_allclose(seen, y[::10], atol=2e-4 * np.ptp(x))
    if lag > 1e-3:
        assert np.max(np.abs(y - x)) > 2e-2 * np.ptp(x)


# Load side


@pytest.mark.parametrize("form", ["FlexibleTransmission", "Backlash"])
def test_a_blocked_motor_leaves_the_load_its_frequency_and_damping(form):
    drive = TABLE_I.with_effects(effect(form, ratio=0.3, frequency=40.0, damping=0.05))
    side = drive.load_side
    assert side is not None and float(side.half_gap) == (5e-5 if form == "Backlash" else 0.0)
    slopes = jax.jit(jax.jacfwd(lambda load: contact(drive.load_side, load)[0]))(jnp.asarray([3e-4, 0.0]))
    circular = 2 * np.pi * 40.0
    np.testing.assert_allclose(slopes, [-(circular**2), -2 * 0.05 * circular], rtol=1e-12)


def test_nothing_is_felt_inside_the_gap():
    drive = TABLE_I.with_effects(effect("Backlash", ratio=0.3))
    assert float(contact(drive.load_side, jnp.asarray([4.9e-5, 0.1]))[0]) == 0.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_flanks_of_a_gap_push_and_never_pull(side):
    """A load that leaves its flank faster than the spring follows: a damper would hold it back, a flank cannot."""
    leaving = side * jnp.asarray([6e-5, -0.1])
    gap = TABLE_I.with_effects(effect("Backlash", ratio=0.3, damping=0.5))
    spring = TABLE_I.with_effects(effect("FlexibleTransmission", ratio=0.3, damping=0.5))
    assert [float(one) for one in contact(gap.load_side, leaving)] == [0.0, 0.0]
    assert side * float(contact(gap.load_side, leaving * jnp.asarray([1.0, -1.0]))[0]) < 0.0
    assert side * float(contact(spring.load_side, leaving)[0]) > 0.0


def test_the_friction_of_a_load_in_its_gap_slows_the_load_alone():
    """A motor that runs on, a load that flies: w' = -drag v2, and the motor feels nothing."""
    drive = TABLE_I.with_effects(effect("Backlash", ratio=0.3, gap=1.0, drag=4.0))
    a1, (d_rate, w_rate) = two_inertias(drive, jnp.asarray(0.0), jnp.asarray(0.2), jnp.asarray([0.1, 0.05]))
    assert float(a1) == 0.0
    assert float(d_rate) == 0.05
    assert float(w_rate) == pytest.approx(-4.0 * 0.25)


# All of them


@pytest.mark.parametrize(
    "form", some_slow(FORMS, ("MaxwellSlip", "DwellStrengthening", "FlexibleTransmission"))
)
def test_every_strength_and_state_has_a_derivative_at_zero(form):
    """At rest (v = 0, z = 0, u = 0 exactly) and in motion, by both modes: of a step of the scheme."""
    names = [parameter.name for parameter in FORMS[form].strengths]
    size = SMALL.get(form, 0.01)

    def step(strengths, start, u):
        drive = TABLE_I.with_effects(effect(form, **dict(zip(names, size * strengths, strict=True))))
        push = drive.applied_force(u, DT)[-1]
        state = advance(drive, drive.bristles(), initial_state(drive, *start), push, DT, 1)
        return jnp.stack([1e5 * drive.measured(state.x, DT, state.hidden), 1e2 * state.v, 1e5 * state.z[0]])

    @jax.jit
    @jax.vmap
    def derivatives(start, u):
        zero = jnp.zeros(len(names))
        return jax.jacfwd(step, (0, 1))(zero, start, u), jax.jacrev(step, (0, 1))(zero, start, u)

    starts = jnp.asarray([[0.0, 0.0, 0.0], [1e-5, 7e-4, 1e-5]])
    forward, reverse = derivatives(starts, jnp.asarray([[0.0, 0.0], [-0.2, 0.9]]))
    for one, other in zip(forward, reverse, strict=True):
        assert bool(jnp.all(jnp.isfinite(one)))
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
