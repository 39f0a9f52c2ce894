"""Point clouds as dicts of arrays, and as structured arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sensor_msgs.msg import PointCloud2, PointField
from sensor_msgs_py.point_cloud2 import create_cloud, dtype_from_fields, read_points
from std_msgs.msg import Header

from taskrpc.ros.optional import needed

from .conversions import converts_from_numpy, converts_to_numpy

np = needed("numpy", "ros2_numpy")

_DATATYPES = {
    "int8": PointField.INT8,
    "uint8": PointField.UINT8,
    "int16": PointField.INT16,
    "uint16": PointField.UINT16,
    "int32": PointField.INT32,
    "uint32": PointField.UINT32,
    "float32": PointField.FLOAT32,
    "float64": PointField.FLOAT64,
}


@converts_to_numpy(PointCloud2)
def point_cloud2_to_array(msg: PointCloud2) -> dict[str, Any]:
    """The points as a dict: `xyz`, and if the cloud has them, `rgb` and `intensity`."""
    points = read_points(msg)
    arrays = {"xyz": np.stack([points[name] for name in "xyz"], axis=-1)}
    if "rgb" in points.dtype.names:
        packed = np.ascontiguousarray(points["rgb"]).view(np.uint32)
        parts = [(packed >> shift) & 255 for shift in (16, 8, 0)]
        arrays["rgb"] = np.stack(parts, axis=-1).astype(np.uint8)
    if "intensity" in points.dtype.names:
        arrays["intensity"] = points["intensity"].reshape(-1, 1)
    return arrays


@converts_from_numpy(PointCloud2)
def array_to_point_cloud2(np_array: Any, frame_id: str = "base_link") -> PointCloud2:
    """A cloud of a dict as `point_cloud2_to_array` returns it, or of an array with x, y, z."""
    given = np_array if isinstance(np_array, Mapping) else {"xyz": np.asarray(np_array)}
    columns = dict(zip("xyz", np.asarray(given["xyz"], np.float32).T, strict=True))
    if "rgb" in given:
        red, green, blue = np.asarray(given["rgb"]).astype(np.uint32).T
        columns["rgb"] = ((red << 16) | (green << 8) | blue).view(np.float32)
    if "intensity" in given:
        columns["intensity"] = np.asarray(given["intensity"], np.float32).reshape(-1)
    made = np.zeros(len(columns["x"]), [(name, np.float32) for name in columns])
    for name, values in columns.items():
        made[name] = values
    return array_to_pointcloud2(made, frame_id=frame_id)


def pointcloud2_to_array(cloud_msg: PointCloud2, squeeze: bool = True) -> Any:
    """The points as a structured array with rows and columns; one row only is left out."""
    points = read_points(cloud_msg).reshape(cloud_msg.height, cloud_msg.width)
    return points[0] if squeeze and cloud_msg.height == 1 else points


def array_to_pointcloud2(
    cloud_arr: Any, stamp: Any = None, frame_id: str | None = None
) -> PointCloud2:
    """The cloud of a structured array."""
    header = Header(frame_id=frame_id or "")
    if stamp is not None:
        header.stamp = stamp
    fields = dtype_to_fields(cloud_arr.dtype)
    return create_cloud(header, fields, cloud_arr, step=cloud_arr.dtype.itemsize)


def get_xyz_points(cloud_array: Any, remove_nans: bool = True, dtype: Any = float) -> Any:
    """The columns x, y, z of a structured array; by default without points with a NaN."""
    points = np.stack([cloud_array[name] for name in "xyz"], axis=-1).astype(dtype)
    return points[np.isfinite(points).all(axis=-1)] if remove_nans else points


def pointcloud2_to_xyz_array(cloud_msg: PointCloud2, remove_nans: bool = True) -> Any:
    """The columns x, y, z of a cloud."""
    return get_xyz_points(pointcloud2_to_array(cloud_msg), remove_nans)


def dtype_to_fields(dtype: Any) -> list[PointField]:
    """The fields of a structured type."""
    fields = []
    for name in dtype.names:
        inner, offset = dtype.fields[name][:2]
        base, shape = inner.subdtype or (inner, ())
        count = int(np.prod(shape)) if shape else 1
        field = PointField(name=name, offset=offset, datatype=_DATATYPES[base.name], count=count)
        fields.append(field)
    return fields


def fields_to_dtype(fields: Sequence[PointField], point_step: int) -> Any:
    """The structured type of fields."""
    return dtype_from_fields(fields, point_step)


def split_rgb_field(cloud_arr: Any) -> Any:
    """A structured array with r, g, b of uint8 instead of the field rgb."""
    packed = np.ascontiguousarray(cloud_arr["rgb"]).view(np.uint32)
    others = [(name, cloud_arr.dtype[name]) for name in cloud_arr.dtype.names if name != "rgb"]
    made = np.zeros(cloud_arr.shape, [*others, *((name, np.uint8) for name in "rgb")])
    for name, _ in others:
        made[name] = cloud_arr[name]
    for name, shift in zip("rgb", (16, 8, 0), strict=True):
        made[name] = (packed >> shift) & 255
    return made


def merge_rgb_fields(cloud_arr: Any) -> Any:
    """A structured array with a field rgb of float32 instead of r, g, b."""
    red, green, blue = (cloud_arr[name].astype(np.uint32) for name in "rgb")
    others = [(name, cloud_arr.dtype[name]) for name in cloud_arr.dtype.names if name not in "rgb"]
    made = np.zeros(cloud_arr.shape, [*others, ("rgb", np.float32)])
    for name, _ in others:
        made[name] = cloud_arr[name]
    made["rgb"] = ((red << 16) | (green << 8) | blue).view(np.float32)
    return made
