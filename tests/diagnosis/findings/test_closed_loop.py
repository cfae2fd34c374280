"""Free runs under the own controller: a model that is right has no error there, and another has the right one."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers_estimation import PLANT

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.findings.closed_loop import closed_loops
from frictionjax.estimation.data.batch import make_batch
from frictionjax.physics.effects.gravity_pendulum import GravityPendulum
from frictionjax.recordings import Controller, Recording
from frictionjax.simulation import simulate_closed_loop

RATE = 1000.0
NOISE = 1e-5
T = np.arange(1200) / RATE
PATH = 0.3 * (1.0 - np.cos(4.0 * T))
PD = Controller(kp=5.0, kd=0.12)
HEAVY = PLANT.with_effects(GravityPendulum(0.4, 0.0))


def _recorded(name, path, drive=HEAVY, feedforward=0.0, **more):
    """What a servo records: its controller answers to the measured position, noise included."""
    noise = NOISE * np.random.default_rng(3).standard_normal(path.size)
    run = simulate_closed_loop(drive, path - noise, RATE, PD, feedforward=feedforward)
    measured = np.asarray(run.measured) + noise
    return Recording(name, RATE, np.asarray(run.u), measured, loop="closed", reference=path, **more)


def _errors(controller, recordings, **drives):
    batch = make_batch(recordings)
    scene = Scene(
        batch, np.zeros(len(recordings), bool), np.full(len(recordings), 20.0), ("",) * len(recordings)
    )
    with ThreadPoolExecutor(2) as threads:
        return closed_loops(controller, recordings, scene, drives, threads)


def test_the_right_model_is_right_and_the_other_as_far_off_as_its_own_servo():
    recording = _recorded("moves", PATH)
    silent = PLANT.with_effects(GravityPendulum(0.0, 0.0))
    (found,) = _errors(PD, (recording,), base=silent, extended=HEAVY, given=silent)
    assert found.extended == pytest.approx(NOISE, rel=0.2)  # its start is as far off as the first sample
    # Where the reference is known the other model's servo can be simulated without what was measured.
    servo = simulate_closed_loop(PLANT, PATH, RATE, PD, x0=recording.x[0])
    assert found.base == pytest.approx(np.sqrt(np.mean((servo.measured - recording.x) ** 2)), rel=1e-3)
    assert found.input_base == pytest.approx(np.sqrt(np.mean((servo.u - recording.u) ** 2)), rel=1e-2)
    assert (found.given, found.input_given) == (found.base, found.input_base)
    assert found.law == pytest.approx(1.0, abs=1e-3)


def test_feedforward_need_not_be_known():
    recording = _recorded("fed", PATH, feedforward=0.2 * np.sin(4.0 * T))
    (found,) = _errors(PD, (recording,), base=HEAVY, extended=HEAVY)
    assert found.extended == pytest.approx(NOISE, rel=0.2)
    assert found.law < 0.9 and found.given is None
    (blind,) = _errors(PD, (dataclasses.replace(recording, reference=None),), base=HEAVY, extended=HEAVY)
    assert blind.law is None and blind.extended == found.extended


def test_a_controller_of_another_rate_than_the_recorder():
    # A recorder at 50 Hz beside a servo at 1 kHz: on the line between its samples it sees the motion to some percent.
    fine = _recorded("fine", PATH)
    coarse = Recording("slow", RATE / 20.0, fine.u[::20], fine.x[::20], loop="closed", reference=PATH[::20])
    base, extended = (dataclasses.replace(drive, hold="linear") for drive in (PLANT, HEAVY))
    own = dataclasses.replace(PD, rate=RATE)
    ((right,), (wrong,)) = (_errors(one, (coarse,), base=base, extended=extended) for one in (own, PD))
    (reference,) = _errors(PD, (fine,), base=PLANT, extended=HEAVY)
    assert right.base == pytest.approx(reference.base, rel=0.1)
    assert wrong.base > 2.0 * reference.base


def test_open_loops_and_cases_without_a_controller_have_none():
    closed = _recorded("closed", PATH)
    opened = dataclasses.replace(closed, name="open", loop="open")
    found = _errors(PD, (opened, closed), base=PLANT, extended=PLANT)
    assert found[0] is None and found[1] is not None
    assert _errors(None, (opened, closed), base=PLANT, extended=PLANT) == (None, None)
