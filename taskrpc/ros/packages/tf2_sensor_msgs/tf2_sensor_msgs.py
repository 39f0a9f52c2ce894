"""Point clouds in another frame."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from sensor_msgs.msg import PointCloud2
from sensor_msgs_py.point_cloud2 import create_cloud, read_points
from tf2_py.geometry import NO_ROTATION, matrix_of_quaternion
from tf2_ros import ConvertRegistration, TransformRegistration

from taskrpc.ros.optional import needed

np = needed("numpy", "tf2_sensor_msgs")

_AXES = ("x", "y", "z")


def to_msg_msg(msg: Any) -> Any:
    """The message itself: it needs no conversion."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """The message itself: it needs no conversion."""
    return msg


def transform_points(point_cloud: Any, transform: Any) -> Any:
    """Points in the target frame.

    Args:
        point_cloud: an array with the three coordinates of a point in each row.
        transform: a Transform or TransformStamped.
    """
    transform = getattr(transform, "transform", transform)
    moved, turned = transform.translation, transform.rotation
    quaternion = (turned.x, turned.y, turned.z, turned.w)
    rotation = np.array(matrix_of_quaternion(quaternion if any(quaternion) else NO_ROTATION))
    return np.asarray(point_cloud) @ rotation.T + (moved.x, moved.y, moved.z)


def do_transform_cloud(cloud: PointCloud2, transform: Any) -> PointCloud2:
    """A cloud in the target frame: x, y and z of its points change, other fields do not.

    Args:
        cloud: the cloud, which stays as it is.
        transform: a TransformStamped, whose header the result gets.
    """
    points = read_points(cloud, reshape_organized_cloud=cloud.height > 1).copy()
    positions = np.stack([points[axis] for axis in _AXES], axis=-1)
    found = transform_points(positions, transform)
    for number, axis in enumerate(_AXES):
        points[axis] = found[..., number]
    result = create_cloud(deepcopy(transform.header), cloud.fields, points, cloud.point_step)
    result.is_dense = cloud.is_dense
    return result


TransformRegistration().add(PointCloud2, do_transform_cloud)
ConvertRegistration().add_to_msg(PointCloud2, to_msg_msg)
ConvertRegistration().add_from_msg(PointCloud2, from_msg_msg)
