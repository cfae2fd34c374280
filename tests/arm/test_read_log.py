"""Logs of an arm: which column is which joint's position or torque, units, clocks, and what is refused."""

import warnings

import numpy as np
import pytest

from frictionjax.arm import ArmLog, read_arm_log
from frictionjax.arm.read_log import logs_of
from frictionjax.core import FrictionjaxWarning, InputError

N, RATE = 300, 200.0
T = np.arange(N) / RATE
Q = np.stack([np.sin((1.0 + k) * T + k) for k in range(3)], axis=1)
TAU = np.stack([5.0 * np.cos((1.0 + k) * T) for k in range(3)], axis=1)
NAMES = ("base_joint", "arm", "arm_2")


def _frame(q, tau, time="t"):
    """Columns with these names."""
    columns = {time: T}
    columns |= {name: Q[:, k] for k, name in enumerate(q)}
    return columns | {name: TAU[:, k] for k, name in enumerate(tau)}


@pytest.mark.parametrize(
    ("q", "tau", "joints"),
    [
        (("q1", "q2", "q3"), ("tau1", "tau2", "tau3"), ()),
        (("q_0", "q_1", "q_2"), ("tau[0]", "tau[1]", "tau[2]"), ()),
        (
            ("Joint 1 Position", "Joint 2 Position", "Joint 3 Position"),
            ("J1 torque", "J2 torque", "J3 torque"),
            (),
        ),
        (("actual_q_0", "actual_q_1", "actual_q_2"), ("effort_0", "effort_1", "effort_2"), ()),
        (
            ("base_joint.position", "arm.position", "arm_2.position"),
            ("base_joint.effort", "arm.effort", "arm_2.effort"),
            NAMES,
        ),
        (("q base joint", "q arm", "q arm 2"), ("BaseJoint tau", "Arm tau", "Arm2 tau"), NAMES),
        (
            ("position_arm_2", "position_base_joint"),
            ("torque_arm_2", "torque_base_joint"),
            ("base_joint", "arm_2"),
        ),
    ],
)
def test_columns_are_found_by_their_names(q, tau, joints):
    log = read_arm_log(_frame(q, tau), NAMES, name="run")
    order = [[*q].index(next(name for name in q if _same(name, joint))) for joint in joints] or range(len(q))
    assert log.joints == joints and log.sample_rate == RATE
    np.testing.assert_array_equal(log.q, Q[:, list(order)])
    np.testing.assert_array_equal(log.tau, TAU[:, list(order)])


def _same(header, joint):
    words = header.lower().replace("_", " ").replace(".", " ")
    rest = words.replace(joint.replace("_", " "), "", 1).split()
    return joint.replace("_", " ") in words and rest in (["position"], ["q"])


def test_other_columns_are_named():
    frame = _frame(("A", "B", "C"), ("D", "E", "F"), time="Stamp")
    columns = {"q": ["C", "A"], "tau": ["F", "D"], "t": "Stamp"}
    log = read_arm_log(frame, NAMES, columns=columns)
    np.testing.assert_array_equal(log.q, Q[:, [2, 0]])
    np.testing.assert_array_equal(log.tau, TAU[:, [2, 0]])


def test_units_are_converted_and_a_slide_stays_one(tmp_path):
    table = np.column_stack([1e3 * T, np.degrees(Q[:, 0]), 1e3 * Q[:, 1], 1e3 * TAU[:, 0], TAU[:, 1]])
    header = "t [ms],q1 [deg],q2 [mm],tau1 [Nmm],tau2 [N]"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=header, comments="")
    with pytest.warns(FrictionjaxWarning) as said:
        log = read_arm_log(tmp_path / "run.csv")
    assert any("x from deg to rad" in str(one.message) for one in said)
    np.testing.assert_allclose(log.q, Q[:, :2], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(log.tau, TAU[:, :2], rtol=1e-9, atol=1e-12)
    assert log.name == "run" and any("from mm to m" in said for said in log.warnings[1])
    assert "ArmLog run: 2 joints" in repr(log)


def test_columns_without_a_unit_need_none():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_arm_log(_frame(("q[0]", "q[1]"), ("tau[0]", "tau[1]")))


def test_a_log_without_time_needs_its_rate():
    frame = _frame(("q1",), ("tau1",))
    del frame["t"]
    assert read_arm_log(frame, sample_rate=RATE).sample_rate == RATE
    with pytest.raises(InputError, match="no sample_rate is given"):
        read_arm_log(frame)


@pytest.mark.parametrize(
    ("frame", "columns", "words"),
    [
        (_frame(("q1", "q2"), ("tau1",)), {}, "no column with the torque of the joint number 2"),
        (
            _frame(("arm.position",), ("arm_2.effort",)),
            {},
            "no column with the position of the joint `arm_2`",
        ),
        (
            _frame(("q1",), ("A", "B")),
            {},
            r"no column with the torque of a joint\. Call them tau1, .*has: t, q1, A, B",
        ),
        (_frame(("A",), ("tau1",)), {}, "no column with the position of a joint"),
        (_frame(("q1", "pos 1"), ("tau1",)), {}, "`q1` and `pos 1` could both be the position"),
        (_frame(("A",), ("B",)), {"q": "A", "tau": "b"}, r"no column `b`\. Did you mean `B`\?"),
        (_frame(("A",), ("B",)), {"q": ["A"], "tau": ["B", "A"]}, "position of the joint number 1"),
        (_frame(("A",), ("B",)), {"x": "A"}, "`x` is no channel of an arm's log"),
    ],
)
def test_what_is_missing_is_said(frame, columns, words):
    with pytest.raises(InputError, match=words):
        read_arm_log(frame, NAMES, columns=columns)


def test_a_value_that_is_missing_is_refused_with_its_place(tmp_path):
    table = np.column_stack([T, Q[:, 0], TAU[:, 0]])
    table[17, 2] = np.nan
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,q1,tau1", comments="")
    with pytest.raises(InputError, match=r"run\.csv, line 19, column `tau1`: the value is missing"):
        read_arm_log(tmp_path / "run.csv")


def test_logs_of_one_arm_have_names_of_their_own():
    log = ArmLog("run", RATE, Q, TAU)
    found = logs_of([log, log], log, (), None)
    assert [(one.name, one.role) for one in found] == [("run", "fit"), ("run_2", "fit"), ("run_3", "holdout")]
    with pytest.raises(InputError, match="there is no log"):
        logs_of([], (), (), None)
