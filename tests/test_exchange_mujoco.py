"""`mujoco_joint`: what it writes is MJCF that moves as `simulate` does, and it says what it leaves out."""

import xml.etree.ElementTree as ET

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import FORMS, PLANTS, ROTARY, STAGE, effect

from frictionjax.core import InputError
from frictionjax.exchange.mujoco import mujoco_joint
from frictionjax.simulation import simulate

KIND = {"table_i": "slide", "rotary": "hinge", "stage": "slide"}
SECONDS = 1.0


def run(xml, u, integrator=None):
    """Position and velocity, shape `(n,)`, of a model with one joint and one control."""
    mujoco = pytest.importorskip("mujoco", minversion="4.0")
    model = mujoco.MjModel.from_xml_string(xml)
    if integrator:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    data = mujoco.MjData(model)
    assert model.nu == 1
    x, v = np.zeros(len(u)), np.zeros(len(u))
    for k, value in enumerate(u):
        data.ctrl[0] = value
        x[k], v[k] = data.qpos[0], data.qvel[0]
        mujoco.mj_step(model, data)
    return x, v


def push(drive, timestep):
    """Time and input: presliding up to 0.9 Fs for 0.3 s, then sliding one way and back."""
    t = np.arange(round(SECONDS / timestep)) * timestep
    scale = float(drive.friction.Fs / drive.motor_constant)
    return t, scale * np.where(t < 0.3, 3.0 * t, np.where(t < 0.6, 2.0, -1.5))


def errors(drive, joint, timestep, integrator=None):
    """Largest difference of position over the largest excursion: in presliding, and in all."""
    t, u = push(drive, timestep)
    x, _ = run(joint.mjcf(timestep), u, integrator)
    ours = np.asarray(simulate(drive, u, 1.0 / timestep, substeps=2).x)
    stick = t < 0.3
    difference = np.abs(x - ours)
    return np.max(difference[stick]) / np.max(np.abs(ours[stick])), np.max(difference) / np.max(np.abs(ours))


@pytest.mark.parametrize("plant", PLANTS)
def test_lugre_moves_as_simulate_does(plant):
    """At the advised step: 1 % in presliding, 0.5 % of the travel in sliding; a fifth of it, five times closer."""
    drive = PLANTS[plant]
    joint = mujoco_joint(drive, kind=KIND[plant])
    presliding, sliding = errors(drive, joint, joint.timestep)
    assert presliding < 0.01
    assert sliding < 0.005
    finer = errors(drive, joint, joint.timestep / 5.0)
    assert finer[0] < presliding / 4.0
    assert finer[1] < sliding / 3.0
    assert joint.lost == ()


def test_the_integrator_matters_in_sliding():
    joint = mujoco_joint(ROTARY)
    sliding = {name: errors(ROTARY, joint, 1e-4, name)[1] for name in ("RK4", "EULER", "IMPLICITFAST")}
    assert sliding["RK4"] < sliding["EULER"] < sliding["IMPLICITFAST"] / 10.0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_body_may_have_part_of_the_inertia_or_all(share):
    joint = mujoco_joint(STAGE, kind="slide", body_inertia=share * float(STAGE.J))
    assert float(ET.fromstring(joint.joint).get("armature", "nan")) == pytest.approx(
        (1 - share) * float(STAGE.J)
    )
    assert errors(STAGE, joint, joint.timestep)[1] < 0.005


def test_a_motor_of_microscopic_inertia_has_a_trial_model():
    small = jax.tree.map(lambda value: 1e-7 * value, ROTARY)
    small = eqx.tree_at(lambda d: d.friction.vs, small, ROTARY.friction.vs)
    joint = mujoco_joint(small)
    assert errors(small, joint, joint.timestep)[1] < 0.005


def test_a_return_spring_is_kept():
    drive = ROTARY.with_effects(effect("ReturnSpring", stiffness=2.0), effect("ReturnSpring", stiffness=-0.5))
    joint = mujoco_joint(drive)
    assert joint.lost == ()
    assert errors(drive, joint, joint.timestep)[1] < 0.005


@pytest.mark.parametrize("plant", ["rotary", "stage"])
def test_frictionloss_slides_at_the_same_speed(plant):
    """Far above vs, after ten time constants J/sigma2: 0.1 %, which is what Stribeck and the solver leave."""
    drive = PLANTS[plant]
    joint = mujoco_joint(drive, kind=KIND[plant], friction="frictionloss")
    u = np.full(round(10.0 * float(drive.J / drive.friction.sigma2) / 1e-3), 2.0) * float(
        drive.friction.Fs / drive.motor_constant
    )
    _, v = run(joint.mjcf(1e-3), u)
    ours = simulate(drive, u, 1e3, substeps=2).v
    assert v[-1] == pytest.approx(float(ours[-1]), rel=1e-3)


def test_frictionloss_of_a_slide_needs_a_body_with_mass():
    """A tenth of J is enough; a body without mass slides as if it had no friction, and the result says so."""
    u = np.full(500, 2.0 * float(STAGE.friction.Fs / STAGE.motor_constant))
    speed = {}
    for share in (0.0, 0.1, 1.0):
        joint = mujoco_joint(
            STAGE, kind="slide", friction="frictionloss", body_inertia=share * float(STAGE.J)
        )
        assert any("frictionloss itself is lost" in sentence for sentence in joint.lost) == (share < 0.1)
        speed[share] = run(joint.mjcf(1e-3), u)[1][-1]
    assert speed[0.1] == pytest.approx(speed[1.0], rel=0.02)
    assert speed[0.0] > 1.5 * speed[1.0]


def test_frictionloss_says_what_is_lost():
    joint = mujoco_joint(ROTARY, friction="frictionloss")
    presliding, stribeck = joint.lost
    assert presliding.startswith("Presliding is lost: the bristle (sigma0 = 2000, sigma1 = 6)")
    assert stribeck.startswith("The Stribeck effect is lost: friction is Fc = 0.5")
    assert joint.timestep == float("inf")
    assert len(joint.actuators) == 1


@pytest.mark.parametrize("form", sorted(set(FORMS) - {"ReturnSpring"}))
def test_every_effect_that_acts_is_said_to_be_lost(form):
    strength = FORMS[form].strengths[0].name
    assert mujoco_joint(ROTARY.with_effects(effect(form))).lost == ()
    (sentence,) = mujoco_joint(ROTARY.with_effects(effect(form, **{strength: 0.05}))).lost
    assert sentence.startswith(f"The effect {FORMS[form].name} is lost: ")
    assert f"{strength} = 0.05" in sentence


def test_numbers_and_names_read_back_exactly():
    third = eqx.tree_at(
        lambda d: (d.J, d.friction.sigma0), ROTARY, (jnp.asarray(1 / 3), jnp.asarray(2e3 / 7))
    )
    joint = mujoco_joint(third, name='a "b" & <c>')
    element, (motor, friction) = ET.fromstring(joint.joint), map(ET.fromstring, joint.actuators)
    assert element.get("name") == motor.get("joint") == friction.get("joint") == 'a "b" & <c>'
    assert float(element.get("armature", "nan")) == 1 / 3
    assert [float(part) for part in friction.get("lugre", "").split()] == [2e3 / 7, 6.0, 0.5, 0.62, 0.06]
    assert float(motor.get("gear", "nan")) == 16.0


@pytest.mark.parametrize(
    ("name", "value", "friction", "words"),
    [
        ("sigma0", 0.0, "lugre", "`drive` has sigma0 = 0; for MuJoCo it must be positive. Fit it again."),
        ("vs", -1.0, "lugre", "vs = -1; for MuJoCo it must be positive"),
        ("sigma2", -0.1, "frictionloss", "sigma2 = -0.1; for MuJoCo it must not be negative"),
        ("Fc", float("nan"), "frictionloss", "Fc = nan"),
    ],
)
def test_parameters_that_mujoco_cannot_take(name, value, friction, words):
    drive = eqx.tree_at(lambda d: getattr(d.friction, name), ROTARY, jnp.asarray(value))
    with pytest.raises(InputError) as caught:
        mujoco_joint(drive, friction=friction)
    assert words in str(caught.value)


def test_wrong_arguments_are_sentences():
    with pytest.raises(ValueError, match=r"`kind` is 'ball'; it must be"):
        mujoco_joint(ROTARY, kind="ball")
    with pytest.raises(ValueError, match=r"`friction` is 'dry'; it must be"):
        mujoco_joint(ROTARY, friction="dry")
    with pytest.raises(
        InputError, match=r"`body_inertia` is 1; it must lie between 0 and J = 0.03. J is all"
    ):
        mujoco_joint(ROTARY, body_inertia=1.0)
    many = eqx.tree_at(lambda d: d.J, ROTARY, jnp.ones(3))
    with pytest.raises(ValueError, match=r"`drive` holds arrays \(J\); MuJoCo takes one drive"):
        mujoco_joint(many)
