"""A virtual trackball: drags of a pointer in a window turn an object."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .rotations import (
    quaternion_from_matrix,
    quaternion_matrix,
    quaternion_multiply,
    quaternion_slerp,
)
from .vectors import EPSILON, numbers, unit_vector, vector_norm


class Arcball:
    """A ball in a window that the pointer turns.

    Args:
        initial: its first rotation, as a quaternion or matrix.

    Raises:
        ValueError: `initial` is neither.
    """

    def __init__(self, initial: Any = None) -> None:
        self._axis: Any = None
        self._axes: Any = None
        self._radius = 1.0
        self._center = [0.0, 0.0]
        self._vdown = numbers((0, 0, 1))
        self._constrain = False
        first = numbers((0, 0, 0, 1) if initial is None else initial)
        if first.shape == (4, 4):
            first = quaternion_from_matrix(first)
        elif first.shape != (4,):
            raise ValueError("initial not a quaternion or matrix.")
        self._qdown = self._qnow = self._qpre = unit_vector(first)

    def place(self, center: Any, radius: float) -> None:
        """Set the place and the size of the ball in the window."""
        self._radius = float(radius)
        self._center = [center[0], center[1]]

    def setaxes(self, *axes: Any) -> None:
        """Set the axes that the ball turns about when it is constrained."""
        self._axes = [unit_vector(axis) for axis in axes]

    def setconstrain(self, constrain: bool) -> None:
        """Constrain the ball to its axes, or not."""
        self._constrain = constrain is True

    def getconstrain(self) -> bool:
        """Whether the ball is constrained to its axes."""
        return self._constrain

    def down(self, point: Any) -> None:
        """Begin to drag at a point of the window."""
        self._vdown = arcball_map_to_sphere(point, self._center, self._radius)
        self._qdown = self._qpre = self._qnow
        self._axis = None
        if self._constrain and self._axes is not None:
            self._axis = arcball_nearest_axis(self._vdown, self._axes)
            self._vdown = arcball_constrain_to_axis(self._vdown, self._axis)

    def drag(self, point: Any) -> None:
        """Drag to a point of the window."""
        here = arcball_map_to_sphere(point, self._center, self._radius)
        if self._axis is not None:
            here = arcball_constrain_to_axis(here, self._axis)
        self._qpre = self._qnow
        axis = np.cross(self._vdown, here)
        if np.dot(axis, axis) < EPSILON:
            self._qnow = self._qdown
        else:
            turn = (*axis, np.dot(self._vdown, here))
            self._qnow = numbers(quaternion_multiply(turn, self._qdown))

    def next(self, acceleration: float = 0.0) -> None:
        """Continue the rotation of the last drag."""
        turned = quaternion_slerp(self._qpre, self._qnow, 2 + acceleration, 0)
        self._qpre, self._qnow = self._qnow, turned

    def matrix(self) -> Any:
        """The rotation of the ball."""
        return quaternion_matrix(self._qnow)


def arcball_map_to_sphere(point: Any, center: Any, radius: float) -> Any:
    """The point of the unit sphere that is at a point of the window."""
    x, y = (point[0] - center[0]) / radius, (center[1] - point[1]) / radius
    square = x * x + y * y
    if square > 1:
        return numbers((x, y, 0)) / math.sqrt(square)
    return numbers((x, y, math.sqrt(1 - square)))


def arcball_constrain_to_axis(point: Any, axis: Any) -> Any:
    """The point of the sphere, perpendicular to an axis, that is nearest to a point."""
    axis = numbers(axis)
    flat = numbers(point) - axis * np.dot(axis, point)
    if (length := vector_norm(flat)) > EPSILON:
        return flat / (-length if flat[2] < 0 else length)
    return numbers((1, 0, 0)) if axis[2] == 1 else unit_vector((-axis[1], axis[0], 0))


def arcball_nearest_axis(point: Any, axes: Any) -> Any:
    """The axis whose arc is nearest to a point."""
    return max(axes, key=lambda axis: np.dot(arcball_constrain_to_axis(point, axis), point))
