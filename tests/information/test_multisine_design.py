"""A multisine whose lines are optimised: against its start, against Fisher information, and by its gradient."""

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from helpers_information import RATE
from helpers_plants import PLANTS, ROTARY, effect

from frictionjax.core import InputError
from frictionjax.core.safe import real
from frictionjax.excitation import multisine
from frictionjax.information import (
    fisher_information,
    multisine_design,
    optimise_multisine,
    rank_experiments,
)
from frictionjax.information.criteria import Question
from frictionjax.information.planned import layout_of
from frictionjax.information.signal_shape import SignalShape, lines_of

N_DESIGN, LINES = 300, [10.0 * np.arange(1, 40, 4)]


def start(drive, level=0.2):
    """A flat multisine of ten lines below break-away, and the noise of `plan`."""
    f = drive.friction
    u = multisine(jax.random.key(2), N_DESIGN, RATE, LINES[0], level * float(f.Fs / drive.motor_constant))
    return np.asarray(u), 1e-3 * float(f.Fs / f.sigma0)


def rms(u):
    return float(np.sqrt(np.mean(u**2)))


@pytest.mark.parametrize(
    ("criterion", "of"), [("D", None), ("parameter", "sigma1"), ("A", ("sigma0", "sigma1"))]
)
def test_it_beats_the_flat_start_of_the_same_power(criterion, of):
    u, noise = start(ROTARY)
    found = optimise_multisine(ROTARY, u, RATE, noise, criterion=criterion, of=of, steps=12)
    assert rms(found.u) == pytest.approx(rms(u), rel=1e-12)
    both = rank_experiments(ROTARY, {"u": found.u, "flat": u}, RATE, noise, criterion=criterion, of=of)
    # Confirmed by the verb that ranks, which knows nothing of lines.
    gains = {one.name: one.gain for one in both.entries}
    assert both.best.name == "u"
    assert found.after == pytest.approx(gains["u"], rel=1e-9)
    assert found.before == pytest.approx(gains["flat"], rel=1e-9)
    assert found.history[0] == found.before and found.history[-1] == found.after
    assert np.all(np.diff(found.history) >= 0.0)
    informed = fisher_information(ROTARY, found.u, RATE, noise)
    assert found.std_after == pytest.approx(informed.std)
    assert found.std_before == pytest.approx(fisher_information(ROTARY, u, RATE, noise).std)
    np.testing.assert_allclose(found.information.matrix, informed.matrix, rtol=1e-9)
    if criterion == "D":
        assert found.after > found.before + 3.0
    else:
        assert all(found.std_after[name] < 0.8 * found.std_before[name] for name in np.atleast_1d(of))


def test_the_gradient_is_that_of_finite_differences():
    u, noise = start(ROTARY)
    lines, amplitude, phase = lines_of(u)
    theta = np.concatenate([np.log(amplitude), phase])
    layout = layout_of(ROTARY, None)
    judge = Question("parameter", ("sigma1", "Fs")).criterion(tuple(one.label for one in layout), np.ones(7))
    shape = SignalShape(real(np.zeros(N_DESIGN)), jnp.asarray(lines), real(rms(u)), jnp.asarray(False))
    rest = (real(0.0), real(0.0))
    problem = multisine_design._DesignProblem(
        ROTARY, 1.0 / real(RATE), real(noise), rest, real(np.zeros((7, 7)))
    )

    def value(theta):
        return multisine_design._value_and_slope(layout, judge, shape, 2, problem, real(theta))

    slope, step = np.asarray(value(theta)[1]), 1e-5
    ends = [
        [float(value(theta + sign * step * row)[0]) for sign in (1.0, -1.0)] for row in np.eye(theta.size)
    ]
    expected = np.asarray([(up - down) / (2.0 * step) for up, down in ends])
    np.testing.assert_allclose(slope, expected, atol=1e-5 * np.max(np.abs(expected)))
    # More of all amplitudes is the same signal.
    assert abs(np.sum(slope[: lines.size])) < 1e-9 * np.max(np.abs(slope))


def test_phases_and_a_limit_of_the_peak():
    u, noise = start(ROTARY)
    peak, reported = 1.2 * float(np.max(np.abs(u))), []
    given = {"peak": peak, "steps": 6}
    held = optimise_multisine(ROTARY, u, RATE, noise, **given)
    moved = optimise_multisine(
        *(ROTARY, u, RATE, noise), optimise_phases=True, progress=lambda *what: reported.append(what), **given
    )
    for found in (held, moved):
        assert np.max(np.abs(found.u)) == pytest.approx(peak, rel=1e-12) == found.peaks["u"]
        t = np.arange(N_DESIGN) / RATE
        waves = np.cos(2.0 * np.pi * found.frequency[:, None] * t + found.phases[:, None])
        np.testing.assert_allclose(found.amplitudes @ waves, found.u, atol=1e-12)
    np.testing.assert_allclose(held.phases, lines_of(u)[2], atol=1e-9)
    assert moved.before == held.before < held.after < moved.after
    assert (
        reported[0] == ("multisine: compiling", 0.0)
        and reported[-1][1] <= 1.0
        and reported[2][0] == "multisine: step 1 of 12"
    )


def test_what_is_known_already_is_not_asked_again():
    u, noise = start(ROTARY)
    known = fisher_information(ROTARY, [u] * 4, RATE, noise)
    found = optimise_multisine(ROTARY, u, RATE, noise, known=known, steps=6)
    fresh = optimise_multisine(ROTARY, u, RATE, noise, steps=6)
    ranked = rank_experiments(ROTARY, {"u": found.u, "fresh": fresh.u}, RATE, noise, known=known)
    assert found.before < fresh.before and found.after > found.before + 3.0
    assert ranked.entries[0].gain == pytest.approx(max(found.after, ranked.entries[-1].gain), rel=1e-6)
    assert found.std_after == pytest.approx((known + fisher_information(ROTARY, found.u, RATE, noise)).std)
    assert "nats" in found.sentence and "least standard deviations" in found.sentence


def test_other_numbers_compile_nothing():
    u, noise = start(ROTARY)
    optimise_multisine(ROTARY, u, RATE, noise, steps=1)
    before = multisine_design._value_and_slope._cached._cache_size()
    drive = PLANTS["stage"]
    u, noise = start(drive)
    known = fisher_information(drive, u, 1500.0, noise)
    found = optimise_multisine(
        *(drive, u, 1500.0, noise),
        criterion="A",
        of="J",
        known=known,
        rms=0.5 * rms(u),
        optimise_phases=True,
        steps=2,
    )
    optimise_multisine(drive, u, RATE, noise, peak=0.1, steps=1)
    assert multisine_design._value_and_slope._cached._cache_size() == before
    assert rms(found.u) == pytest.approx(0.5 * rms(u), rel=1e-12)


@pytest.mark.slow
def test_strengths_of_effects_may_be_asked_for():
    u, noise = start(ROTARY)
    drive = ROTARY.with_effects(effect("ConstantLoad", load=1e-3))
    found = optimise_multisine(drive, u, RATE, noise, criterion="parameter", of="load", steps=5)
    assert found.std_after["load"] < found.std_before["load"]


T = np.arange(N_DESIGN) / RATE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"start": np.zeros(N_DESIGN)}, "zero throughout"),
        ({"start": np.full(N_DESIGN, np.nan)}, "`start`.*not finite"),
        ({"start": np.ones(1)}, "`start`.*n at least 2"),
        ({"start": 1e-3 + 1e-3 * np.sin(2.0 * np.pi * 20.0 * T)}, "has a mean.*Remove it"),
        ({"start": 1e-3 * (-1.0) ** np.arange(N_DESIGN)}, "half of the sample rate"),
        ({"start": 1e-3 * np.sin(2.0 * np.pi * 20.0 * T)}, "one line.*more lines"),
        ({"start": np.sin(np.arange(2e4))}, "20000 samples.*at most 16384"),
        ({"rms": 1.0, "peak": 1.0}, "`rms`, `peak`.*Give one"),
        ({"rms": -1.0}, "`rms`.*positive"),
        ({"peak": np.inf}, "`peak`.*positive"),
        ({"steps": 0}, "`steps`.*at least one"),
        ({"criterion": "E"}, 'Choose "D"'),
        ({"criterion": "parameter", "of": "sigma3"}, "sigma3.*Name some of J"),
        ({"noise": -1.0}, "`noise`.*positive"),
        ({"known": "another"}, "`known`.*free"),
        ({"rms": 1e300}, "not finite"),
    ],
)
def test_bad_input_is_a_sentence(change, words, monkeypatch):
    # Some of it is of a wrong type, also for a run in which types are checked.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    u, noise = start(ROTARY)
    given = {"start": u, "noise": noise} | change
    if given.get("known") == "another":
        given["known"] = fisher_information(PLANTS["stage"], u, RATE, noise)
    with pytest.raises(InputError, match=words):
        optimise_multisine(ROTARY, sample_rate=RATE, **given)
