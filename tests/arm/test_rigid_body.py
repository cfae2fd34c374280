"""Rigid bodies: what a motion takes of each joint, against MuJoCo's own inverse dynamics; base parameters."""

import equinox as eqx
import numpy as np
import pytest
from helpers_six_joints import ARM, JOINTS, inverse

from frictionjax.arm.base_parameters import base_parameters
from frictionjax.arm.read_model import read_robot, rigid_body
from frictionjax.core import InputError

pytest.importorskip("mujoco", minversion="4.0")

MIXED = """
<mujoco>
  <option gravity="1 2 -9"/>
  <worldbody>
    <body pos="0.1 0.2 0.3" quat="0.8 0.6 0 0">
      <joint name="rail" type="slide" axis="0.6 0.8 0" armature="0.4"/>
      <inertial pos="0.1 0 0.2" mass="3" fullinertia="0.02 0.03 0.025 0.001 0.002 -0.003"/>
      <body name="head" pos="0.2 0.1 0" quat="0.5 0.5 0.5 0.5">
        <joint name="yaw" axis="0 0 1" pos="0.05 0 0.1"/>
        <joint name="tilt" axis="1 0 1" pos="0 0.03 0"/>
        <joint name="reach" type="slide" axis="0 1 0" ref="0.2"/>
        <inertial pos="0 0.1 0.05" mass="1.5" diaginertia="0.01 0.012 0.008"/>
      </body>
      <body name="other" pos="0 0 0.4">
        <joint name="spin" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="0.7" diaginertia="0.002 0.003 0.004"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="upper"><visual><geometry><mesh filename="package://nowhere/upper.dae"/></geometry></visual>
    <inertial><origin xyz="0.2 0.03 0.01" rpy="0.3 -0.2 0.5"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0.02"/><mass value="0.7"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.013" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1" rpy="1.2 0.3 -0.4"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.4 0 0" rpy="0 0.5 0"/><axis xyz="1 0 0"/></joint>
</robot>
"""


def _states(joints, seed=0, n=40):
    rng = np.random.default_rng(seed)
    return tuple(size * rng.standard_normal((n, joints)) for size in (1.0, 2.0, 5.0))


@pytest.mark.parametrize(("xml", "joints"), [(ARM, 6), (MIXED, 5)], ids=["arm", "slides and branches"])
def test_the_regressor_is_mujocos_inverse_dynamics(xml, joints):
    arm, states = rigid_body(read_robot(xml)), _states(joints)
    exact = inverse(xml, *states)
    np.testing.assert_allclose(arm.regressor(*states) @ arm.values, exact, atol=1e-11 * np.max(np.abs(exact)))


def test_a_urdf_needs_no_meshes():
    arm = rigid_body(read_robot(URDF))
    bare = URDF.replace(
        '<visual><geometry><mesh filename="package://nowhere/upper.dae"/></geometry></visual>', ""
    )
    states = _states(2)
    assert arm.joints == ("shoulder", "elbow")
    np.testing.assert_allclose(arm.regressor(*states) @ arm.values, inverse(bare, *states), atol=1e-11)


def test_joints_that_are_not_logged_are_held():
    """In another order than the model has them, and the elbow at its reference of ten degrees."""
    chosen = ("roll", "pan", "lift")
    arm = rigid_body(read_robot(ARM), chosen)
    some = _states(3)
    places = [JOINTS.index(joint) for joint in chosen]
    whole = tuple(np.zeros((40, 6)) for _ in range(3))
    whole[0][:, JOINTS.index("elbow")] = np.radians(10.0)
    for part, values in zip(whole, some, strict=True):
        part[:, places] = values
    np.testing.assert_allclose(arm.regressor(*some) @ arm.values, inverse(ARM, *whole)[:, places], atol=1e-10)


def test_base_parameters_give_every_torque():
    arm = rigid_body(read_robot(ARM))
    base = base_parameters(arm)
    states = _states(6, seed=1, n=60)
    columns = arm.regressor(*states)
    assert base.kept.size == np.linalg.matrix_rank(columns.reshape(-1, len(arm.parameters)), tol=1e-7)
    # Any other bodies and rotors, too: what is not in the base has no effect.
    other = eqx.tree_at(
        lambda one: (one.inertial, one.armature),
        arm,
        (arm.inertial + np.random.default_rng(2).standard_normal(arm.inertial.shape), arm.armature + 0.3),
    )
    for one in (arm, other):
        exact = columns @ one.values
        found = base.regressor(arm, *states) @ base.of(one.values)
        np.testing.assert_allclose(found, exact, atol=1e-8 * np.max(np.abs(exact)))


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        ("<mjcf/>", "no robot"),
        ("<mujoco><body", "is not XML"),
        ("<mujoco><worldbody><light/><joke/></worldbody></mujoco>", "MuJoCo refuses the model"),
        ("<mujoco><worldbody/></mujoco>", "no hinge and no slide"),
        ("missing.xml", "does not exist"),
    ],
)
def test_what_is_no_model_is_refused(xml, words):
    with pytest.raises(InputError, match=words):
        read_robot(xml)


def test_a_joint_that_is_not_there_is_refused():
    robot = read_robot(ARM)
    with pytest.raises(
        InputError, match=r"no joint `elbwo`\. Did you mean `elbow`\? The model has .*pan, lift"
    ):
        rigid_body(robot, ("pan", "elbwo"))
    with pytest.raises(InputError, match="`pan` is given twice"):
        rigid_body(robot, ("pan", "pan"))


def test_joints_that_are_tied_are_refused_where_they_are_logged():
    tied = '<equality><joint joint1="bend" joint2="tip"/></equality></mujoco>'
    robot = read_robot(ARM.replace("</mujoco>", tied))
    with pytest.raises(InputError, match="ties the joint `bend` to another one"):
        rigid_body(robot)
    assert rigid_body(robot, ("pan", "lift")).joints == ("pan", "lift")
    loop = '<equality><weld body1="tool" body2="base"/></equality></mujoco>'
    with pytest.raises(InputError, match="closes a loop of bodies"):
        rigid_body(read_robot(ARM.replace("</mujoco>", loop)), ("pan", "lift"))


def test_without_mujoco_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr("frictionjax.arm.read_model.optional", lambda name: None)
    with pytest.raises(InputError, match=r"not installed\. Run pip install \"frictionjax\[mujoco\]\""):
        read_robot(ARM)
