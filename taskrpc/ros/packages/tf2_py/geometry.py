"""Rotations and rigid transforms: quaternions, Euler angles, matrices, interpolation.

A quaternion is a tuple (x, y, z, w), as in ROS messages. A vector is a tuple (x, y, z).
"""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]

ORIGIN: Vector = (0.0, 0.0, 0.0)
NO_ROTATION: Quaternion = (0.0, 0.0, 0.0, 1.0)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation that rotates by `b` first, then by `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a rotation by a unit quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """A vector, rotated by a unit quaternion."""
    x, y, z, w = q
    vx, vy, vz = v
    # twice the cross product of the quaternion's vector part and v
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def normalized(q: Quaternion) -> Quaternion:
    """The unit quaternion of the same rotation; of the two possible ones, that of tf2.

    tf2 keeps rotations as matrices. So the sign of a quaternion that it returns does not depend
    on the sign that it got: `w` is positive, or for rotations by more than 120 degrees the largest
    of x, y and z. A quaternion of length 0 or infinity gives NaNs.
    """
    x, y, z, w = q
    length = math.hypot(x, y, z, w)
    if length == 0 or not math.isfinite(length):
        return (math.nan, math.nan, math.nan, math.nan)
    if abs(length - 1) < 1e-15:
        length = 1.0  # a unit quaternion stays as it is, to the last bit
    x, y, z, w = x / length, y / length, z / length, w / length
    decisive = w if w * w > 0.25 else max((x, y, z), key=abs)
    sign = -1.0 if decisive < 0 else 1.0
    return (sign * x + 0.0, sign * y + 0.0, sign * z + 0.0, sign * w + 0.0)  # no -0.0


def slerp(a: Quaternion, b: Quaternion, ratio: float) -> Quaternion:
    """The rotation on the shorter arc between two, at a ratio from 0 (`a`) to 1 (`b`)."""
    cosine = sum(one * other for one, other in zip(a, b, strict=True))
    if cosine < 0:
        cosine, b = -cosine, (-b[0], -b[1], -b[2], -b[3])
    angle = math.acos(min(1.0, cosine))
    if (sine := math.sin(angle)) < 1e-12:
        return a
    first, second = math.sin((1 - ratio) * angle) / sine, math.sin(ratio * angle) / sine
    return (
        first * a[0] + second * b[0],
        first * a[1] + second * b[1],
        first * a[2] + second * b[2],
        first * a[3] + second * b[3],
    )


def quaternion_of_angles(roll: float, pitch: float, yaw: float) -> Quaternion:
    """The rotation about the fixed axes x, y and z, in this order; angles in radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def angles_of_quaternion(q: Quaternion) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation, in radians. If pitch is a right angle, yaw is 0."""
    m = matrix_of_quaternion(q)
    if abs(m[2][0]) >= 1:
        roll = math.atan2(m[2][1], m[2][2])
        return roll, math.copysign(math.pi / 2, -m[2][0]), 0.0
    return math.atan2(m[2][1], m[2][2]), -math.asin(m[2][0]), math.atan2(m[1][0], m[0][0])


def matrix_of_quaternion(q: Quaternion) -> Matrix:
    """The rotation matrix of a quaternion of any length but 0, as rows."""
    x, y, z, w = q
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
        (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
    )


class Transform(NamedTuple):
    """Where a frame is in another frame: rotate its coordinates, then translate them."""

    translation: Vector = ORIGIN
    rotation: Quaternion = NO_ROTATION

    def apply(self, point: Vector) -> Vector:
        """The point in the other frame's coordinates."""
        x, y, z = rotate(self.rotation, point)
        return x + self.translation[0], y + self.translation[1], z + self.translation[2]

    def after(self, first: Transform) -> Transform:
        """The transform that applies `first`, then this one."""
        return Transform(self.apply(first.translation), multiply(self.rotation, first.rotation))

    def inverse(self) -> Transform:
        """The transform that undoes this one."""
        back = conjugate(self.rotation)
        x, y, z = rotate(back, self.translation)
        return Transform((0.0 - x, 0.0 - y, 0.0 - z), back)  # no -0.0

    def toward(self, other: Transform, ratio: float) -> Transform:
        """The transform between this one (ratio 0) and another (ratio 1)."""
        a, b = self.translation, other.translation
        between = (
            a[0] + (b[0] - a[0]) * ratio,
            a[1] + (b[1] - a[1]) * ratio,
            a[2] + (b[2] - a[2]) * ratio,
        )
        return Transform(between, slerp(self.rotation, other.rotation, ratio))
