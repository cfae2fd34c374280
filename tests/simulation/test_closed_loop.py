"""The closed loop: what its controller gave, applied in an open loop, is the same motion, and the law gives it."""

import dataclasses

import jax
import numpy as np
import pytest
from helpers_plants import ROTARY

import frictionjax as fj
from frictionjax.physics.effects.delay import Delay
from frictionjax.physics.effects.drive_lag import DriveLag
from frictionjax.physics.effects.encoder_error import EncoderError
from frictionjax.recordings import Controller
from frictionjax.simulation import simulate, simulate_closed_loop

RATE = 1000.0
T = np.arange(1500) / RATE
REFERENCE = 0.4 * np.sin(2.0 * np.pi * T) + 0.1 * np.sin(9.0 * T)
PID = Controller(kp=12.0, ki=20.0, kd=0.25)


def law(controller, off, every=1, feedforward=0.0):
    """The controller's output for what the position is off, sample by sample, without a limit."""
    period = every / RATE
    held = off[np.arange(off.size) // every * every]
    before = np.append(held[:every], held[:-every])
    summed = np.cumsum(np.where(np.arange(off.size) % every == 0, off, 0.0)) * period
    return (
        feedforward + controller.kp * held + controller.ki * summed + controller.kd * (held - before) / period
    )


@pytest.mark.parametrize(
    "effects, every",
    [((), 1), ((Delay(0.0023), DriveLag(0.004)), 1), ((EncoderError(sine=1e-3, period=0.4),), 5)],
)
def test_two_roads(effects, every):
    drive = ROTARY.with_effects(*effects)
    controller = dataclasses.replace(PID, rate=None if every == 1 else RATE / every)
    feedforward = 0.3 * np.sin(5.0 * T)
    run = simulate_closed_loop(drive, REFERENCE, RATE, controller, feedforward=feedforward)
    np.testing.assert_allclose(run.u, law(PID, REFERENCE - run.measured, every, feedforward), atol=1e-9)
    np.testing.assert_allclose(simulate(drive, run.u, RATE).x, run.x, atol=1e-9)
    assert float(np.std(REFERENCE - run.x)) < 0.2 * np.std(REFERENCE)


def test_a_long_delay_of_the_input_is_remembered():
    # Of 200 samples, in a loop so soft that it stays stable.
    drive, soft = ROTARY.with_effects(Delay(0.2)), Controller(kp=0.05)
    run = simulate_closed_loop(drive, REFERENCE, RATE, soft, feedforward=0.2 * np.sin(5.0 * T))
    np.testing.assert_allclose(simulate(drive, run.u, RATE).x, run.x, atol=1e-9)
    assert float(np.ptp(run.x)) > 0.1


def test_measured_position_stands_for_the_reference():
    # The answer to what was measured, beside the recorded input, is the answer to the reference.
    machine = dataclasses.replace(ROTARY, J=1.3 * ROTARY.J)
    recorded = simulate_closed_loop(machine, REFERENCE, RATE, PID)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(T.size)
    u = law(PID, REFERENCE - (recorded.x + noise))
    of_model = simulate_closed_loop(ROTARY, recorded.x + noise, RATE, PID, feedforward=u)
    alone = simulate_closed_loop(ROTARY, REFERENCE, RATE, PID)
    np.testing.assert_allclose(of_model.x, alone.x, atol=1e-9)
    assert float(np.max(np.abs(alone.x - recorded.x))) > 1e-3


def test_limit_and_windup():
    strict = dataclasses.replace(PID, limit=2.0)
    run = simulate_closed_loop(ROTARY, np.full(T.size, 5.0), RATE, strict)
    assert float(np.max(np.abs(run.u))) == 2.0
    np.testing.assert_allclose(simulate(ROTARY, run.u, RATE).x, run.x, atol=1e-9)
    # What the integrator gathers while the input is at its limit would carry the position far beyond.
    assert float(np.max(run.x)) < 5.0 + 1.5


def test_controller_faster_than_the_recorder():
    fine = simulate_closed_loop(ROTARY, REFERENCE, RATE, PID)
    coarse = simulate_closed_loop(ROTARY, REFERENCE[::10], RATE / 10.0, dataclasses.replace(PID, rate=RATE))
    assert coarse.x.shape == (150,)
    # Between samples the reference is on the line: its curvature over 8, times the square of a sample.
    np.testing.assert_allclose(coarse.x, fine.x[::10], atol=2.0 * 24.0 / 8.0 * 1e-4)
    slower = simulate_closed_loop(ROTARY, REFERENCE[::10], RATE / 10.0, PID)
    assert np.max(np.abs(slower.x - fine.x[::10])) > 10.0 * np.max(np.abs(coarse.x - fine.x[::10]))


def test_input_on_a_line():
    # Of a model that is right the controller has nothing to correct, whatever the input does between samples.
    for hold in ("zero", "linear"):
        drive = dataclasses.replace(ROTARY.with_effects(Delay(0.0015)), hold=hold)
        u = 0.2 * np.sin(7.0 * np.maximum(T - 0.01, 0.0)) + 0.05
        recorded = simulate(drive, u, RATE)
        run = simulate_closed_loop(drive, recorded.measured, RATE, PID, feedforward=u)
        np.testing.assert_allclose(run.x, recorded.x, atol=1e-9)


def test_gains_have_derivatives():
    def end(kp):
        return simulate_closed_loop(ROTARY, REFERENCE, RATE, dataclasses.replace(PID, kp=kp)).x[-1]

    step = 1e-3
    slope = jax.jvp(end, (12.0,), (1.0,))[1]
    np.testing.assert_allclose(slope, (end(12.0 + step) - end(12.0 - step)) / (2.0 * step), rtol=1e-4)


def test_shapes_are_named():
    with pytest.raises(ValueError, match=r"shape \(2, 3\)"):
        simulate_closed_loop(ROTARY, np.zeros((2, 3)), RATE, PID)
    with pytest.raises(ValueError, match=r"`feedforward` \(3,\)"):
        simulate_closed_loop(ROTARY, np.zeros(4), RATE, PID, feedforward=np.zeros(3))


def test_shows_its_input():
    run = simulate_closed_loop(ROTARY, REFERENCE[:50], RATE, PID)
    assert "u" in run.to_dataframe().columns
    assert run.to_xarray()["u"].attrs["units"] == "input"
    assert "u" not in simulate(ROTARY, np.zeros(50), RATE).to_xarray()
    assert repr(PID) == "Controller(kp=12, ki=20, kd=0.25)"
    assert fj.simulate_closed_loop is simulate_closed_loop
