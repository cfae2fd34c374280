"""`read_mujoco_joint`: what a MuJoCo or URDF model knows of a joint is the base model of a diagnosis."""

import dataclasses
import sys
import tomllib

import numpy as np
import pytest
from helpers_plants import ROTARY, effect

from frictionjax.core import InputError
from frictionjax.diagnosis.intake.own_model import own_model
from frictionjax.exchange import KnownJoint, mujoco_joint, read_mujoco_joint
from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Case, Given, GivenModel, Plant, Recording
from frictionjax.recordings.model_table import parse_model
from frictionjax.simulation import simulate

ARM = """
<mujoco>
  <default><joint armature="0.02"/><default class="soft"><joint damping="0.3"/></default></default>
  <worldbody>
    <body pos="0 0 1" quat="0.7071067811865476 0.7071067811865476 0 0" childclass="soft">
      <joint name="shoulder" axis="0 0 1" pos="0.01 0.02 0" frictionloss="0.4" stiffness="1.5" springref="30"
             ref="20"/>
      <inertial pos="0.2 0.03 0.01" quat="0.9 0.1 0.2 0.3" mass="2" diaginertia="0.01 0.02 0.025"/>
      <body pos="0.4 0 0" quat="0.8 0 0.6 0">
        <joint name="elbow" axis="0 1 0" class="main" frictionloss="0.1"/>
        <inertial pos="0.1 0 0.02" mass="0.7" fullinertia="0.01 0.012 0.013 0.001 0.002 -0.001"/>
        <body pos="0.1 0 0"><inertial pos="0 0.02 0.05" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/></body>
      </body>
    </body>
    <body><joint name="slider" type="slide" axis="0 0.6 0.8"/>
      <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/></body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="16"/><position name="servo" joint="elbow" kp="3"/></actuator>
</mujoco>
"""
URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0.03 0.01" rpy="0.3 -0.2 0.5"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0.02"/><mass value="0.7"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.013" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"><inertial><mass value="0.3"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1" rpy="1.2 0.3 -0.4"/><axis xyz="0 1 0"/><dynamics damping="0.3" friction="0.4"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.4 0 0" rpy="0 0.5 0"/><axis xyz="1 0 0"/></joint>
  <joint name="mount" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0.1 0 0"/></joint>
</robot>
"""


def _values(known):
    """Parameters and effects as plain numbers."""
    effects = {one.name: {key: g.value for key, g in one.values.items()} for one in known.model.effects}
    return {name: one.value for name, one in known.model.parameters.items()}, effects


def _compiled(xml, joint):
    """Inertia, and gravity on the joint at two positions, as MuJoCo computes them."""
    mujoco = pytest.importorskip("mujoco", minversion="4.0")
    model = mujoco.MjModel.from_xml_string(xml)
    data, number = mujoco.MjData(model), model.joint(joint).id
    dof, place = int(model.jnt_dofadr[number]), int(model.jnt_qposadr[number])
    along, inertia, forces = np.zeros(model.nv), np.zeros(model.nv), []
    along[dof] = 1.0
    for position in (model.qpos0[place], 0.7, -1.1):
        data.qpos[:] = model.qpos0
        data.qpos[place] = position
        mujoco.mj_forward(model, data)
        forces.append(float(data.qfrc_bias[dof]))
        if not np.any(inertia):
            mujoco.mj_mulM(model, data, inertia, along)
    return float(inertia[dof]), forces[1:]


@pytest.mark.parametrize(
    ("xml", "joint"), [(ARM, "shoulder"), (ARM, "elbow"), (URDF, "shoulder"), (URDF, "elbow")]
)
def test_inertia_and_gravity_are_those_of_mujoco(xml, joint):
    """Two ways to one answer: the standard library here, MuJoCo's compiler there."""
    inertia, forces = _compiled(xml, joint)
    parameters, effects = _values(read_mujoco_joint(xml, joint))
    assert parameters["J"] == pytest.approx(inertia, rel=1e-6)
    parts = effects.get("gravity_pendulum", {"sine": 0.0, "cosine": 0.0})
    ours = [parts["sine"] * np.sin(x) + parts["cosine"] * np.cos(x) for x in (0.7, -1.1)]
    np.testing.assert_allclose(ours, forces, rtol=1e-6, atol=1e-9)


def test_what_the_file_says_becomes_a_base_model():
    known = read_mujoco_joint(ARM, "shoulder")
    parameters, effects = _values(known)
    assert isinstance(known, KnownJoint)
    assert (parameters["sigma2"], parameters["Fc"]) == (0.3, 0.4)
    assert effects["return_spring"] == {"stiffness": 1.5}
    assert effects["constant_load"] == {"load": pytest.approx(-1.5 * np.pi / 6)}
    assert known.plant == Plant(16.0, "rad", "N*m", "input")
    assert "Inertia and gravity hold with elbow where the model has them at first." in known.remarks
    assert not any(one.fixed for one in known.model.parameters.values())
    fixed = read_mujoco_joint(ARM, "shoulder", fixed=True).model
    assert all(one.fixed for one in fixed.parameters.values())
    elbow = read_mujoco_joint(ARM, "elbow")
    said = "The actuator servo is a position: its control is no force, so record the force that it makes."
    assert "sigma2" not in elbow.model.parameters
    assert said in elbow.remarks
    slider = read_mujoco_joint(ARM, "slider")
    parameters, effects = _values(slider)
    assert parameters["J"] == pytest.approx(3.02)
    assert effects == {"constant_load": {"load": pytest.approx(3 * 9.81 * 0.8)}}
    assert slider.plant.force_unit == "N"


def test_urdf_has_no_rotor():
    known = read_mujoco_joint(URDF, "shoulder")
    assert (_values(known)[0]["sigma2"], _values(known)[0]["Fc"]) == (0.3, 0.4)
    assert known.remarks[0] == "URDF has no place for the inertia of the rotor."


def test_a_drive_comes_back_from_what_is_written_for_mujoco():
    drive = dataclasses.replace(ROTARY, effects=(effect("ReturnSpring", stiffness=0.7),))
    joint = mujoco_joint(drive, body_inertia=0.4 * float(drive.J))
    known = read_mujoco_joint(joint.mjcf(), "joint")
    parameters, effects = _values(known)
    truth = {
        name: float(getattr(drive.friction, name))
        for name in ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    }
    truth = {name: value for name, value in (truth | {"J": float(drive.J)}).items() if value > 0.0}
    assert parameters == pytest.approx(truth, rel=1e-12)
    assert effects == {"return_spring": {"stiffness": 0.7}}
    assert known.plant.motor_constant == float(drive.motor_constant)
    assert known.remarks == ()


@pytest.fixture(scope="module")
def machine():
    """A joint that is as its file says, but for gravity: the file forgets the link's mass."""
    friction = LuGre(sigma0=900.0, sigma1=6.0, sigma2=0.08, Fc=0.65, Fs=0.8, vs=0.05)
    known = read_mujoco_joint(mujoco_joint(Drive(0.35, friction)).mjcf(), "joint")
    drive = Drive(0.35, friction, effects=(effect("GravityPendulum", sine=0.5),))
    t = np.arange(600) / 200.0
    u = 2.0 * np.sin(2.0 * np.pi * 0.7 * t)
    x = np.asarray(simulate(drive, u, 200.0).x)
    return (
        known,
        Case("arm", Plant(None, "rad", "N*m", "N*m"), (Recording("swing", 200.0, u, x, role="fit"),)),
        drive,
    )


def test_the_base_of_a_case_lacks_what_the_file_leaves_out(machine):
    """Its own model simulates the recording but for the force that the file forgets."""
    known, case, drive = machine
    based = known.in_case(case)
    own = own_model(based)
    assert own.complete and based.plant.motor_constant == 1.0
    base = own.applied(dataclasses.replace(drive, J=9.0, effects=()))
    (recording,) = based.recordings
    lacks = np.asarray(simulate(base, recording.u, 200.0).x) - recording.x
    forgotten = base.with_effects(*drive.effects)
    whole = np.asarray(simulate(forgotten, recording.u, 200.0).x) - recording.x
    assert np.max(np.abs(whole)) < 1e-9 < 1e-2 < np.max(np.abs(lacks))


def test_a_case_that_contradicts_the_joint_is_refused(machine):
    known, case, _ = machine
    with pytest.raises(InputError, match="has the motor constant 3, and the motor of joint 1"):
        known.in_case(Case("arm", Plant(3.0), case.recordings))
    with pytest.raises(InputError, match="has a base model already"):
        known.in_case(Case("arm", case.plant, case.recordings, GivenModel({"J": Given(1.0)})))


def test_its_lines_of_a_case_file_say_the_same():
    known = read_mujoco_joint(ARM, "shoulder", fixed=True)
    read = parse_model(tomllib.loads(known.toml())["model"], None)
    assert read.parameters == known.model.parameters
    assert read.effects == known.model.effects


SHAPES = """<mujoco><worldbody><body><joint name="j" armature="0.1" damping="0.2"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.5 0 0"/></body></worldbody></mujoco>"""


def test_bodies_made_of_shapes_need_mujoco(monkeypatch):
    pytest.importorskip("mujoco", minversion="4.0")
    inertia, _ = _compiled(SHAPES, "j")
    parameters, _ = _values(read_mujoco_joint(SHAPES, "j"))
    assert parameters["J"] == pytest.approx(inertia) and inertia > 0.3
    monkeypatch.setitem(sys.modules, "mujoco", None)
    without = read_mujoco_joint(SHAPES, "j")
    assert _values(without)[0] == {"J": 0.1, "sigma2": 0.2}
    assert 'run pip install "frictionjax[mujoco]"' in " ".join(without.remarks)


def test_a_joint_of_an_included_file_is_found(tmp_path):
    pytest.importorskip("mujoco", minversion="4.0")
    (tmp_path / "link.xml").write_text(ARM.replace("shoulder", "hip"), encoding="utf-8")
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco><include file="link.xml"/></mujoco>', encoding="utf-8")
    plain, included = _values(read_mujoco_joint(ARM, "shoulder")), _values(read_mujoco_joint(scene, "hip"))
    assert included[0] == pytest.approx(plain[0], rel=1e-6)
    for name, parts in plain[1].items():
        assert included[1][name] == pytest.approx(parts, rel=1e-6)


@pytest.mark.parametrize(
    ("xml", "joint", "words"),
    [
        (ARM, "wrist", 'there is no joint "wrist". Its joints: shoulder, slider, elbow'),
        (URDF, "mount", 'the joint "mount" is fixed'),
        (URDF, "wrist", "Its joints: shoulder and elbow|Its joints: shoulder, elbow"),
        (
            "<mujoco><worldbody><body><joint name='b' type='ball'/></body></worldbody></mujoco>",
            "b",
            "is a ball joint",
        ),
        ("<mujoco>", "j", "is not XML"),
        ("<sdf/>", "j", "begins with <sdf>, which is no robot"),
        (
            "<mujoco><worldbody><body><joint name='j' damping='x'/></body></worldbody></mujoco>",
            "j",
            "j, damping",
        ),
        ("no_such_file.xml", "j", "no_such_file.xml"),
    ],
)
def test_what_cannot_be_read_is_said(xml, joint, words):
    with pytest.raises(InputError, match=words):
        read_mujoco_joint(xml, joint)


def test_entities_are_refused():
    bomb = '<!DOCTYPE mujoco [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>\n<mujoco model="&b;"/>'
    with pytest.raises(InputError, match="declares a document type, whose entities are not read"):
        read_mujoco_joint(f"<?xml version='1.0'?>\n{bomb}", "j")
