"""Joints for URDF, Isaac Lab and BAM: their numbers move as the drive does, and what they lose is said."""

import json
import types
import xml.etree.ElementTree as ET

import jax.numpy as jnp
import numpy as np
import pytest

import frictionjax as fj
from frictionjax.exchange import bam_parameters, isaac_lab_actuator, urdf_dynamics
from frictionjax.physics.effects.stribeck_shape import StribeckShape

TRUE = {"J": 0.03, "sigma0": 2000.0, "sigma1": 3.0, "sigma2": 0.6, "Fc": 0.5, "Fs": 0.8, "vs": 0.08}
CONSTANT, RESISTANCE = 0.4, 2.5
LUGRE = {name: TRUE[name] for name in ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")}
DRIVE = fj.Drive(TRUE["J"], fj.LuGre(**LUGRE), CONSTANT)
VERBS = {
    "urdf": urdf_dynamics,
    "isaac": isaac_lab_actuator,
    "bam": lambda drive: bam_parameters(drive, actuator="mx106", resistance=RESISTANCE),
}


def read_isaac(text):
    """The keywords in the text of an actuator."""
    names = {"ImplicitActuatorCfg": types.SimpleNamespace}
    return vars(eval(text, names))


def bam_torque(numbers, volts, v, control):
    """Motor torque by the equations of BAM for its parameter file."""
    if control == "amps":
        return numbers["kt"] * volts
    return numbers["kt"] * volts / numbers["R"] - numbers["kt"] ** 2 * v / numbers["R"]


def bam_friction(numbers, v):
    """Largest friction torque, without and with the viscous part, by the equations of BAM's models m1 and m2."""
    level = numbers["friction_base"]
    if numbers["model"] == "m2":
        bell = np.exp(-(np.abs(v / numbers["dtheta_stribeck"]) ** numbers["alpha"]))
        level = level + bell * numbers["friction_stribeck"]
    return level, level + numbers["friction_viscous"] * np.abs(v)


@pytest.mark.parametrize("control", ["volts", "amps"])
def test_bam_has_the_torque_balance_of_the_drive_at_every_speed(control):
    text = bam_parameters(DRIVE, actuator="mx106", resistance=RESISTANCE, control=control).text
    numbers = json.loads(text)
    assert (numbers["model"], numbers["actuator"], numbers["armature"]) == ("m2", "mx106", TRUE["J"])
    for v in (0.01, 0.05, 0.1, 1.0, 20.0):
        theirs = bam_torque(numbers, 3.0, v, control) - bam_friction(numbers, v)[1]
        ours = CONSTANT * 3.0 - float(DRIVE.friction.level(v)) - TRUE["sigma2"] * v
        assert theirs == pytest.approx(ours, rel=1e-12)


def test_bam_moves_as_the_drive_once_it_slides():
    """Semi-implicit steps with a stopping torque, as BAM simulates; a tenth of a millisecond each."""
    numbers = json.loads(VERBS["bam"](DRIVE).text)
    rate, n = 1e4, 6000
    t = np.arange(n) / rate
    volts = np.where(t < 0.3, 4.0, -5.0)
    q = v = 0.0
    theirs = np.zeros(n)
    for k in range(n):
        theirs[k] = q
        driven = v + bam_torque(numbers, volts[k], v, "volts") / numbers["armature"] / rate
        stop = numbers["armature"] * driven * rate
        most = bam_friction(numbers, v)[1]
        v = driven - np.clip(stop, -most, most) / numbers["armature"] / rate
        q += v / rate
    ours = np.asarray(fj.simulate(DRIVE, volts, rate).x)
    assert np.max(np.abs(theirs - ours)) < 0.01 * np.max(np.abs(ours))


def test_bam_takes_a_stribeck_exponent_and_loses_it_in_m1():
    shape = StribeckShape(exponent_change=-0.7)
    drive = DRIVE.with_effects(shape)
    numbers = json.loads(VERBS["bam"](drive).text)
    for v in (0.02, 0.1):
        level = float(drive.level(jnp.zeros(()), jnp.asarray(v)))
        assert bam_friction(numbers, v)[0] == pytest.approx(level, rel=1e-12)
    assert not any("stribeck_shape" in sentence for sentence in VERBS["bam"](drive).lost)
    plain = bam_parameters(drive, actuator="mx64", resistance=RESISTANCE, model="m1")
    assert "friction_stribeck" not in json.loads(plain.text)
    assert any("stribeck_shape is lost" in sentence for sentence in plain.lost)
    assert any("Stribeck effect is lost" in sentence for sentence in plain.lost)


def test_urdf_is_read_by_mujoco_with_the_numbers_of_the_drive():
    mujoco = pytest.importorskip("mujoco")
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    robot = (
        f'<robot name="r"><link name="base"/><link name="arm">{inertial}</link><joint name="j" type="continuous">'
        f'<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>{urdf_dynamics(DRIVE).text}</joint></robot>'
    )
    model = mujoco.MjModel.from_xml_string(robot)
    assert model.dof_damping[0] == TRUE["sigma2"]
    assert model.dof_frictionloss[0] == TRUE["Fc"]
    data = mujoco.MjData(model)
    for _ in range(1000):
        data.qfrc_applied[0] = 2.0
        mujoco.mj_step(model, data)
    # In steady sliding the drive turns with (torque - Fc)/sigma2 as well.
    assert data.qvel[0] == pytest.approx((2.0 - TRUE["Fc"]) / TRUE["sigma2"], rel=1e-3)


def test_urdf_takes_either_level():
    element = ET.fromstring(urdf_dynamics(DRIVE, friction="Fs").text)
    assert (element.tag, element.attrib) == ("dynamics", {"damping": "0.6", "friction": "0.8"})


@pytest.mark.untyped
def test_urdf_takes_no_other_level():
    with pytest.raises(ValueError, match="`friction` is 'F'; it must be"):
        urdf_dynamics(DRIVE, friction="F")


def test_isaac_lab_reads_the_numbers_of_the_drive():
    found = isaac_lab_actuator(DRIVE, joints=(".*_knee",), body_inertia=0.01, stiffness=20.0, damping=0.5)
    assert read_isaac(found.text) == {
        "joint_names_expr": [".*_knee"],
        "stiffness": 20.0,
        "damping": 0.5,
        "armature": TRUE["J"] - 0.01,
        "friction": TRUE["Fs"],
        "dynamic_friction": TRUE["Fc"],
        "viscous_friction": TRUE["sigma2"],
    }


@pytest.mark.parametrize("name", VERBS)
def test_what_is_lost_is_said(name):
    creep = fj.catalogue()["creep"][0](compliance=0.02)
    silent = fj.catalogue()["ripple"][0]()
    lost = " ".join(VERBS[name](DRIVE.with_effects(creep, silent)).lost)
    assert "sigma0 = 2000" in lost
    assert "creep is lost" in lost
    assert "ripple" not in lost
    assert ("multiply that of the drive by 0.4" in lost) == (name != "bam")  # BAM has a motor
    assert ("J = 0.03" in lost) == (name == "urdf")
    unit = VERBS[name](fj.Drive(TRUE["J"], DRIVE.friction, 0.0001 if name == "bam" else 1.0))
    assert "motor is lost" not in " ".join(unit.lost)


def _fit(names, covariance):
    values = {**TRUE, "motor_constant": CONSTANT}
    estimates = {
        name: fj.Estimate(values[name], float(np.sqrt(covariance[k, k])), "1") for k, name in enumerate(names)
    }
    return fj.FitResult(DRIVE, estimates, names, covariance, covariance, {}, 0.0, True, "", ())


def test_standard_errors_follow_by_the_delta_method():
    names = ("J", "sigma2", "Fc", "Fs", "vs", "motor_constant")
    rng = np.random.default_rng(3)
    half = 1e-3 * rng.normal(size=(6, 6))
    result = _fit(names, half @ half.T)
    found = {name: verb(result) for name, verb in VERBS.items()}
    errors = dict(zip(names, np.sqrt(np.diag(result.covariance)), strict=True))
    assert found["urdf"].stderr == pytest.approx({"damping": errors["sigma2"], "friction": errors["Fc"]})
    assert found["isaac"].stderr["armature"] == pytest.approx(errors["J"])
    # Against finite differences of what is written.
    base = found["bam"].values

    def written(step):
        d = dict(zip(names, step, strict=True))
        friction = {name: TRUE[name] + d.get(name, 0.0) for name in LUGRE}
        drive = fj.Drive(TRUE["J"] + d["J"], fj.LuGre(**friction), CONSTANT + d["motor_constant"])
        return VERBS["bam"](drive).values

    for name in ("kt", "armature", "friction_viscous", "friction_stribeck", "dtheta_stribeck"):
        slope = np.array([(written(1e-6 * row)[name] - base[name]) / 1e-6 for row in np.eye(6)])
        expected = np.sqrt(slope @ result.covariance @ slope)
        assert found["bam"].stderr[name] == pytest.approx(expected, rel=1e-3)
    assert found["bam"].stderr["alpha"] == 0.0


def test_what_the_data_do_not_determine_stays_unknown():
    result = _fit(("Fc", "Fs"), np.diag([np.inf, 1e-4]))
    assert urdf_dynamics(result).stderr == {"damping": 0.0, "friction": np.inf}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: isaac_lab_actuator(DRIVE, body_inertia=1.0), "must lie between 0 and J = 0.03"),
        (
            lambda: bam_parameters(DRIVE, actuator="a", resistance=1.0, body_inertia=-1.0),
            "must lie between 0 and J",
        ),
        (lambda: bam_parameters(DRIVE, actuator="a", resistance=0.0), "must be positive. See the data sheet"),
        (lambda: bam_parameters(DRIVE, actuator="a", resistance=9.0), r"damps with 1.44 .* sigma2 = 0.6"),
        (lambda: isaac_lab_actuator(_with(Fs=0.1)), "Fs = 0.1 below Fc = 0.5"),
        (lambda: urdf_dynamics(_with(Fc=0.0)), "Fc = 0; for URDF it must be positive"),
        (lambda: VERBS["bam"](_with(sigma2=-1.0)), "sigma2 = -1; for BAM it must not be negative"),
    ],
)
def test_what_a_program_cannot_take_is_refused(make, words):
    with pytest.raises(fj.InputError, match=words):
        make()


@pytest.mark.untyped
def test_wrong_words_are_refused():
    for words in ({"control": "newtons"}, {"model": "m6"}):
        with pytest.raises(ValueError, match="it must be"):
            bam_parameters(DRIVE, actuator="a", resistance=1.0, **words)


def _with(**changes):
    return fj.Drive(TRUE["J"], fj.LuGre(**{**LUGRE, **changes}), CONSTANT)
