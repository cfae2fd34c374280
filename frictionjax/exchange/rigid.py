"""Rigid bodies behind one joint: their inertia about its axis, and the force of gravity on it."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

Vector = Float[np.ndarray, "3"]
Matrix = Float[np.ndarray, "3 3"]


class Pose(NamedTuple):
    """Where a frame stands in another: its `origin` (m), and its `turn`, a rotation matrix."""

    origin: Vector
    turn: Matrix

    def then(self, inner: "Pose") -> "Pose":
        """The pose of a frame that stands at `inner` in this one."""
        return Pose(self.origin + self.turn @ inner.origin, self.turn @ inner.turn)


def still() -> Pose:
    """The pose of a frame that coincides with its parent."""
    return Pose(np.zeros(3), np.eye(3))


class Body(eqx.Module):
    """A rigid body: `mass` (kg), `centre` of mass (m, shape `(3,)`), `inertia` about it (kg m^2, shape `(3, 3)`)."""

    mass: float
    centre: Vector
    inertia: Matrix

    def seen_from(self, pose: Pose) -> "Body":
        """The body in the frame in which its own one stands at `pose`."""
        turned = pose.turn @ self.inertia @ pose.turn.T
        return Body(self.mass, pose.origin + pose.turn @ self.centre, turned)


class JointLoad(eqx.Module):
    """What the bodies behind a joint are to it.

    **Attributes:** `inertia` (about the axis of a hinge, kg m^2, or their mass, kg), and the opposing force of gravity
    at position x: `constant` on a slide (N), `sine` sin(x) + `cosine` cos(x) on a hinge (N m).
    """

    inertia: float
    constant: float = 0.0
    sine: float = 0.0
    cosine: float = 0.0


def load_of(
    bodies: list[Body], *, axis: Vector, anchor: Vector, gravity: Vector, hinge: bool, reference: float
) -> JointLoad:
    """The load of the `bodies` on a joint.

    **Arguments:**

    - `bodies`: all that move with it, where they stand at its `reference`, in one frame.
    - `axis`: direction of the joint, of unit length, shape `(3,)`.
    - `anchor`: a point of the axis, m, shape `(3,)`.
    - `gravity`: m/s^2, shape `(3,)`.
    - `hinge`: whether it turns; else it slides.
    - `reference`: position of the joint at which the bodies stand where they are said to, rad or m.
    """
    mass = sum(body.mass for body in bodies)
    if not hinge:
        return JointLoad(mass, constant=-mass * float(gravity @ axis))
    inertia, sine, cosine = 0.0, 0.0, 0.0
    for body in bodies:
        arm = body.centre - anchor
        across = arm - axis * (arm @ axis)
        inertia += float(axis @ body.inertia @ axis) + body.mass * float(across @ across)
        # The arm at an angle a beyond the reference is across cos a + (axis x across) sin a.
        cosine -= body.mass * float(axis @ np.cross(across, gravity))
        sine -= body.mass * float(axis @ np.cross(np.cross(axis, across), gravity))
    c, s = np.cos(reference), np.sin(reference)
    return JointLoad(inertia, sine=float(sine * c + cosine * s), cosine=float(cosine * c - sine * s))


def rotation(quaternion: Float[np.ndarray, "4"]) -> Matrix:
    """The rotation matrix of a `quaternion` w, x, y, z of any length."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def roll_pitch_yaw(angles: Vector) -> Matrix:
    """The rotation matrix of URDF's `angles` (rad) about fixed x, y and z."""
    turn = np.eye(3)
    for k, angle in enumerate(angles):
        half = np.zeros(4)
        half[0], half[1 + k] = np.cos(angle / 2), np.sin(angle / 2)
        turn = rotation(half) @ turn
    return turn


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Matrix:
    """The symmetric matrix with these elements."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
