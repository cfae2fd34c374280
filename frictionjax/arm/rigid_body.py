"""Rigid bodies on joints: the torque that a motion takes, linear in masses, centres of mass and inertias.

For a body with the rotation R, angular velocity w, angular acceleration e, and acceleration a of its frame's origin
(against gravity), all in its own frame, Newton and Euler say of its mass m, h = m c and inertia I about the origin

    force  = m a + e x h + w x (w x h),    moment = h x a + I e + w x (I w)

Both are linear in the ten numbers (m, h, I). A joint carries the parts along its axis of the forces and moments of all
bodies behind it, and the acceleration of its own rotor (armature).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

JointCoordinates = Float[np.ndarray, "n j"]
Vectors = Float[np.ndarray, "n 3"]
Frames = Float[np.ndarray, "n 3 3"]

INERTIAL = ("mass", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""The ten numbers of a body, in this order."""
_UNITS = ("kg", *("kg*m",) * 3, *("kg*m^2",) * 6)


class RigidBody(eqx.Module):
    """The bodies of a robot, as a tree on hinges and slides; all lengths in m.

    **Attributes:**

    - `joints`: their names, those of a log, in its order; `hinge`: whether each turns, else it slides, shape `(j,)`.
    - `bodies`: names, each after its parent; `parent`: place of the parent in `bodies`, -1 for the world, shape `(b,)`.
    - `place`, `turn`: where a body stands in its parent with all joints at their reference, shapes `(b, 3)` and
        `(b, 3, 3)`.
    - `carried_by`: place of the body that each joint moves, shape `(j,)`; of several joints of one body, in the order
        `sequence`, shape `(j,)`.
    - `anchor`, `axis`: a point of each joint and its direction in the frame of its body, shape `(j, 3)`.
    - `reference`: position of each joint where bodies stand as said, shape `(j,)`.
    - `gravity`: m/s^2, shape `(3,)`.
    - `inertial`: the model's own ten numbers of each body, shape `(b, 10)`; `armature`: of each joint, shape `(j,)`.
    """

    joints: tuple[str, ...] = eqx.field(static=True)
    hinge: Bool[np.ndarray, " j"]
    bodies: tuple[str, ...] = eqx.field(static=True)
    parent: Int[np.ndarray, " b"]
    place: Float[np.ndarray, "b 3"]
    turn: Float[np.ndarray, "b 3 3"]
    carried_by: Int[np.ndarray, " j"]
    sequence: Int[np.ndarray, " j"]
    anchor: Float[np.ndarray, "j 3"]
    axis: Float[np.ndarray, "j 3"]
    reference: Float[np.ndarray, " j"]
    gravity: Float[np.ndarray, " 3"]
    inertial: Float[np.ndarray, "b 10"]
    armature: Float[np.ndarray, " j"]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of the columns of `regressor`: `body.mass`, ..., `joint.armature`."""
        own = [f"{body}.{name}" for body in self.bodies for name in INERTIAL]
        return (*own, *(f"{joint}.armature" for joint in self.joints))

    @property
    def units(self) -> tuple[str, ...]:
        """Their units, in the same order."""
        return (*_UNITS * len(self.bodies), *("kg*m^2" if hinge else "kg" for hinge in self.hinge))

    @property
    def values(self) -> Float[np.ndarray, " p"]:
        """Their values in the model, in the same order, shape `(p,)`."""
        return np.concatenate([self.inertial.ravel(), self.armature])

    def regressor(
        self, q: JointCoordinates, qd: JointCoordinates, qdd: JointCoordinates
    ) -> Float[np.ndarray, "n j p"]:
        """What each parameter, at one, takes of the torque of each joint along a motion.

        **Arguments:** `q`, `qd`, `qdd`: position (rad or m), velocity and acceleration of the joints, shape `(n, j)`.

        **Returns:** shape `(n, j, p)`: N m of hinges, N of slides, for each unit of a parameter.
        """
        n, count = q.shape
        found = np.zeros((n, count, len(self.bodies) * len(INERTIAL) + count))
        frames: list[_Moving] = []
        axes = np.zeros((count, n, 3))
        anchors = np.zeros((count, n, 3))
        behind: list[tuple[int, ...]] = []
        for body, parent in enumerate(self.parent):
            frame = _at_rest(n, self.gravity) if parent < 0 else frames[parent]
            frame = frame.at(self.place[body], self.turn[body])
            own = np.flatnonzero(self.carried_by == body)
            for k in own[np.argsort(self.sequence[own])]:
                axes[k] = frame.turn @ self.axis[k]
                anchors[k] = frame.origin + frame.turn @ self.anchor[k]
                move = frame.turned if self.hinge[k] else frame.slid
                frame = move(self.axis[k], self.anchor[k], q[:, k] - self.reference[k], qd[:, k], qdd[:, k])
            frames.append(frame)
            behind.append((*(() if parent < 0 else behind[parent]), *(int(k) for k in own)))
            columns = slice(len(INERTIAL) * body, len(INERTIAL) * (body + 1))
            for k in behind[body]:
                if self.hinge[k]:
                    lever = np.cross(axes[k], frame.origin - anchors[k])
                    found[:, k, columns] = frame.taken(lever, axes[k])
                else:
                    found[:, k, columns] = frame.taken(axes[k], np.zeros((n, 3)))
        for k in range(count):
            found[:, k, k - count] = qdd[:, k]
        return found


class _Moving(eqx.Module):
    """A frame along a motion, in the world: `origin`, `turn`, angular velocity `spin`, its rate `spin_rate`, and the
    acceleration of the origin against gravity, `lift`."""

    origin: Vectors
    turn: Frames
    spin: Vectors
    spin_rate: Vectors
    lift: Vectors

    def at(self, place: Float[np.ndarray, " 3"], turn: Float[np.ndarray, "3 3"]) -> "_Moving":
        """The frame that stands at `place` and `turn` in this one, and moves with it."""
        origin, lift = self._point(self.turn @ place)
        return _Moving(origin, self.turn @ turn, self.spin, self.spin_rate, lift)

    def turned(
        self,
        axis: Float[np.ndarray, " 3"],
        anchor: Float[np.ndarray, " 3"],
        angle: Float[np.ndarray, " n"],
        speed: Float[np.ndarray, " n"],
        rate: Float[np.ndarray, " n"],
    ) -> "_Moving":
        """This frame turned by `angle` about an `axis` through `anchor`, at a `speed` that changes at a `rate`."""
        pivot, lift = self._point(self.turn @ anchor)
        along = self.turn @ axis
        turn = self.turn @ _rotations(axis, angle)
        spin = self.spin + along * speed[:, None]
        spin_rate = self.spin_rate + along * rate[:, None] + np.cross(self.spin, along) * speed[:, None]
        about = _Moving(pivot, turn, spin, spin_rate, lift)
        origin, lift = about._point(-(turn @ anchor))
        return _Moving(origin, turn, spin, spin_rate, lift)

    def slid(
        self,
        axis: Float[np.ndarray, " 3"],
        anchor: Float[np.ndarray, " 3"],
        way: Float[np.ndarray, " n"],
        speed: Float[np.ndarray, " n"],
        rate: Float[np.ndarray, " n"],
    ) -> "_Moving":
        """This frame moved by `way` along an `axis`, at a `speed` that changes at a `rate`; `anchor` has no part."""
        along = self.turn @ axis
        origin, lift = self._point(along * way[:, None])
        lift = lift + 2.0 * np.cross(self.spin, along) * speed[:, None] + along * rate[:, None]
        return _Moving(origin, self.turn, self.spin, self.spin_rate, lift)

    def _point(self, arm: Vectors) -> tuple[Vectors, Vectors]:
        """Place and acceleration of the point at `arm` (in the world's directions) that moves with this frame."""
        across = np.cross(self.spin, arm)
        bent = np.cross(self.spin_rate, arm) + np.cross(self.spin, across)
        return self.origin + arm, self.lift + bent

    def taken(self, push: Vectors, twist: Vectors) -> Float[np.ndarray, "n 10"]:
        """What each of the ten numbers of a body in this frame, at one, makes of force . `push` + moment . `twist`, the
        moment about the origin; both in the world's directions."""
        w, e, a, f, z = (
            np.einsum("nji,nj->ni", self.turn, one)
            for one in (self.spin, self.spin_rate, self.lift, push, twist)
        )
        mass = _dot(f, a)
        centre = np.cross(f, e) + w * _dot(f, w) - f * _dot(w, w) + np.cross(a, z)
        return np.concatenate([mass, centre, _products(z, e) + _products(np.cross(z, w), w)], axis=1)


def _at_rest(n: int, gravity: Float[np.ndarray, " 3"]) -> _Moving:
    """The world during `n` samples."""
    zero = np.zeros((n, 3))
    return _Moving(zero, np.broadcast_to(np.eye(3), (n, 3, 3)), zero, zero, np.broadcast_to(-gravity, (n, 3)))


def _dot(a: Vectors, b: Vectors) -> Float[np.ndarray, "n 1"]:
    return np.sum(a * b, axis=1, keepdims=True)


def _products(a: Vectors, b: Vectors) -> Float[np.ndarray, "n 6"]:
    """What each of Ixx, Iyy, Izz, Ixy, Ixz, Iyz, at one, makes of `a` . I `b`."""
    mixed = [a[:, i] * b[:, j] + a[:, j] * b[:, i] for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.concatenate([a * b, np.stack(mixed, axis=1)], axis=1)


def _rotations(axis: Float[np.ndarray, " 3"], angle: Float[np.ndarray, " n"]) -> Frames:
    """Rotation matrices about a unit `axis`, Rodrigues' formula."""
    skew = np.cross(np.eye(3), axis)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * skew + (1.0 - c) * (skew @ skew)
