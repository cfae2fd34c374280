"""The observer: its innovation under the true model, and its way back from a wrong start."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import FORMS, LARGE, STAGE, TABLE_I, effect
from scipy.signal import lfilter

from frictionjax.physics import VelocityOffset
from frictionjax.simulation import (
    innovation_gain,
    innovations,
    left_by_observer,
    observe,
    observer_gains,
    residual_force,
    sensor_noise,
    simulate,
)
from frictionjax.simulation.observer import corrected
from frictionjax.simulation.ros2 import DriveState

observe, innovations = eqx.filter_jit(observe), eqx.filter_jit(innovations)

RATE, N = 2000.0, 8000
DT = jnp.asarray(1.0 / RATE)
ZERO = (jnp.zeros(()),) * 3


def test_gains_put_a_double_pole():
    gains = observer_gains(100.0, 1.0 / RATE)
    pole = np.exp(-2 * np.pi * 100.0 / RATE)
    # Free mass: error dynamics [[1 - l1, dt], [-l2, 1]] up to the order of correction and step.
    l1, l2 = float(gains.position), float(gains.velocity)
    step = np.array([[1.0, 1.0 / RATE], [0.0, 1.0]]) @ np.array([[1.0 - l1, 0.0], [-l2, 1.0]])
    np.testing.assert_allclose(np.linalg.eigvals(step), pole, atol=1e-7)


def test_innovation_gain_is_the_norm_of_its_impulse_response():
    p = np.exp(-2 * np.pi * 80.0 / RATE)
    impulse = np.zeros(4000)
    impulse[0] = 1.0
    response = impulse.copy()
    for k in range(4000):  # (1 - p q)^2 e = (1 - q)^2 w
        past = [(impulse[k - j], response[k - j]) if k >= j else (0.0, 0.0) for j in (1, 2)]
        response[k] = impulse[k] - 2 * past[0][0] + past[1][0] + 2 * p * past[0][1] - p * p * past[1][1]
    found = float(innovation_gain(observer_gains(80.0, 1.0 / RATE)))
    assert found == pytest.approx(np.sqrt(np.sum(response**2)), rel=1e-6)
    assert float(innovation_gain(observer_gains(1e-3, 1.0 / RATE))) == pytest.approx(1.0, abs=2e-3)


def test_of_an_integrated_velocity_the_noise_is_a_random_walk_of_the_power_of_differences():
    gains = observer_gains(np.array([80.0, 80.0]), 1.0 / RATE)
    white = np.random.default_rng(5).standard_normal((200, 2, 2000))
    noise = sensor_noise(white, np.array([True, False]))
    np.testing.assert_array_equal(noise[:, 1], white[:, 1])
    steps, differences = np.diff(noise[:, 0]), np.diff(white[:, 0])
    assert np.mean(steps**2) / np.mean(differences**2) == pytest.approx(1.0, abs=0.02)
    found = np.array([left_by_observer(one, gains) for one in noise])[..., 1000:]
    expected = np.asarray(innovation_gain(gains, np.array([True, False])))
    powers = np.mean(found**2, axis=2)
    error = np.std(powers, axis=0) / np.sqrt(len(powers))
    assert np.all(np.abs(powers.mean(axis=0) - expected**2) < 4.0 * error)
    assert np.all(error < 0.02 * expected**2)


@pytest.fixture(scope="module")
def sliding():
    """The stage in motion: a force well above break-away that changes slowly, started at its steady speed."""
    t = np.arange(N) / RATE
    u = (1.0 + 1.3 + 0.15 * np.sin(2 * np.pi * 1.0 * t)) * float(STAGE.friction.Fc / STAGE.motor_constant)
    run = simulate(STAGE, u, RATE, v0=0.5, z0=float(STAGE.friction.Fc / STAGE.friction.sigma0), substeps=1)
    return STAGE.applied_force(jnp.asarray(u), DT), run


def _start(run):
    return run.x[0], run.v[0], run.z[0, 0]


def test_with_the_true_model_and_no_noise_there_is_nothing_to_correct(sliding):
    force, run = sliding
    seen = observe(STAGE, force, run.x, DT, observer_gains(100.0, DT), _start(run))
    assert float(jnp.max(jnp.abs(seen.innovation))) < 1e-14
    np.testing.assert_allclose(seen.v, run.v, rtol=1e-9)


SLIPPING = {
    "NonlinearBristleByDeflection": {"hardening": 0.4},
    "NonlinearBristle": {"hardening": 0.4},
    "SharpYield": {"exponent_change": 2.0},
    "ElastoPlastic": {"plasticity": 0.8},
}


@pytest.mark.parametrize("form", SLIPPING)
def test_a_bristle_follows_with_what_it_does_not_lose_whatever_its_law(form):
    """A slow ramp through break-away: a sliding bristle that is corrected pulls the observer back, and holds it."""
    drive = STAGE.with_effects(effect(form, **SLIPPING[form]))
    push = jnp.linspace(0.0, 1.1, N) * STAGE.friction.Fs / STAGE.motor_constant
    run = simulate(drive, push, RATE, substeps=4)
    noise = 2e-7 * np.random.default_rng(3).normal(size=N)
    force, gains = drive.applied_force(push, DT), observer_gains(100.0, DT)
    found = innovations(drive, force, run.x + noise, DT, gains, ZERO)
    assert float(jnp.max(jnp.abs(run.v))) > 5.0 * float(STAGE.friction.vs)
    assert float(jnp.sqrt(jnp.mean(found**2))) / 2e-7 == pytest.approx(
        float(innovation_gain(gains)), rel=0.02
    )


@pytest.mark.parametrize("bandwidth", [40.0, 150.0])
def test_innovation_of_white_noise_is_the_gain_times_the_noise(sliding, bandwidth):
    force, run = sliding
    noise = 2e-7 * np.random.default_rng(3).normal(size=N)
    found = np.asarray(
        innovations(STAGE, force, run.x + noise, DT, observer_gains(bandwidth, DT), _start(run))
    )
    ratio = np.sqrt(np.mean(found**2)) / 2e-7
    # Standard error of a mean square over correlated samples, from their own autocorrelation.
    correlation = np.correlate(found, found, "full")[N - 1 : N + 199] / np.sum(found**2)
    effective = N / (1.0 + 2.0 * np.sum(correlation[1:] ** 2))
    stderr = ratio / np.sqrt(2.0 * effective)
    assert abs(ratio - float(innovation_gain(observer_gains(bandwidth, 1.0 / RATE)))) < 3.0 * stderr
    assert stderr < 0.02 * ratio


def test_the_drift_of_an_integrated_velocity_bends_no_bristle():
    """A machine that sticks under a constant force, and a sensor whose integral wanders by several of its bends."""
    bend = float(STAGE.friction.Fs / STAGE.friction.sigma0)
    force = jnp.full(N, 0.5 * float(STAGE.friction.Fs))
    walk = sensor_noise(np.random.default_rng(4).standard_normal((1, N)), np.array([True]))[0]
    walk *= 5.0 * bend / np.max(np.abs(walk))
    start = (jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(0.5 * bend))
    found = [
        observe(drive, force, jnp.asarray(walk), DT, observer_gains(20.0, DT), start)
        for drive in (STAGE.with_effects(VelocityOffset()), STAGE)
    ]
    own, plain = (np.ptp(seen.z[:, 0]) / bend for seen in found)
    assert own < 0.3 and plain > 0.5, (own, plain)


def test_innovations_are_those_of_observe(sliding):
    force, run = sliding
    noisy = run.x + 1e-6 * np.sin(np.arange(N))
    gains = observer_gains(100.0, DT)
    seen = observe(STAGE, force, noisy, DT, gains, _start(run), substeps=2)
    alone = innovations(STAGE, force, noisy, DT, gains, _start(run), substeps=2)
    np.testing.assert_allclose(alone, seen.innovation, atol=1e-18)
    np.testing.assert_allclose(seen.innovation, noisy - seen.x, atol=1e-18)


def test_the_residual_force_ends_with_the_measurement(sliding):
    """What fills a recording up to the length of another is no motion that stopped at once."""
    force, run = sliding
    padded = [jnp.pad(signal, (0, 500), mode="edge") for signal in (force, run.x)]
    short = residual_force(STAGE, force, run.x, DT, 25.0, _start(run))
    long = residual_force(STAGE, *padded, DT, 25.0, _start(run), measured=force.size)
    np.testing.assert_array_equal(long[: force.size], short)
    stopped = residual_force(STAGE, *padded, DT, 25.0, _start(run))[: force.size]
    assert np.max(np.abs(stopped - short)) > 100.0 * np.max(np.abs(short))


@pytest.mark.parametrize(
    ("ratio", "frequency", "damping"),
    [(0.77, 15.0, 0.02), (0.5, 20.0, 0.02), (0.77, 60.0, 1.0), (0.5, 5.0, 0.02)],
)
def test_the_residual_force_of_coupled_inertias_is_found(ratio, frequency, damping):
    """Resonances within and above the bandwidth of the observer, light and overdamped."""
    coupled = STAGE.with_effects(
        effect("FlexibleTransmission", ratio=ratio, frequency=frequency, damping=damping)
    )
    t = np.arange(N) / RATE
    u = 20.0 * np.sin(2.0 * np.pi * 1.1 * t)  # V: twenty times Coulomb friction
    missing = 25.0 * (1.0 - np.cos(np.pi * t))  # N
    run = simulate(coupled, u + missing / 28.0, RATE)
    force = coupled.applied_force(jnp.asarray(u), DT)
    found = np.asarray(residual_force(coupled, force, run.x, DT, 25.0, _start(run), substeps=2))
    later = slice(N // 5, -N // 10)
    left, there = (np.sqrt(np.mean(one[later] ** 2)) for one in (found - missing, missing))
    assert left < 0.1 * there


def test_a_wrong_initial_velocity_is_forgotten(sliding):
    force, run = sliding
    x0, v0, z0 = _start(run)
    seen = observe(STAGE, force, run.x, DT, observer_gains(100.0, DT), (x0, v0 - 0.3, z0))
    error = np.abs(np.asarray(seen.v - run.v))
    assert error[0] == pytest.approx(0.3)
    assert error[50] < 1e-3  # eight time constants of the pole
    assert error[400] < 1e-8


def test_a_wrong_bristle_in_stick_is_forgotten():
    """A drive held in presliding by noise: the bristle is corrected with the machine."""
    u = 0.3 * np.random.default_rng(5).normal(size=2000)
    run = simulate(TABLE_I, u, RATE, substeps=1)
    seen = observe(
        TABLE_I, jnp.asarray(u), run.x, DT, observer_gains(100.0, DT), (*ZERO[:2], jnp.asarray(3e-6))
    )
    assert float(jnp.max(jnp.abs(seen.innovation[-500:]))) < 0.02 * float(jnp.max(jnp.abs(seen.innovation)))


def test_it_runs_in_batches_and_has_derivatives(sliding):
    force, run = sliding
    force, x = force[:200], run.x[:200]

    def power(bandwidth):
        return jnp.sum(
            innovations(STAGE, force, x + 1e-6, DT, observer_gains(bandwidth, DT), _start(run)) ** 2
        )

    powers = jax.jit(jax.vmap(power))(jnp.array([80.1, 79.9, 80.0]))
    value, slope = jax.jit(jax.value_and_grad(power))(80.0)
    assert float(powers[2]) == pytest.approx(float(value), rel=1e-9)
    assert float(slope) == pytest.approx(float((powers[0] - powers[1]) / 0.2), rel=1e-4)


def _pushes(highest, count):
    t = np.linspace(0.0, 1.0, count)
    walk = 0.5 * np.cumsum(np.random.default_rng(0).standard_normal(count)) / 40.0
    return {"ramp": 1.1 * highest * t, "sine": 1.15 * highest * np.sin(6 * np.pi * t), "walk": highest * walk}


@pytest.mark.parametrize(
    ("form", "d", "stays"),
    [("Backlash", 2e-5, True), ("Backlash", 6e-5, False), ("FlexibleTransmission", 2e-5, False)],
)
def test_a_load_in_contact_goes_along_when_the_motor_is_corrected(form, d, stays):
    """In contact d and w stay, in the gap x2 = x1 + d and v2 = v1 + w."""
    drive = STAGE.with_effects(effect(form, ratio=0.3))
    load = jnp.asarray([d, 3e-3])
    before = DriveState(jnp.asarray(0.1), jnp.asarray(0.02), jnp.zeros(()), jnp.zeros(0), load)
    after = corrected(drive, drive.bristles().slack, before, jnp.asarray(1e-6), observer_gains(100.0, DT))
    moved = jnp.stack([after.x - before.x, after.v - before.v])
    assert float(jnp.min(moved)) > 0.0
    np.testing.assert_allclose(after.hidden + float(stays) * moved, load, rtol=1e-12)


@pytest.mark.parametrize("ratio", [0.2, 0.6])
@pytest.mark.parametrize("frequency", [20.0, 45.0, 140.0])
def test_a_wrong_twist_dies_out(frequency, ratio):
    """A spring that damps a little, and an observer without the twist that the machine has: it errs as long as the
    spring rings."""
    spring = effect("FlexibleTransmission", ratio=ratio, frequency=frequency, damping=0.05, drag=1e-3)
    drive = STAGE.with_effects(spring)
    n, start = 3000, {"x0": 0.0, "v0": 0.5, "z0": float(STAGE.friction.Fc / STAGE.friction.sigma0)}
    u = jnp.full(n, 1.3 * float(STAGE.friction.Fc / STAGE.motor_constant))
    kicked = u.at[:20].add(2.0 * u[0])
    x = simulate(drive, kicked, 1.0 / DT, **start).measured
    gains, at = observer_gains(50.0, DT), tuple(jnp.asarray(value) for value in start.values())
    # The model gets half of the first push: the twist is wrong from then on.
    e = innovations(drive, drive.applied_force(0.5 * (kicked + u), DT), x, DT, gains, at)
    first, late = (float(jnp.sqrt(jnp.mean(e[span] ** 2))) for span in (slice(0, 300), slice(2000, n)))
    assert late < 0.02 * first


@pytest.mark.parametrize(
    ("form", "own"),
    [
        *(("SensorLag", {"lag": lag}) for lag in (1e-4, 1e-3, 4e-3)),
        ("FlexibleTransmission", {"ratio": 0.2, "frequency": 5.0, "damping": 0.05, "drag": 0.0}),
        ("FlexibleTransmission", {"ratio": 0.77, "frequency": 30.0, "damping": 1.0, "drag": 0.0}),
        ("FlexibleTransmission", {"ratio": 0.6, "frequency": 300.0, "damping": 0.001, "drag": 0.0}),
    ],
)
def test_noise_leaves_the_same_beside_a_late_sensor_or_a_load_as_without(form, own):
    """The response of a free mass to one wrong sample, whatever the sensor's lag, and whatever the mass is coupled to:
    (1 - q)^2 / (1 - p q)^2. With less, an effect would be credited with what it does to the observer."""
    heavy = eqx.tree_at(lambda drive: drive.J, STAGE, jnp.asarray(1e9))
    drive, gains, n, size = heavy.with_effects(effect(form, **own)), observer_gains(60.0, DT), 2000, 1e-6
    wrong = jnp.zeros(n).at[3].set(size)
    response = np.asarray(innovations(drive, jnp.zeros(n), wrong, DT, gains, ZERO)) / size
    pole = np.exp(-2.0 * np.pi * 60.0 * float(DT))
    expected = lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole, pole**2], np.asarray(wrong)) / size
    np.testing.assert_allclose(response, expected, atol=1e-6)
    assert np.linalg.norm(response) == pytest.approx(float(innovation_gain(gains)), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("form", [form for form in FORMS if form != "Backlash"])
def test_noise_alone_is_left_by_every_effect_in_its_own_observer(form):
    """In stick, at break-away, in sliding and through reversals. A gap is left out: its blows are integrated to first
    order, and the innovations show it."""
    rate, noise = 10000.0, 1e-9
    names = [strength.name for strength in FORMS[form].strengths]
    drive = TABLE_I.with_effects(effect(form, **dict(zip(names, LARGE[form], strict=True))))
    dt, gains = jnp.asarray(1.0 / rate), observer_gains(100.0, 1.0 / rate)
    highest = float(TABLE_I.friction.Fs / TABLE_I.motor_constant)
    for name, u in _pushes(highest, N).items():
        run = simulate(drive, jnp.asarray(u), rate, substeps=4)
        x = run.measured + noise * np.random.default_rng(3).standard_normal(N)
        found = innovations(drive, drive.applied_force(jnp.asarray(u), dt), x, dt, gains, ZERO)[1000:]
        ratio = float(jnp.sqrt(jnp.mean(found**2))) / noise
        assert ratio == pytest.approx(float(innovation_gain(gains)), rel=0.1), name
