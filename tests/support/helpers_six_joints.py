"""A six-joint arm: its MuJoCo model, motions of it, and logs with friction hidden in three of its joints."""

import functools

import numpy as np
import pytest
from helpers_plants import effect

from frictionjax.arm import ArmLog
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate_imposed

ARM = """
<mujoco model="six">
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="base" pos="0 0 0.1" quat="0.9238795 0 0 0.3826834">
      <inertial pos="0 0 0" mass="4" diaginertia="0.01 0.01 0.01"/>
      <body name="turret" pos="0 0 0.08">
        <joint name="pan" axis="0 0 1" armature="0.3"/>
        <inertial pos="0.01 -0.03 0.04" mass="3.7" diaginertia="0.0103 0.0101 0.0066"/>
        <body name="upper" pos="0 0.138 0" quat="0.7071068 0 0.7071068 0">
          <joint name="lift" axis="0 1 0" armature="0.3"/>
          <inertial pos="0 -0.02 0.24" quat="0.99 0.05 0 0.1" mass="8.4" diaginertia="0.227 0.226 0.0152"/>
          <body name="fore" pos="0 -0.131 0.425">
            <joint name="elbow" axis="0 1 0" armature="0.2" ref="10"/>
            <inertial pos="0 0.01 0.2" mass="2.3" fullinertia="0.0495 0.0492 0.0041 0.0004 -0.0003 0.001"/>
            <body name="wrist" pos="0 0 0.392" quat="0.7071068 0 0.7071068 0">
              <joint name="bend" axis="0 1 0" armature="0.05"/>
              <inertial pos="0 0.127 0.01" mass="1.2" diaginertia="0.0025 0.0022 0.0022"/>
              <body name="turn" pos="0 0.127 0">
                <joint name="roll" axis="0 0 1" armature="0.05"/>
                <inertial pos="0.005 0 0.1" mass="1.2" diaginertia="0.0026 0.0025 0.0021"/>
                <body name="flange" pos="0 0 0.1">
                  <joint name="tip" axis="0 1 0" armature="0.05"/>
                  <inertial pos="0 0.0771683 0" mass="0.2" diaginertia="0.0002 0.0001 0.0001"/>
                  <body name="tool" pos="0.02 0.1 0.03">
                    <inertial pos="0.03 0.05 0.02" mass="0.9" diaginertia="0.002 0.001 0.0015"/>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = ("pan", "lift", "elbow", "bend", "roll", "tip")
RATE, SECONDS = 100.0, 20.0
COULOMB = (6.0, 8.0, 5.0, 1.5, 1.2, 1.0)
NOISE = 0.01  # of Coulomb friction, in the torques
STEP = 2e-5  # rad: noise of the positions
HIDDEN = {
    "lift": effect("DirectionAsymmetry", coulomb=0.2),
    "elbow": effect("QuadraticDrag", drag=1.25),
    "roll": effect("PositionDependence", linear=0.3, center=0.0, half_stroke=1.5),
}
"""Joint -> what its friction has beyond LuGre."""


def inverse(xml, q, qd, qdd):
    """What MuJoCo says that a motion takes of all joints of the model, shape `(n, j)`; no friction."""
    mujoco = pytest.importorskip("mujoco", minversion="4.0")
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )
    data, found = mujoco.MjData(model), np.zeros(q.shape)
    for k in range(q.shape[0]):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def fourier(seed, seconds, rate, *, base=0.1, harmonics=5, reach=0.5):
    """A smooth motion of six joints that visits many postures: q, qd, qdd, each of shape `(n, 6)`."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, qd, qdd = (np.zeros((t.size, len(JOINTS))) for _ in range(3))
    for k in range(len(JOINTS)):
        for h in range(1, harmonics + 1):
            w, phase = 2.0 * np.pi * base * h, rng.uniform(0.0, 2.0 * np.pi)
            size = reach * rng.uniform(0.5, 1.5) / np.sqrt(h)
            q[:, k] += size * np.sin(w * t + phase)
            qd[:, k] += size * w * np.cos(w * t + phase)
            qdd[:, k] -= size * w**2 * np.sin(w * t + phase)
    return q, qd, qdd


def plant(joint):
    """The friction of a joint."""
    level = COULOMB[JOINTS.index(joint)]
    friction = LuGre(4000.0 * level, 20.0 * level, 0.3 * level, level, 1.3 * level, 0.1)
    return Drive(1.0, friction, effects=(HIDDEN[joint],) if joint in HIDDEN else ())


@functools.cache
def measured():
    """Two logs to fit and one held out, and the true friction along each."""
    logs, frictions = [], []
    for seed, role in ((1, "fit"), (2, "fit"), (3, "holdout")):
        q, qd, qdd = fourier(seed, SECONDS, RATE)
        moved = [simulate_imposed(plant(joint), q[:, k], RATE) for k, joint in enumerate(JOINTS)]
        friction = np.stack([np.asarray(one.friction) for one in moved], axis=1)
        rng = np.random.default_rng(100 + seed)
        tau = inverse(ARM, q, qd, qdd) + friction + NOISE * np.array(COULOMB) * rng.standard_normal(q.shape)
        logs.append(ArmLog(f"log_{seed}", RATE, q + STEP * rng.standard_normal(q.shape), tau, role=role))
        frictions.append(friction)
    return tuple(logs), tuple(frictions)
