"""The demo's arm moves as its equations say: step halving, linear limit, loops that close, breaks and rests."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from frictionjax.demo.arm import Arm, draw_arm
from frictionjax.demo.experiments import plan
from frictionjax.demo.motion import SAMPLE_RATE, move

ARM = draw_arm(np.random.default_rng(2002))
ELEMENTS_ONLY = dataclasses.replace(ARM, share=1.0)


def _loaded(arm, levels, rate, hold=0.1):
    """Voltage that goes slowly and softly to each of `levels` (of break-away) and stays; the last sample of each."""
    pieces, at = [], []
    for start, end in itertools.pairwise([0.0, *levels]):
        progress = np.linspace(0.0, 1.0, round(abs(end - start) / rate * SAMPLE_RATE))
        pieces += [
            start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * progress)),
            np.full(round(hold * SAMPLE_RATE), end),
        ]
        at.append(sum(piece.size for piece in pieces) - 1)
    return (arm.Fs / arm.motor_constant * np.concatenate(pieces))[:, None], at


def _friction(arm, motion):
    """Friction torque at the samples of a slow motion: what the drive gives and the inertia does not take."""
    return arm.motor_constant * motion.u - arm.J * np.gradient(motion.v, 1.0 / SAMPLE_RATE, axis=0)


@pytest.mark.parametrize("base", [False, True])
def test_half_the_step_changes_presliding_by_less_than_a_tenth_of_a_count(base):
    rng = np.random.default_rng(2002)
    arm = draw_arm(rng, base=base)
    signals = {e.name: e.signal for e in plan(arm, rng)}
    # Of the sines the last eight seconds, which reach furthest.
    sticking = [
        signals["noise_small"],
        signals["noise_large"],
        signals["stick_sine"][-16000:],
        signals["holdout_stick"],
    ]
    shortest = min(s.size for s in sticking)
    volts = np.stack([s[:shortest] for s in sticking], axis=1)
    fine, finer = (move(arm, volts, substeps=k).x for k in (20, 40))
    assert np.max(np.abs(fine - finer)) < 0.1 * arm.encoder_step
    assert np.max(np.abs(fine)) > 300.0 * arm.encoder_step


@pytest.mark.parametrize("share", [0.0, 0.8, 1.0])
def test_a_small_push_meets_a_spring_a_damper_and_the_inertia(share):
    arm = dataclasses.replace(ARM, share=share)
    u = 1e-5 * np.sin(np.arange(800) ** 2 / 4e3)[:, None]
    x = move(arm, u).x[:, 0]
    damping = arm.sigma1 + arm.sigma2
    matrices = (
        [[0.0, 1.0], [-arm.sigma0 / arm.J, -damping / arm.J]],
        [[0.0], [16.0 / arm.J]],
        [[1.0, 0.0]],
        [[0.0]],
    )
    linear = dlsim(cont2discrete(tuple(np.asarray(m) for m in matrices), 1.0 / SAMPLE_RATE), u)[1][:, 0]
    # The bristle's own softening is |z| sigma0 / Fs of its deflection; the elements have none before they slip.
    assert np.max(np.abs(x - linear)) < (1e-4 if share == 1.0 else 3e-3) * np.max(np.abs(linear))


def test_a_first_load_follows_the_elements_and_a_reversal_doubles_them():
    """Masing's rule: from a reversal on, the curve is the first load at twice its size."""
    volts, at = _loaded(ELEMENTS_ONLY, [0.9, -0.9], rate=0.2)
    motion = move(ELEMENTS_ONLY, volts)
    x, friction = motion.x[:, 0], _friction(ELEMENTS_ONLY, motion)[:, 0]
    stiffness = ELEMENTS_ONLY.sigma0 / ELEMENTS_ONLY.elements

    def first_load(deflection):
        limits = ELEMENTS_ONLY.yield_shares[:, None] * ELEMENTS_ONLY.Fs
        return np.sum(np.minimum(stiffness * deflection[None, :], limits), axis=0)

    up, down = slice(100, at[0] - 100), slice(at[0] + 100, at[1] - 100)
    tolerance = 2e-3 * ELEMENTS_ONLY.Fs
    assert np.max(np.abs(friction[up] - first_load(x[up]))) < tolerance
    branch = 0.9 * ELEMENTS_ONLY.Fs - 2.0 * first_load((x[at[0]] - x[down]) / 2.0)
    assert np.max(np.abs(friction[down] - branch)) < tolerance


def test_a_nested_loop_closes_and_the_parent_goes_on_as_if_it_had_not_been():
    with_loop, at = _loaded(ELEMENTS_ONLY, [0.9, -0.9, 0.5, -0.2, 0.5, 0.8], rate=0.5)
    without, at_plain = _loaded(ELEMENTS_ONLY, [0.9, -0.9, 0.5, 0.8], rate=0.5)
    looped, plain = move(ELEMENTS_ONLY, with_loop).x[:, 0], move(ELEMENTS_ONLY, without).x[:, 0]
    count = ELEMENTS_ONLY.encoder_step
    assert abs(looped[at[4]] - looped[at[2]]) < 0.05 * count
    assert abs(looped[at[5]] - plain[at_plain[3]]) < 0.05 * count
    # A single bristle forgets where it turned: its loop drifts by many counts.
    bristle = dataclasses.replace(ARM, share=0.0)
    drifting = move(bristle, with_loop).x[:, 0]
    assert abs(drifting[at[4]] - drifting[at[2]]) > 20.0 * count


def test_the_arm_goes_further_than_a_bristle_at_large_torque_and_as_far_at_small():
    """The paper's Fig. 6(a) and 6(b)."""
    bristle = dataclasses.replace(ARM, share=0.0)
    travel = {}
    for level in (0.02, 0.9):
        volts, _ = _loaded(ARM, [level, -level, level, -level], rate=2.0 * level)
        travel[level] = [np.ptp(move(arm, volts).x) for arm in (ARM, bristle)]
    assert travel[0.02][0] == pytest.approx(travel[0.02][1], rel=0.03)
    assert travel[0.9][0] > 1.2 * travel[0.9][1]


@pytest.mark.parametrize("share", [0.0, 0.8, 1.0])
def test_friction_takes_energy_in_every_closed_loop(share):
    arm = dataclasses.replace(ARM, share=share)
    period = round(SAMPLE_RATE / 0.5)
    levels = np.array([0.3, 0.5, 0.7, 0.9, 0.97])
    phase = 2.0 * np.pi * np.arange(3 * period) / period
    motion = move(arm, arm.Fs / arm.motor_constant * levels[None, :] * np.sin(phase)[:, None])
    # The voltage is held between samples, so that the work of the drive is a sum without error.
    power = arm.motor_constant * motion.u[:-1] * np.diff(motion.x, axis=0)
    work = power[period : 2 * period].sum(axis=0)
    assert np.all(work > 0.0)
    assert np.all(np.diff(work) > 0.0)


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_the_arm_breaks_away_slides_and_comes_to_rest(share):
    arm = dataclasses.replace(ARM, share=share)
    volts, at = _loaded(arm, [1.1, 0.0, -1.1, 0.0], rate=1.0)
    quiet = np.zeros((2000, 1))
    motion = move(arm, np.concatenate([volts, quiet]))
    x, v, scale = motion.x[:, 0], motion.v[:, 0], arm.Fs / arm.sigma0
    assert np.max(x) > 20.0 * scale
    assert x[at[3]] < np.max(x) - 20.0 * scale
    assert np.max(np.abs(x[np.argmax(volts[:, 0] > 0.8 * np.max(volts))])) < 6.0 * scale
    assert np.max(np.abs(v[-200:])) < 1e-9
    assert np.ptp(x[-200:]) < 1e-3 * arm.encoder_step


def test_steady_sliding_costs_the_stribeck_curve():
    """A long push in closed loop at constant speed: torque is s(v) + sigma2 v whatever the share."""
    speeds = np.array([0.03, 0.1, 0.5])
    reference = speeds[None, :] * np.arange(6000)[:, None] / SAMPLE_RATE
    for share in (0.0, 0.8):
        arm = dataclasses.replace(ARM, share=share, encoder_step=1e-9)
        gain = arm.J * (2.0 * np.pi * 10.0) ** 2 / arm.motor_constant
        motion = move(
            arm,
            np.zeros_like(reference),
            reference=reference,
            kp=np.full(3, gain),
            kd=np.full(3, gain / 45.0),
        )
        expected = arm.Fc + (arm.Fs - arm.Fc) * np.exp(-((speeds / arm.vs) ** 2)) + arm.sigma2 * speeds
        torque = arm.motor_constant * motion.u[-2000:].mean(axis=0)
        np.testing.assert_allclose(torque, expected, rtol=2e-3)


def test_the_nominal_arm_sticks_and_slides_as_one():
    arm = Arm()
    assert arm.yield_shares.sum() == pytest.approx(arm.share)
    assert np.all(np.diff(arm.yield_shares) > 0.0)
    assert arm.Fs / arm.sigma0 > 100.0 * arm.encoder_step
