"""`fit` of imposed motions and measured friction forces: recovers known parameters, and a tribometer's loops."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import ROTARY, effect
from scipy.signal import cont2discrete

from frictionjax.core import InputError
from frictionjax.estimation import Observation, fit
from frictionjax.estimation.start.imposed import starting_values_imposed
from frictionjax.excitation import gaussian_noise
from frictionjax.frequency import FRF, estimate_frf
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects.constant_load import ConstantLoad
from frictionjax.physics.effects.maxwell_slip import MaxwellSlip
from frictionjax.physics.effects.position_dependence import PositionDependence
from frictionjax.recordings import Plant, Recording, load_case
from frictionjax.simulation import simulate, simulate_imposed

RATE = 1000.0
SAMPLES = 3000
NOISE = 2e-3
"""Standard deviation of the measured force, N m: 0.3 % of break-away."""
LAWS = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
LOST = "All motion is imposed, so inertia cannot be identified: J stays at its starting value."
HOPELESS = Drive(1.0, LuGre(sigma0=1.0, sigma1=1.0, sigma2=1.0, Fc=100.0, Fs=120.0, vs=1.0))
"""A start that is wrong by decades in everything."""


def truth(drive=ROTARY):
    return {name: float(getattr(drive.friction, name)) for name in LAWS}


def triangles():
    """Loops of ever larger stroke, from a third of the bristle's deflection to sliding, in equal times."""
    turns = [0.0, 1e-4, -1e-4, 3e-4, -3e-4, 1e-3, -1e-3, 6e-3, -6e-3, 2e-2, -2e-2, 0.0]
    return np.interp(np.arange(SAMPLES) / SAMPLES, np.linspace(0.0, 1.0, len(turns)), turns)


def sines():
    """Sliding at all speeds up to 0.3 rad/s, under a quick small motion that shows the damping of the bristle."""
    t = np.arange(SAMPLES) / RATE
    large = 0.03 * np.sin(2 * np.pi * 0.9 * t) + 6e-3 * np.sin(2 * np.pi * 3.3 * t)
    return large + 1e-4 * np.sin(2 * np.pi * 23.0 * t)


def presliding():
    """A sine that stays within a quarter of the bristle's deflection."""
    t = np.arange(SAMPLES) / RATE
    return 8e-5 * np.sin(2 * np.pi * 2.0 * t) * np.minimum(1.0, t / 2.0)


def forced(name, x, *, seed, noise=NOISE, drive=ROTARY):
    """The friction force of `drive` under the imposed motion `x`, with white noise."""
    force = np.asarray(simulate_imposed(drive, x, RATE).friction)
    force = force + noise * np.random.default_rng(seed).standard_normal(x.size)
    return Recording(name, RATE, np.zeros(x.size), x, drive="motion", force=force)


def loops(seed=0, drive=ROTARY):
    return forced("triangles", triangles(), seed=2 * seed, drive=drive), forced(
        "sines", sines(), seed=2 * seed + 1, drive=drive
    )


def off(seed, most=0.3, drive=ROTARY):
    """`drive` with every parameter of its friction up to 30 % off."""
    factors = np.exp(np.log1p(most) * np.random.default_rng(seed).uniform(-1.0, 1.0, len(LAWS)))
    numbers = {
        name: value * factor for (name, value), factor in zip(truth(drive).items(), factors, strict=True)
    }
    numbers["Fs"] = max(numbers["Fs"], 1.02 * numbers["Fc"])
    return eqx.tree_at(lambda d: d.friction, drive, LuGre(**numbers))


def away(found, names=LAWS, drive=ROTARY):
    """Distance from the truth in stated standard errors, of what must be identified."""
    for name in names:
        assert found.parameters[name].identified, name
    return np.array([(found.parameters[n].value - truth(drive)[n]) / found.stderr[n] for n in names])


@pytest.fixture(scope="module")
def fitted():
    return fit(off(0), loops(), own_starts=False)


def test_the_truth_is_recovered_from_starts_that_are_off(fitted):
    for found in (fitted, *(fit(off(seed), loops(), own_starts=False) for seed in (1, 2, 3))):
        assert found.success and not found.at_bounds
        assert np.all(np.abs(away(found)) < 4.0), dict(zip(LAWS, away(found), strict=True))
        assert found.cost == pytest.approx(fitted.cost, abs=2.0)
    worst = max(fitted.stderr[name] / value for name, value in truth().items())
    assert worst < 0.03


def test_the_truth_is_recovered_from_own_starts(fitted):
    """What the user guessed does not matter, be it decades off."""
    found = fit(HOPELESS, loops())
    assert np.all(np.abs(away(found)) < 4.0)
    assert found.cost == pytest.approx(fitted.cost, abs=2.0)


@pytest.mark.slow
def test_each_motion_alone_is_enough():
    for recording in loops():
        found = fit(HOPELESS, [recording])
        assert np.all(np.abs(away(found)) < 4.0), recording.name


def test_the_noise_is_found(fitted):
    for name in ("triangles", "sines"):
        assert fitted.noise[name].position == pytest.approx(NOISE, rel=0.1)
        assert fitted.noise[name].power == pytest.approx(1.0, abs=0.01)
        assert fitted.noise[name].push == 0.0


def test_a_known_noise_is_kept(fitted):
    """Four times the noise: four times the standard errors, where the sandwich does not say more."""
    data = [Observation(one, noise=4.0 * NOISE) for one in loops()]
    found = fit(off(0), data, own_starts=False)
    for name in ("triangles", "sines"):
        assert found.noise[name].position == 4.0 * NOISE
    ratio = np.sqrt(np.diag(found.covariance_white) / np.diag(fitted.covariance_white))
    np.testing.assert_allclose(ratio, 4.0, rtol=0.05)


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_experiments(fitted):
    """Twenty draws of the noise: scatter over stated error, judged by the scatter's own standard error."""
    count = 20
    fits = [fit(ROTARY, loops(seed), own_starts=False) for seed in range(count)]
    z = np.array([away(found) for found in fits])
    scatter = np.sqrt(np.mean(z**2, axis=0))
    # The root mean square of 20 standard normal numbers is 1 +- 0.16.
    assert np.all(scatter < 1.0 + 3.5 / np.sqrt(2.0 * count)), scatter
    assert np.all(scatter > 0.4), scatter
    assert np.all(np.abs(np.mean(z, axis=0)) < 4.0 / np.sqrt(count))
    levels = np.array([[found.noise[name].position for name in ("triangles", "sines")] for found in fits])
    assert np.mean(levels) == pytest.approx(NOISE, rel=0.01)


def test_the_force_that_moves_a_known_mass_is_taken_off():
    """The friction is that of a fit to the friction alone."""
    plain = forced("sines", sines(), seed=1)
    part = 2 * np.pi * np.array([0.9, 3.3, 23.0])
    t = np.arange(SAMPLES)[:, None] / RATE
    mass = 0.05 * np.sin(part * t) @ (-(part**2) * np.array([0.03, 6e-3, 1e-4]))
    heavy = dataclasses.replace(plain, force=np.asarray(plain.force) + mass, plant=Plant(inertia=0.05))
    start = eqx.tree_at(lambda d: d.J, off(0), jnp.asarray(0.05))
    alone, found = (fit(start, [one], own_starts=False) for one in (plain, heavy))
    assert np.all(np.abs(away(found)) < 4.0)
    assert "is taken off the measured force" in found.message
    for name in LAWS:
        assert found.parameters[name].value == pytest.approx(
            alone.parameters[name].value, abs=0.5 * alone.stderr[name]
        )


@pytest.mark.slow
def test_inertia_is_kept_and_the_message_says_so(fitted):
    assert "J" not in fitted.parameters
    assert float(fitted.drive.J) == float(ROTARY.J)
    assert LOST in fitted.message
    assert LOST not in fit(ROTARY, loops(), known_inertia=True, own_starts=False).message
    asked = fit(ROTARY, loops(), free=("J", "Fc", "Fs"), own_starts=False)
    assert asked.names == ("Fc", "Fs") and LOST in asked.message


@pytest.mark.slow
def test_inertia_bounds_nothing():
    """sigma0 and sigma1 are fitted as ratios to J: what is arbitrary must not bound them."""
    for J in (1e-9, 1e9):
        start = eqx.tree_at(lambda d: d.J, off(1), jnp.asarray(J))
        found = fit(start, loops(), own_starts=False)
        assert np.all(np.abs(away(found)) < 4.0)
        assert float(found.drive.J) == J


@pytest.mark.slow
def test_a_prior_of_the_inertia_is_kept():
    found = fit(ROTARY, loops(), priors={"J": (0.03, 0.001)}, own_starts=False)
    assert found.parameters["J"].value == pytest.approx(0.03, rel=0.01)
    assert found.stderr["J"] == pytest.approx(0.001, rel=0.1)
    assert np.all(np.abs(away(found)) < 4.0)


def in_stick(seed=0):
    """The frequency response of the plant in stick, from simulated noise at a fiftieth of break-away."""
    volt = float(ROTARY.friction.Fs / ROTARY.motor_constant)
    rate = 2000.0
    u = np.asarray(gaussian_noise(jax.random.key(seed), 40000, rate, 300.0, 0.02 * volt))
    x = np.asarray(simulate(ROTARY, u, rate).x) + 2e-8 * np.random.default_rng(seed).standard_normal(u.size)
    return estimate_frf(u, x, rate, segment=4096)


def linear(seed=0, part=0.01):
    """The exact response of the plant linearised at rest under a held input, with noise of `part` of its size."""
    law, rate = ROTARY.friction, 2000.0
    J, damping, stiffness = float(ROTARY.J), float(law.sigma1 + law.sigma2), float(law.sigma0)
    a = np.array([[0.0, 1.0], [-stiffness / J, -damping / J]])
    b = np.array([[0.0], [float(ROTARY.motor_constant) / J]])
    a, b, c, *_ = cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 1.0 / rate)
    frequency = np.arange(3.0, 300.0, 3.0)
    z = np.exp(2j * np.pi * frequency / rate)
    exact = np.array([(c @ np.linalg.solve(one * np.eye(2) - a, b))[0, 0] for one in z])
    rng, std = np.random.default_rng(seed), part * np.abs(exact)
    noise = std * (rng.standard_normal(std.size) + 1j * rng.standard_normal(std.size))
    one = jnp.ones(())
    return FRF(
        frequency=jnp.asarray(frequency),
        response=jnp.asarray(exact + noise),
        coherence=jnp.full(std.size, 0.99),
        std=jnp.asarray(std),
        averages_effective=20.0 * one,
        sample_rate=rate * one,
        bin_correlation=one,
    )


@pytest.mark.slow
@pytest.mark.parametrize("own", [False, True])
def test_a_response_in_stick_adds_the_inertia(own):
    start = eqx.tree_at(lambda d: d.J, off(2), 1.25 * ROTARY.J)
    if own:
        start = eqx.tree_at(lambda d: d.motor_constant, HOPELESS, ROTARY.motor_constant)
    found = fit(start, (*loops(), linear()), own_starts=own)
    assert found.parameters["J"].identified
    assert found.parameters["J"].value == pytest.approx(float(ROTARY.J), abs=4.0 * found.stderr["J"])
    assert found.stderr["J"] < 0.01 * float(ROTARY.J)
    assert np.all(np.abs(away(found)) < 4.0)
    assert LOST not in found.message


@pytest.mark.slow
def test_a_measured_response_adds_the_inertia():
    """The window of the response and a bristle that is not quite linear leave a bias of some tenths of a percent."""
    start = eqx.tree_at(lambda d: d.J, off(2), 1.25 * ROTARY.J)
    found = fit(start, (*loops(), Observation(in_stick(), band=(3.0, 300.0))), own_starts=False)
    assert found.parameters["J"].value == pytest.approx(float(ROTARY.J), rel=0.005)
    for name, value in truth().items():
        assert found.parameters[name].value == pytest.approx(value, rel=0.05), name


@pytest.mark.slow
def test_effects_are_found_in_forces():
    """A constant load, and half of the stiffness in elements that stick and slip."""
    drive = ROTARY.with_effects(
        effect("MaxwellSlip", share=0.5, spread=1.2), effect("ConstantLoad", load=0.05)
    )
    start = off(3).with_effects(effect("MaxwellSlip", share=0.1), effect("ConstantLoad"))
    found = fit(start, loops(drive=drive), own_starts=False)
    assert np.all(np.abs(away(found)) < 4.0)
    for name, value in {"share": 0.5, "spread": 1.2, "load": 0.05}.items():
        one = found.parameters[name]
        assert one.identified and abs(one.value - value) < 4.0 * one.stderr, name


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1e3, 1e-3), (1e-6, 1e6)])
def test_starting_values_know_no_units(scale):
    """Position and force in other units: the same plant, and every start within an order of magnitude or so."""
    length, force = scale
    data = []
    for one in loops():
        data.append(
            eqx.tree_at(
                lambda r: (r.x, r.force), one, (length * np.asarray(one.x), force * np.asarray(one.force))
            )
        )
    start = starting_values_imposed(tuple(data))
    assert start.presliding_seen and start.notes == ()
    stiffness = [float(one.friction.sigma0) * length / force / truth()["sigma0"] for one in start.drives]
    assert min(stiffness) < 1.3 and max(stiffness) > 0.7
    for one in start.drives:
        assert float(one.J) == 1.0
        assert float(one.friction.Fc) / force == pytest.approx(truth()["Fc"], rel=0.15)
        assert float(one.friction.Fs) / force == pytest.approx(truth()["Fs"], rel=0.2)
        assert 0.1 < float(one.friction.vs) / length / truth()["vs"] < 10.0
        assert 0.0 < float(one.friction.sigma2) * length / force < 30.0 * truth()["sigma2"]


@pytest.mark.parametrize("motion", ["sine", "triangle", "slow", "dwelling", "backwards"])
@pytest.mark.parametrize("stroke", [1e-3, 1e-2, 0.3])
def test_starting_values_of_any_motion(motion, stroke):
    t = np.arange(4000) / RATE
    cycle = np.arcsin(np.sin(2 * np.pi * t)) / (0.5 * np.pi)
    x = (
        stroke
        * {
            "sine": np.sin(2 * np.pi * t),
            "triangle": cycle,
            "slow": np.sin(2 * np.pi * 0.3 * t),
            "dwelling": np.clip(2.0 * cycle, -1.0, 1.0),
            "backwards": -cycle,
        }[motion]
    )
    start = starting_values_imposed((forced(motion, x, seed=1),))
    for one in start.drives:
        assert 0.75 < float(one.friction.Fc) / truth()["Fc"] < 1.6
        assert 0.75 < float(one.friction.Fs) / truth()["Fs"] < 2.1
    if stroke < 0.1:  # a fast large motion passes the bristle's deflection within a sample
        stiffness = [float(one.friction.sigma0) / truth()["sigma0"] for one in start.drives]
        assert min(stiffness) < 2.0 and max(stiffness) > 0.5


@pytest.mark.slow
def test_presliding_alone_shows_the_bristle():
    recording = forced("presliding", presliding(), seed=5, noise=5e-4)
    start = starting_values_imposed((recording,))
    assert start.presliding_seen and "No motion slides" in start.notes[0]
    for one in start.drives:
        assert float(one.friction.Fs) > 0.9 * float(np.max(np.abs(recording.force)))
    found = fit(HOPELESS, [recording])
    assert np.all(np.abs(away(found, ("sigma0", "sigma1"))) < 4.0)
    assert "No motion slides" in found.message


def test_what_cannot_be_meant_is_refused():
    good = loops()[0]
    silent = eqx.tree_at(lambda r: r.force, good, None)
    with pytest.raises(InputError, match='drive = "motion", but no measured force'):
        fit(ROTARY, [silent])
    holed = eqx.tree_at(lambda r: r.force, good, np.where(np.arange(SAMPLES) == 7, np.nan, good.force))
    with pytest.raises(InputError, match=r"`force` of `triangles` holds 1 values that are not finite"):
        fit(ROTARY, [holed])
    still = eqx.tree_at(lambda r: r.x, good, np.zeros(SAMPLES))
    with pytest.raises(InputError, match="without motion there is nothing to identify"):
        fit(ROTARY, [still])
    short = Recording("short", RATE, np.zeros(50), good.x[:50], drive="motion", force=good.force[:50])
    with pytest.raises(InputError, match="`short` has 50 samples"):
        fit(ROTARY, [short])


# The tribometer -----------------------------------------------------------------------------------------------------

TRIBOMETER = Path(__file__).parents[3] / "shared" / "real" / "tribometer" / "case.toml"
THINNED = 5
"""Samples that are averaged to one: 40 Hz of 200 Hz. The force takes a second to swing over."""


def thinned(recording, seconds=None):
    count = recording.x.size // THINNED * THINNED
    if seconds is not None:
        count = min(count, round(seconds * recording.sample_rate))
    x, force = (
        np.mean(np.reshape(channel[:count], (-1, THINNED)), axis=1)
        for channel in (recording.x, recording.force)
    )
    rate = recording.sample_rate / THINNED
    return Recording(
        recording.name, rate, np.zeros(x.size), x, role=recording.role, drive="motion", force=force
    )


def left(found, recording):
    """Root mean square of the force that `found` leaves in `recording`, after the first two seconds: the bristle's
    start is then forgotten."""
    force = np.asarray(simulate_imposed(found.drive, recording.x, recording.sample_rate).friction)
    skipped = round(2.0 * recording.sample_rate)
    return float(np.sqrt(np.mean((force - recording.force)[skipped:] ** 2)))


@pytest.fixture(scope="module")
def tribometer():
    """Fit interval and what is held out."""
    if not TRIBOMETER.exists():
        pytest.skip("the shared recordings are not here")
    case = load_case(TRIBOMETER)
    # The specimen lifts off at 99.5 s of the held-out recording.
    return thinned(case.recordings[0]), thinned(case.recordings[1], 99.0)


@pytest.mark.slow
def test_a_tribometer(tribometer):
    """One speed: nothing tells Fs from Fc, or both from vs. They are kept in proportion."""
    data, kept = tribometer
    middle, half = 0.5 * (np.max(data.x) + np.min(data.x)), 0.5 * np.ptp(data.x)
    base = Drive(1.0, LuGre(sigma0=1.0, sigma1=1.0, sigma2=1.0, Fc=1.0, Fs=1.1, vs=1e-4))
    options = {"fixed": ("vs",), "ties": {"Fs": ("Fc", 1.1)}, "units": {"force": "N", "position": "m"}}
    first = fit(base, [data], **options)
    slip = fit(first.drive.with_effects(MaxwellSlip(share=0.5)), [data], own_starts=False, **options)
    effects = (PositionDependence(center=middle, half_stroke=half), ConstantLoad())
    full = fit(slip.drive.with_effects(*effects), [data], own_starts=False, **options)
    # Newton: so much is left where the model was fitted, and as much in a recording that it never saw.
    for found, most in ((first, 0.27), (slip, 0.16), (full, 0.10)):
        assert left(found, data) < most
        assert left(found, kept) < 1.2 * most
        # The model's error is what counts as noise here.
        assert found.noise[data.name].position == pytest.approx(left(found, data), rel=0.05)
        assert LOST in found.message
    for name in ("sigma0", "Fc"):
        for found in (first, slip, full):
            one = found.parameters[name]
            assert one.identified and 1e-4 * one.value < one.stderr < 0.05 * one.value, name
