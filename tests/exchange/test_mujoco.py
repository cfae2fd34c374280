"""`mujoco_joint`: what it writes is MJCF that moves as `simulate` does, and it says what it leaves out."""

import xml.etree.ElementTree as ET

import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from helpers_plants import FORMS, PLANTS, ROTARY, STAGE, effect

from frictionjax.core import Estimate, InputError
from frictionjax.estimation import FitResult
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


def test_wrong_arguments_are_sentences(monkeypatch):
    # Some are of a wrong type, also for a run in which types are checked.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=r"`kind` is 'ball'; it must be"):
        mujoco_joint(ROTARY, kind="ball")
    with pytest.raises(ValueError, match=r"`friction` is 'dry'; it must be"):
        mujoco_joint(ROTARY, friction="dry")
    with pytest.raises(
        InputError, match=r"`body_inertia` is 1; it must lie between 0 and J = 0.03. J is the inertia"
    ):
        mujoco_joint(ROTARY, body_inertia=1.0)
    many = eqx.tree_at(lambda d: d.J, ROTARY, jnp.ones(3))
    with pytest.raises(ValueError, match=r"`drive` has arrays as parameters \(J\); MuJoCo takes one drive"):
        mujoco_joint(many)


FREE = ("J", "sigma0", "sigma1", "sigma2", "Fc", "vs", "stiffness")


def fitted(drive, free=FREE, **ends):
    """What a fit of `drive` might have found: errors of 1 % or as in `ends`, Fs tied to Fc, springs that correlate."""
    labels = {"J": drive.J} | {name: getattr(drive.friction, name) for name in ("Fs", *FREE[1:6])}
    springs = [spring.stiffness for spring in drive.effects]
    labels |= dict(zip(("stiffness", "return_spring.stiffness"), springs, strict=False))
    errors = {name: 0.01 * abs(float(value)) for name, value in labels.items()} | ends
    own = np.array([errors[name] for name in free])
    matrix = np.diag(own**2)
    if "return_spring.stiffness" in free:
        i, j = free.index("stiffness"), free.index("return_spring.stiffness")
        matrix[i, j] = matrix[j, i] = -0.9 * own[i] * own[j]
    return FitResult(
        drive=drive,
        parameters={name: Estimate(float(value), errors[name], "1") for name, value in labels.items()},
        names=free,
        covariance=matrix,
        covariance_white=matrix,
        noise={},
        cost=0.0,
        success=True,
        message="",
        at_bounds=(),
    )


SPRUNG = ROTARY.with_effects(effect("ReturnSpring", stiffness=2.0))


@pytest.mark.parametrize("friction", ["lugre", "frictionloss"])
def test_a_fit_is_its_drive_with_standard_errors(friction):
    joint = mujoco_joint(fitted(SPRUNG), friction=friction)
    plain = mujoco_joint(SPRUNG, friction=friction)
    assert plain.stderr == {}
    assert (joint.joint, joint.actuators, joint.lost) == (plain.joint, plain.actuators, plain.lost)
    expected = {"armature": 3e-4, "body_inertia": 0.0, "damping": 6e-4, "gear": 0.0, "stiffness": 0.02}
    if friction == "lugre":
        expected |= {"sigma0": 20.0, "sigma1": 0.06, "Fc": 5e-3, "Fs": 6.2e-3, "vs": 6e-4}
    else:
        expected |= {"frictionloss": 5e-3}
        assert joint.lost[0].startswith("Presliding is lost")
    assert joint.stderr == pytest.approx(expected)


def test_the_error_of_the_inertia_goes_where_the_inertia_goes():
    """A body that is given is known; the armature is the rest."""
    result = fitted(SPRUNG)
    for kind, body, expected in (
        ("slide", None, (0.0, 3e-4)),
        ("slide", 0.01, (3e-4, 0.0)),
        ("hinge", 0.01, (3e-4, 0.0)),
    ):
        stderr = mujoco_joint(result, kind=kind, body_inertia=body).stderr
        assert (stderr["armature"], stderr["body_inertia"]) == pytest.approx(expected)


def test_springs_add_with_their_correlation():
    """Two springs of 2 % each and -0.9 between them; what is tied adds at its worst."""
    two = SPRUNG.with_effects(effect("ReturnSpring", stiffness=2.0))
    both = (*FREE, "return_spring.stiffness")
    assert mujoco_joint(fitted(two, both)).stderr["stiffness"] == pytest.approx(0.02 * np.sqrt(0.2))
    assert mujoco_joint(fitted(two)).stderr["stiffness"] == pytest.approx(0.04)


def test_what_the_data_do_not_hold_has_an_infinite_error():
    stderr = mujoco_joint(fitted(SPRUNG, sigma2=np.inf, stiffness=np.inf)).stderr
    assert [name for name, error in stderr.items() if error == np.inf] == ["damping", "stiffness"]
