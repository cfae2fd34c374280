"""Starting values: read off the recordings, near enough to the truth, with notes on what they do not determine."""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from helpers_estimation import (
    PLANT,
    RATE,
    VOLT,
    base_fit,
    break_away,
    closed_loop,
    experiment,
    large_noise,
    moves,
    open_loop,
    stick_noise,
    truth,
)

from frictionjax.estimation import starting_values
from frictionjax.estimation.start import driven as start_module
from frictionjax.estimation.start.sliding import fit_sliding, smooth_motion
from frictionjax.excitation import prbs
from frictionjax.physics import Drive
from frictionjax.recordings import Recording

KM = float(PLANT.motor_constant)
TRUTH = truth(PLANT)


def _away(drive):
    """Each base parameter over its true value."""
    return {name: value / TRUTH[name] for name, value in truth(drive).items()}


@pytest.fixture(scope="module")
def sliding_only():
    """Two servo recordings in which nothing shows the bristle but the reversals."""
    more = moves(positions=(-0.2, 0.1, 0.3), durations=(0.4, 0.3, 0.5))
    return closed_loop("moves", moves(), seed=4), closed_loop("more", more, seed=5)


def test_stick_and_sliding_together_show_everything():
    start = starting_values(experiment(), motor_constant=KM)
    assert start.presliding_seen
    assert start.notes == ()
    for drive in start.drives:
        away = _away(drive)
        assert away["J"] == pytest.approx(1.0, abs=0.1)
        assert away["Fc"] == pytest.approx(1.0, abs=0.15)
        assert away["Fs"] == pytest.approx(1.0, abs=0.15)
        assert away["sigma0"] == pytest.approx(1.0, abs=0.15)
        assert away["sigma1"] == pytest.approx(1.0, abs=0.3)
        assert 0.3 < away["sigma2"] < 3.0
    vs = [away["vs"] for away in map(_away, start.drives)]
    assert min(vs) < 3.0
    assert max(vs) > 1.0 / 3.0


def test_sliding_alone_shows_inertia_and_coulomb_friction(sliding_only):
    start = starting_values(sliding_only, motor_constant=KM)
    assert not start.presliding_seen
    assert start.notes == (
        "No broadband recording in stick: bristle stiffness and damping act only at reversals, "
        "and are poorly determined.",
    )
    for away in map(_away, start.drives):
        assert away["J"] == pytest.approx(1.0, abs=0.1)
        assert away["Fc"] == pytest.approx(1.0, abs=0.15)
        assert away["sigma2"] == pytest.approx(1.0, abs=0.3)
    # The stiffness is a guess, so guesses on both sides of it are offered.
    stiffness = [away["sigma0"] for away in map(_away, start.drives)]
    assert min(stiffness) < 1.0 < max(stiffness)


def test_a_known_inertia_is_kept(sliding_only):
    start = starting_values(sliding_only, motor_constant=KM, inertia=TRUTH["J"])
    assert all(float(drive.J) == TRUTH["J"] for drive in start.drives)
    assert all(away["Fc"] == pytest.approx(1.0, abs=0.15) for away in map(_away, start.drives))


def test_without_a_motor_constant_forces_are_per_input_unit(sliding_only):
    with_constant = starting_values(sliding_only, motor_constant=KM).drives[0]
    without = starting_values(sliding_only).drives[0]
    assert float(without.motor_constant) == 1.0
    for name in ("J", "Fc", "Fs", "sigma0", "sigma1", "sigma2"):
        assert truth(without)[name] == pytest.approx(truth(with_constant)[name] / KM, rel=1e-9)


def test_a_closed_loop_is_not_taken_for_a_frequency_response():
    """In a closed loop the input answers to the noise: its response is not the machine's."""
    shaken = closed_loop("shaken", 1e-4 * stick_noise(2.2), seed=8)
    start = starting_values((shaken, closed_loop("moves", moves(), seed=4)), motor_constant=KM)
    assert not start.presliding_seen


def test_noise_that_slides_is_not_taken_for_stick():
    wild = open_loop("wild", large_noise(2.2, level=4.0), seed=3)
    start = starting_values((wild, closed_loop("moves", moves(), seed=4)), motor_constant=KM)
    assert not start.presliding_seen
    # Smoothed noise, which reverses all the time, blurs inertia and Coulomb friction; a fit corrects more than that.
    assert _away(start.drives[0])["J"] == pytest.approx(1.0, abs=0.25)


@pytest.mark.untyped
@pytest.mark.parametrize(("frequency", "stiff"), [(5.5, False), (6.5, True)])
def test_a_stiffness_below_the_force_of_inertia_is_none(monkeypatch, frequency, stiff):
    """Torque ramps past break-away have a coherent response from 3 Hz on, which begins like that of a soft spring. The
    stiffness of bristles is the larger force an octave further up, and so are their resonances."""
    value = {"J": TRUTH["J"], "damping": TRUTH["sigma1"]}
    value["stiffness"] = TRUTH["J"] * (2.0 * np.pi * frequency) ** 2
    response = SimpleNamespace(
        **{name: SimpleNamespace(value=one, stderr=0.0) for name, one in value.items()}
    )
    monkeypatch.setattr(start_module, "fit_sk", lambda *_, **__: response)
    stick = open_loop("stick", stick_noise(), seed=1)
    found, _ = start_module._best_stick((stick,), (smooth_motion(stick, KM),), KM)
    assert (found is response) == stiff


def test_break_away_at_the_end_of_a_ramp_is_the_static_friction():
    recordings = (open_loop("stick", stick_noise(), seed=1), open_loop("ramps", break_away(), seed=2))
    start = starting_values(recordings, motor_constant=KM)
    assert start.presliding_seen
    assert _away(start.drives[0])["Fs"] == pytest.approx(1.0, abs=0.15)
    assert _away(start.drives[0])["Fc"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("loud", [False, True])
def test_stick_alone_bounds_the_friction_from_below(loud):
    """A machine that stays put holds the force that is applied: its static friction is no smaller."""
    stick = open_loop("stick", stick_noise(), seed=1)
    recordings = (stick, open_loop("loud", large_noise(), seed=3)) if loud else (stick,)
    start = starting_values(recordings, motor_constant=KM)
    held = KM * float(np.max(np.abs(stick.u)))
    for drive in start.drives:
        assert float(drive.J) == pytest.approx(TRUTH["J"], rel=0.1)
        assert float(drive.friction.Fs) > held
        # Damping in stick is sigma1 + sigma2: viscous friction cannot be all of it, nor more.
        assert float(drive.friction.sigma2) < 0.5 * (TRUTH["sigma1"] + TRUTH["sigma2"])


@pytest.mark.slow
def test_recordings_in_presliding_alone_are_fitted_to_the_noise():
    recordings = (open_loop("stick", stick_noise(), seed=1), open_loop("loud", large_noise(), seed=3))
    start = starting_values(recordings, motor_constant=KM)
    assert base_fit(start.drives, recordings).fitted.misfit < 0.02


def _presliding():
    """Noise, louder noise that lets the machine creep away, and sines up to break-away: nothing slides for long."""
    loud = np.asarray(prbs(jax.random.key(7), 16000, RATE, 400.0, 0.5 * VOLT))
    t = np.arange(6600) / RATE
    sine = 0.97 * VOLT * np.sin(2 * np.pi * 0.9 * t) * np.minimum(t, 1.0)
    return (
        open_loop("quiet", stick_noise(2.2), seed=1),
        open_loop("loud", loud, seed=2),
        open_loop("sine", sine, seed=3),
    )


def test_vibration_in_stick_does_not_pass_for_sliding():
    """All that is fast in such recordings is vibration, in which inertia and a viscous force may pass for all there is:
    the stiffness that noise shows is offered, too."""
    starts = [_away(drive) for drive in starting_values(_presliding(), motor_constant=KM).drives]
    near = [
        away
        for away in starts
        if all(abs(away[name] - 1.0) < 0.1 for name in ("J", "sigma0", "sigma1")) and 0.7 < away["Fs"] < 1.5
    ]
    assert near


@pytest.mark.slow
def test_presliding_alone_gives_inertia_stiffness_and_damping():
    recordings = _presliding()
    model = base_fit(starting_values(recordings, motor_constant=KM).drives, recordings)
    away = _away(model.judgement.drive)
    assert model.fitted.misfit < 0.01
    for name in ("J", "sigma0", "sigma1", "Fs"):
        assert away[name] == pytest.approx(1.0, abs=0.03), name


@pytest.mark.untyped
def test_a_stiffness_that_large_moves_make_up_does_not_pass_for_stick(sliding_only, monkeypatch):
    """So soft that the whole stroke seems to be the bending of bristles; inertia and friction explain the force."""
    value = {"J": 2.9 * TRUTH["J"], "stiffness": 1e-4 * TRUTH["sigma0"], "damping": 0.1 * TRUTH["sigma1"]}
    stick = SimpleNamespace(**{name: SimpleNamespace(value=one) for name, one in value.items()})
    monkeypatch.setattr(start_module, "_best_stick", lambda *_: (stick, 0.0))
    found = starting_values(sliding_only, motor_constant=KM)
    assert not found.presliding_seen
    away = _away(found.drives[0])
    assert away["J"] == pytest.approx(1.0, abs=0.1)
    assert away["Fc"] == pytest.approx(1.0, abs=0.1)


def test_each_start_goes_its_own_way():
    """The range of a fit is about its own start: a first one that is far away does not limit the next."""
    near = Drive(1.3 * PLANT.J, PLANT.friction, PLANT.motor_constant)
    Fc = 0.01 * PLANT.friction.Fc
    friction = dataclasses.replace(PLANT.friction, Fc=Fc, Fs=2.0 * Fc, sigma2=PLANT.friction.sigma1)
    far = Drive(PLANT.J, friction, PLANT.motor_constant)
    recordings = (open_loop("stick", stick_noise(), seed=1), open_loop("loud", large_noise(), seed=2))
    away = _away(base_fit((far, near), recordings).judgement.drive)
    for name in ("J", "sigma0", "sigma1", "Fs"):
        assert away[name] == pytest.approx(1.0, abs=0.03), name


def test_force_that_motion_does_not_explain_is_reported():
    """An input that has nothing to do with the motion."""
    rng = np.random.default_rng(1)
    t = np.arange(4400) / RATE
    x = 0.1 * np.sin(2 * np.pi * 2.0 * t)
    unrelated = Recording("unrelated", RATE, rng.standard_normal(4400), x, loop="closed")
    start = starting_values((unrelated,), motor_constant=KM)
    assert any("explain little of the force in sliding" in note for note in start.notes)
    assert all(np.isfinite(value) and value > 0 for drive in start.drives for value in truth(drive).values())


def test_least_squares_on_sliding_resists_outliers():
    recording = closed_loop("moves", moves(), seed=4)
    motion = smooth_motion(recording, KM)
    clean = fit_sliding((motion,))
    assert clean.credible
    spoiled = motion.force.copy()
    spoiled[::25] += 5.0
    rough = fit_sliding((type(motion)(motion.x, motion.v, motion.a, spoiled),))
    for name in ("J", "Fc"):
        assert getattr(rough, name) == pytest.approx(getattr(clean, name), rel=0.02)
    assert clean.offset == pytest.approx(0.0, abs=0.01 * TRUTH["Fc"])
    assert not fit_sliding((type(motion)(motion.x, motion.v, motion.a, -motion.force),)).credible


def test_a_constant_load_does_not_pass_for_friction():
    recording = closed_loop("moves", moves(), seed=4)
    motion = smooth_motion(recording, KM)
    loaded = fit_sliding((type(motion)(motion.x, motion.v, motion.a, motion.force + 0.2),))
    assert loaded.offset == pytest.approx(0.2, abs=0.01)
    assert loaded.Fc == pytest.approx(TRUTH["Fc"], rel=0.05)


def test_a_pendulum_does_not_hide_its_inertia():
    """Without the spring in the regression what gravity takes is taken for inertia, and little is explained."""
    t = np.arange(12000) / 1000.0
    x = np.sin(2.0 * t) + 0.3 * np.sin(7.0 * t)
    v, a = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    J, Fc, stiffness = 0.05, 0.4, 5.0
    u = J * a + Fc * np.sign(v) + stiffness * x
    start = starting_values((Recording("swing", 1000.0, u, x, loop="closed"),))
    # It turns back where gravity is strongest: a few samples of both.
    assert float(start.drives[0].J) == pytest.approx(J, rel=0.1)
    assert float(start.drives[0].friction.Fc) == pytest.approx(Fc, rel=0.2)
