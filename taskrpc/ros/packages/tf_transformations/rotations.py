"""Rotations as quaternions (x, y, z, w), Euler angles and matrices.

`axes` names the order of Euler angles, as in transforms3d: "s" for fixed or "r" for moving axes,
then the three axes. The default `sxyz` is roll, pitch and yaw.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from transforms3d import affines, axangles, euler, quaternions

from .vectors import EPSILON, numbers, unit_vector


def _four_by_four(rotation: Any) -> Any:
    matrix = np.identity(4)
    matrix[:3, :3] = rotation
    return matrix


def _three_by_three(matrix: Any) -> Any:
    return affines.decompose(np.asarray(matrix, dtype=np.float64))[1]


def _w_first(quaternion: Any) -> tuple[Any, Any, Any, Any]:
    x, y, z, w = quaternion
    return w, x, y, z


def _w_last(quaternion: Any) -> tuple[Any, Any, Any, Any]:
    w, x, y, z = quaternion
    return x, y, z, w


# Euler angles


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Any:
    """The quaternion of roll, pitch and yaw, or of other Euler angles; in radians."""
    return _w_last(euler.euler2quat(ai, aj, ak, axes=axes))


def euler_from_quaternion(quaternion: Any, axes: Any = "sxyz") -> Any:
    """Roll, pitch and yaw of a quaternion, or other Euler angles; in radians."""
    return euler_from_matrix(quaternion_matrix(quaternion), axes)


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Any:
    """The matrix of Euler angles."""
    return _four_by_four(euler.euler2mat(ai, aj, ak, axes=axes))


def euler_from_matrix(matrix: Any, axes: Any = "sxyz") -> Any:
    """The Euler angles of a matrix. A rotation has several; this gives one of them."""
    return euler.mat2euler(matrix, axes=axes)


# Quaternions


def quaternion_about_axis(angle: float, axis: Any) -> Any:
    """The quaternion that turns by an angle about an axis."""
    return _w_last(quaternions.axangle2quat(axis, angle))


def quaternion_matrix(quaternion: Any) -> Any:
    """The matrix of a quaternion."""
    return _four_by_four(quaternions.quat2mat(_w_first(quaternion)))


def quaternion_from_matrix(matrix: Any) -> Any:
    """The quaternion of a matrix."""
    return _w_last(quaternions.mat2quat(_three_by_three(matrix)))


def quaternion_multiply(quaternion1: Any, quaternion0: Any) -> Any:
    """The quaternion that rotates by `quaternion0` first, then by `quaternion1`."""
    return _w_last(quaternions.qmult(_w_first(quaternion1), _w_first(quaternion0)))


def quaternion_conjugate(quaternion: Any) -> Any:
    """The quaternion with the opposite axis."""
    x, y, z, w = quaternion
    return numbers((-x, -y, -z, w))


def quaternion_inverse(quaternion: Any) -> Any:
    """The quaternion that undoes the rotation."""
    return quaternion_conjugate(quaternion) / np.dot(quaternion, quaternion)


def quaternion_slerp(
    quat0: Any, quat1: Any, fraction: float, spin: int = 0, shortestpath: bool = True
) -> Any:
    """The rotation between two, at a fraction from 0 to 1 of the arc.

    Args:
        quat0: the rotation at fraction 0.
        quat1: the rotation at fraction 1.
        fraction: where on the arc.
        spin: the number of further half turns.
        shortestpath: whether to take the shorter of the two arcs.
    """
    first, last = unit_vector(quat0[:4]), unit_vector(quat1[:4])
    if fraction in (0, 1):
        return last if fraction else first
    cosine = float(np.dot(first, last))
    if abs(abs(cosine) - 1) < EPSILON:
        return first
    if shortestpath and cosine < 0:
        cosine, last = -cosine, -last
    angle = math.acos(cosine) + spin * math.pi
    if abs(angle) < EPSILON:
        return first
    parts = math.sin((1 - fraction) * angle), math.sin(fraction * angle)
    return (parts[0] * first + parts[1] * last) / math.sin(angle)


def random_quaternion(rand: Any = None) -> Any:
    """A random rotation; all are equally likely.

    Args:
        rand: three random numbers from 0 to 1 to make it from.
    """
    a, b, c = np.random.rand(3) if rand is None else rand
    near, far = math.sqrt(1 - a), math.sqrt(a)
    b, c = 2 * math.pi * b, 2 * math.pi * c
    return numbers((math.sin(b) * near, math.cos(b) * near, math.sin(c) * far, math.cos(c) * far))


# Matrices


def rotation_matrix(angle: float, direction: Any, point: Any = None) -> Any:
    """The matrix that turns by an angle about an axis (through a point, else the origin)."""
    return axangles.axangle2aff(direction, angle, point=point)


def rotation_from_matrix(matrix: Any) -> Any:
    """Angle, direction and point of the axis of a matrix."""
    direction, angle, point = axangles.aff2axangle(matrix)
    return angle, direction, point


def random_rotation_matrix(rand: Any = None) -> Any:
    """The matrix of a random rotation; `rand` as in `random_quaternion`."""
    return quaternion_matrix(random_quaternion(rand))
