"""Base parameters from logs of a six-joint arm with friction hidden in three joints; what they leave is friction."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from helpers_six_joints import ARM, COULOMB, JOINTS, NOISE, RATE, SECONDS, STEP, fourier, measured

from frictionjax.arm import fit_rigid_body
from frictionjax.arm.smoothing import cut_off, smooth_motion
from frictionjax.core import FrictionjaxWarning, InputError

pytest.importorskip("mujoco", minversion="4.0")

WRONG = ARM.replace('mass="8.4"', 'mass="6"').replace('mass="0.9"', 'mass="0.2"').replace('"0.3"', '"0.2"')
"""The arm with a lighter link, without the load in its hand, and with smaller rotors."""


@pytest.fixture(scope="module")
def fit():
    """From the logs and a model that is wrong."""
    return fit_rigid_body(measured()[0], WRONG)


def _rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_what_is_left_of_the_torque_is_the_friction(fit):
    """To a hundredth of it, on every log and in every joint, beside the noise of the torque."""
    logs, frictions = measured()
    for log, kept, torque, friction in zip(logs, fit.logs, fit.torques, frictions, strict=True):
        edge = round((kept.start_time - log.start_time) * RATE)
        true = friction[edge : edge + kept.q.shape[0]]
        error = _rms(kept.tau - torque - true)
        assert np.all(error**2 < (NOISE * np.array(COULOMB)) ** 2 + (0.01 * _rms(true)) ** 2)
    lift = JOINTS.index("lift")
    assert fit.left("holdout", given=True)[lift] > 1.2 * fit.left("holdout")[lift]


def test_base_parameters_are_recovered(fit):
    """Each within a few of its standard errors, or a twentieth: rotors take a little of the bristles' damping."""
    true = fit.base.of(fit_rigid_body(measured()[0], ARM).arm.values)
    assert fit.determined.all()
    near = np.abs(fit.values - true) < np.maximum(4.0 * fit.stderr, 0.05 * np.abs(true))
    assert near.all(), [fit.base.names[k] for k in np.flatnonzero(~near)]
    assert np.median(np.abs(fit.values - true) / fit.stderr) < 2.0
    given = fit.base.of(fit.arm.values)
    assert np.linalg.norm(fit.values - true) < 0.05 * np.linalg.norm(given - true)


def test_held_out_logs_have_no_part_in_it(fit):
    *to_fit, held_out = measured()[0]
    other = dataclasses.replace(held_out, tau=2.0 * held_out.tau)
    assert np.array_equal(fit_rigid_body((*to_fit, other), WRONG).values, fit.values)


def test_the_case_of_a_joint_is_its_friction_under_its_motion(fit):
    case = fit.case("elbow")
    assert (case.name, case.plant.position_unit, case.plant.force_unit) == ("elbow", "rad", "N*m")
    assert [(one.role, one.drive) for one in case.recordings] == [("fit", "motion")] * 2 + [
        ("holdout", "motion")
    ]
    assert np.std(case.recordings[1].x - fit.logs[1].q[:, 2]) == pytest.approx(STEP, rel=0.1)
    with pytest.raises(InputError, match="no joint `wrist`"):
        fit.case("wrist")


def test_what_a_log_does_not_determine_stays_as_the_model_has_it():
    """The joints of the hand are still: what they alone would show is not known."""
    logs = []
    for log in measured()[0]:
        still = np.array(log.q)
        still[:, 3:] = 0.1
        logs.append(dataclasses.replace(log, q=still))
    fit = fit_rigid_body(logs, WRONG)
    given = fit.base.of(fit.arm.values)
    names = [name for name, known in zip(fit.base.names, fit.determined, strict=True) if not known]
    assert {"elbow.armature"} & set(fit.base.names) and {"tip.armature", "roll.armature"} <= set(names)
    rotor = fit.base.names.index("tip.armature")
    assert fit.values[rotor] == pytest.approx(given[rotor], rel=1e-6)
    (said,) = fit.said_of_parameters()
    assert said.startswith(f"The logs do not determine {len(names)} of {len(fit.base.names)} base parameters")


def test_a_single_log_is_divided():
    log = measured()[0][0]
    with pytest.warns(FrictionjaxWarning, match="last third"):
        fit = fit_rigid_body(log, WRONG)
    assert [one.role for one in fit.logs] == ["fit", "holdout"]
    assert fit.logs[1].start_time > fit.logs[0].start_time + 13.0


def test_it_shows_itself(fit):
    assert "40 base parameters refitted" in repr(fit) and "upper.Ixx" in repr(fit)
    assert "<td>N*m</td>" in fit._repr_html_()
    pytest.importorskip("pandas")
    assert list(fit.to_dataframe().index) == list(JOINTS)
    assert fit.to_dataframe("parameters").loc["tip.armature", "value"] == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("noise", [1e-6, 1e-4])
def test_the_cut_off_lies_between_motion_and_noise(noise):
    """The acceleration errs by at most twice as much as with the best of all cut-offs, in each joint."""
    q, _, qdd = fourier(1, SECONDS, RATE)
    seen = q + noise * np.random.default_rng(3).standard_normal(q.shape)
    for k in range(len(JOINTS)):
        cut = cut_off(seen[:, k], RATE)
        errors = []
        for one in (cut, *np.geomspace(1.0, 20.0, 15)):
            motion = smooth_motion(seen[:, [k]], RATE, np.array([one]))
            errors.append(float(_rms((motion.qdd[:, 0] - qdd[:, k])[200:-200])))
        assert errors[0] < 2.0 * min(errors[1:])


@pytest.mark.untyped
def test_logs_that_do_not_fit_the_model_are_refused():
    first, second, third = measured()[0]
    fewer = [
        eqx.tree_at(lambda one: (one.q, one.tau), log, (log.q[:, :4], log.tau[:, :4]))
        for log in (first, third)
    ]
    with pytest.raises(
        InputError, match=r"log_1: the log has 4 joints, and 6 are in the model: pan, .*--joints"
    ):
        fit_rigid_body(fewer, ARM)
    with pytest.raises(InputError, match="the log has 4 joints, and 2 were named"):
        fit_rigid_body(fewer, ARM, joints=("pan", "lift"))
    with pytest.raises(InputError, match=r"`q` has the shape .* and `tau`"):
        fit_rigid_body([first, dataclasses.replace(third, tau=third.tau[:, :5])], ARM)
    with pytest.raises(InputError, match="no log is held out"):
        fit_rigid_body([first, second], ARM)
    short = [dataclasses.replace(log, q=log.q[:105], tau=log.tau[:105]) for log in (first, third)]
    with pytest.raises(InputError, match="105 samples are too few"):
        fit_rigid_body(short, ARM)
    with pytest.raises(InputError, match="a int is no log of an arm"):
        fit_rigid_body(3, ARM)  # type: ignore[arg-type]
