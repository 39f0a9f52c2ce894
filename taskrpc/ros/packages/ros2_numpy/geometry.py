"""Vectors, rotations and poses as arrays; with `hom`, points as homogeneous coordinates."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import Point, Pose, Quaternion, Transform, Vector3

from taskrpc.ros.optional import needed

from .conversions import converts_from_numpy, converts_to_numpy

np = needed("numpy", "ros2_numpy")


@converts_to_numpy(Vector3)
def vector3_to_numpy(msg: Vector3, hom: bool = False) -> Any:
    """x, y, z, and with `hom` a 0."""
    return np.array([msg.x, msg.y, msg.z, *([0.0] if hom else [])])


@converts_from_numpy(Vector3)
def numpy_to_vector3(arr: Any) -> Vector3:
    """The vector of x, y, z; a fourth value must be 0."""
    x, y, z = _three(arr, 0.0)
    return Vector3(x=x, y=y, z=z)


@converts_to_numpy(Point)
def point_to_numpy(msg: Point, hom: bool = False) -> Any:
    """x, y, z, and with `hom` a 1."""
    return np.array([msg.x, msg.y, msg.z, *([1.0] if hom else [])])


@converts_from_numpy(Point)
def numpy_to_point(arr: Any) -> Point:
    """The point of x, y, z; they are divided by a fourth value."""
    values = np.asarray(arr, dtype=float)
    x, y, z = _three(values / values[-1] if len(values) == 4 else values, 1.0)
    return Point(x=x, y=y, z=z)


@converts_to_numpy(Quaternion)
def quat_to_numpy(msg: Quaternion) -> Any:
    """x, y, z, w."""
    return np.array([msg.x, msg.y, msg.z, msg.w])


@converts_from_numpy(Quaternion)
def numpy_to_quat(arr: Any) -> Quaternion:
    """The quaternion of x, y, z, w."""
    x, y, z, w = (float(each) for each in arr)
    return Quaternion(x=x, y=y, z=z, w=w)


@converts_to_numpy(Transform)
def transform_to_numpy(msg: Transform) -> Any:
    """A matrix of 4 x 4."""
    return _matrix(msg.translation, msg.rotation)


@converts_from_numpy(Transform)
def numpy_to_transform(arr: Any) -> Transform:
    """The transform of a matrix of 4 x 4."""
    return Transform(translation=numpy_to_vector3(arr[:3, 3]), rotation=_rotation(arr))


@converts_to_numpy(Pose)
def pose_to_numpy(msg: Pose) -> Any:
    """A matrix of 4 x 4."""
    return _matrix(msg.position, msg.orientation)


@converts_from_numpy(Pose)
def numpy_to_pose(arr: Any) -> Pose:
    """The pose of a matrix of 4 x 4."""
    return Pose(position=numpy_to_point(arr[:3, 3]), orientation=_rotation(arr))


def _three(values: Any, last: float) -> tuple[float, float, float]:
    x, y, z, *more = (float(each) for each in values)
    if more not in ([], [last]):
        raise ValueError(f"expected three values, or {last:g} as the fourth one, got {values}")
    return x, y, z


def _matrix(place: Any, rotation: Quaternion) -> Any:
    x, y, z, w = quat_to_numpy(rotation) / (np.linalg.norm(quat_to_numpy(rotation)) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), place.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), place.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), place.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _rotation(matrix: Any) -> Quaternion:
    """The quaternion of a rotation: the eigenvector of the largest eigenvalue (Bar-Itzhack)."""
    m = np.asarray(matrix, dtype=float)
    sums = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m[:3, :3])],
        ]
    )
    values, vectors = np.linalg.eigh(sums)  # it reads only the lower half
    found = vectors[:, np.argmax(values)]
    return numpy_to_quat(-found if found[3] < 0 else found)
