"""Messages of geometry_msgs in another frame.

Each function takes a message and a TransformStamped, and returns a new message with the header of
the transform. It changes neither argument.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from geometry_msgs.msg import (
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from tf2_py.geometry import (
    NO_ROTATION,
    Transform,
    Vector,
    matrix_of_quaternion,
    normalized,
    rotate,
)
from tf2_ros import ConvertRegistration, TransformRegistration


def to_msg_msg(msg: Any) -> Any:
    """The message itself: it needs no conversion."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """The message itself: it needs no conversion."""
    return msg


def do_transform_point(point: Any, transform: Any) -> Any:
    """A PointStamped in the target frame."""
    result = PointStamped(header=deepcopy(transform.header))
    _set(result.point, _transform_of(transform).apply(_vector_of(point.point)))
    return result


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """A Vector3Stamped in the target frame: rotated, but not moved."""
    result = Vector3Stamped(header=deepcopy(transform.header))
    _set(result.vector, rotate(_transform_of(transform).rotation, _vector_of(vector3.vector)))
    return result


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """A Pose in the target frame."""
    before = Transform(_vector_of(pose.position), _quaternion_of(pose.orientation))
    after = _transform_of(transform).after(before)
    result = Pose()
    _set(result.position, after.translation)
    turned = result.orientation
    turned.x, turned.y, turned.z, turned.w = normalized(after.rotation)
    return result


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """A PoseStamped in the target frame."""
    return PoseStamped(
        header=deepcopy(transform.header), pose=do_transform_pose(pose.pose, transform)
    )


def do_transform_pose_with_covariance(pose: Any, transform: Any) -> Any:
    """A PoseWithCovariance in the target frame."""
    return PoseWithCovariance(
        pose=do_transform_pose(pose.pose, transform),
        covariance=transform_covariance(pose.covariance, transform),
    )


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """A PoseWithCovarianceStamped in the target frame."""
    return PoseWithCovarianceStamped(
        header=deepcopy(transform.header),
        pose=do_transform_pose_with_covariance(pose.pose, transform),
    )


def do_transform_wrench(wrench: Any, transform: Any) -> Any:
    """A WrenchStamped in the target frame: force and torque are rotated, but not moved."""
    rotation = _transform_of(transform).rotation
    result = WrenchStamped(header=deepcopy(transform.header))
    _set(result.wrench.force, rotate(rotation, _vector_of(wrench.wrench.force)))
    _set(result.wrench.torque, rotate(rotation, _vector_of(wrench.wrench.torque)))
    return result


def transform_covariance(cov_in: Sequence[float], transform: Any) -> list[float]:
    """A covariance of 6 by 6 numbers, row by row, in the target frame.

    Each of its four blocks of 3 by 3 numbers, for position and rotation, is rotated.
    """
    matrix = matrix_of_quaternion(_transform_of(transform).rotation)
    axes = range(3)
    result = [0.0] * 36
    for down in (0, 3):
        for across in (0, 3):
            block = [[float(cov_in[(down + i) * 6 + across + j]) for j in axes] for i in axes]
            half = [[sum(matrix[i][k] * block[k][j] for k in axes) for j in axes] for i in axes]
            for i in axes:
                for j in axes:
                    value = sum(half[i][k] * matrix[j][k] for k in axes)
                    result[(down + i) * 6 + across + j] = value
    return result


def _transform_of(message: Any) -> Transform:
    transform = message.transform
    return Transform(_vector_of(transform.translation), _quaternion_of(transform.rotation))


def _quaternion_of(message: Any) -> tuple[float, float, float, float]:
    q = (message.x, message.y, message.z, message.w)
    return normalized(q) if any(q) else NO_ROTATION  # as in ROS, four zeros rotate nothing


def _vector_of(message: Any) -> Vector:
    return (message.x, message.y, message.z)


def _set(message: Any, vector: Vector) -> None:
    message.x, message.y, message.z = vector


def _register() -> None:
    transforms, conversions = TransformRegistration(), ConvertRegistration()
    for message, function in (
        (PointStamped, do_transform_point),
        (Vector3Stamped, do_transform_vector3),
        (PoseStamped, do_transform_pose_stamped),
        (PoseWithCovarianceStamped, do_transform_pose_with_covariance_stamped),
        (WrenchStamped, do_transform_wrench),
    ):
        transforms.add(message, function)
        conversions.add_to_msg(message, to_msg_msg)
        conversions.add_from_msg(message, from_msg_msg)


_register()
