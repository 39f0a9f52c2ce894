"""Reads and creates `sensor_msgs/msg/PointCloud2`.

A structured array has a name for each field of a point: `points["x"]`.
"""

from __future__ import annotations

import sys
from collections import namedtuple
from collections.abc import Iterable, Sequence
from typing import Any

from sensor_msgs.msg import PointCloud2, PointField

from taskrpc.ros.optional import needed

np = needed("numpy", "sensor_msgs_py")

DUMMY_FIELD_PREFIX = "unnamed_field"
"""Fields without a name get this and their number as a name."""

_DATATYPES: dict[int, Any] = {
    PointField.INT8: np.dtype(np.int8),
    PointField.UINT8: np.dtype(np.uint8),
    PointField.INT16: np.dtype(np.int16),
    PointField.UINT16: np.dtype(np.uint16),
    PointField.INT32: np.dtype(np.int32),
    PointField.UINT32: np.dtype(np.uint32),
    PointField.FLOAT32: np.dtype(np.float32),
    PointField.FLOAT64: np.dtype(np.float64),
}


def read_points(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> Any:
    """The points as a structured array.

    Args:
        cloud: the message.
        field_names: the wanted fields; None for all.
        skip_nans: whether to leave out points with a NaN.
        uvs: the numbers of the wanted points, or pairs (column, row); None for all.
        reshape_organized_cloud: whether the array has the rows and columns of the cloud.
    """
    assert isinstance(cloud, PointCloud2), "Cloud is not a sensor_msgs.msg.PointCloud2"
    # The rows of a cloud may have padding, which the strides skip.
    points = np.ndarray(
        shape=(cloud.height, cloud.width),
        dtype=dtype_from_fields(cloud.fields, point_step=cloud.point_step),
        buffer=cloud.data,
        strides=(cloud.row_step or cloud.width * cloud.point_step, cloud.point_step),
    ).reshape(-1)
    if field_names is not None:
        assert all(name in points.dtype.names for name in field_names), (
            "Requests field is not in the fields of the PointCloud!"
        )
        points = points[list(field_names)]
    if bool(cloud.is_bigendian) != (sys.byteorder == "big"):
        points = points.byteswap()  # a copy: the message stays as it is
    if skip_nans and not cloud.is_dense:
        points = points[~_has_nan(points)]
    if uvs is not None:
        points = points[_numbers(uvs, cloud.width)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.height, cloud.width)
    return points


def read_points_numpy(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> Any:
    """The points as an array with one row a point; the fields must have one data type.

    The arguments are those of `read_points`.
    """
    wanted = [one for one in cloud.fields if field_names is None or one.name in field_names]
    assert all(wanted[0].datatype == one.datatype for one in wanted[1:]), (
        "All fields need to have the same datatype. Use `read_points()` otherwise."
    )
    points = read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud)
    return needed("numpy.lib.recfunctions", "sensor_msgs_py").structured_to_unstructured(points)


def read_points_list(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
) -> list[Any]:
    """The points as a list of named tuples; the arguments are those of `read_points`."""
    assert isinstance(cloud, PointCloud2), "cloud is not a sensor_msgs.msg.PointCloud2"
    points = read_points(cloud, field_names, skip_nans, uvs)
    point = namedtuple("Point", points.dtype.names)  # type: ignore[misc]
    return [point._make(each.item()) for each in points]


def dtype_from_fields(fields: Iterable[PointField], point_step: int | None = None) -> Any:
    """The data type of a structured array with these fields.

    Args:
        fields: the fields; one with a count above 1 becomes an array.
        point_step: the bytes of a point; None for no bytes behind the last field.
    """
    names: list[str] = []
    formats, offsets = [], []
    for number, field in enumerate(fields):
        name = field.name or f"{DUMMY_FIELD_PREFIX}_{number}"
        assert name not in names, "Duplicate field names are not allowed!"
        assert field.count > 0, "Can't process fields with count = 0."
        assert field.datatype in _DATATYPES, (
            f"Field {name!r} has the unknown datatype {field.datatype};"
            " use a constant such as PointField.FLOAT32"
        )
        datatype = _DATATYPES[field.datatype]
        names.append(name)
        formats.append(datatype if field.count == 1 else (datatype, (field.count,)))
        offsets.append(field.offset)
    made = {"names": names, "formats": formats, "offsets": offsets}
    return np.dtype(made if point_step is None else {**made, "itemsize": point_step})


def create_cloud(
    header: Any,
    fields: Sequence[PointField],
    points: Any,
    step: int | None = None,
) -> PointCloud2:
    """A cloud of points.

    Args:
        header: the header of the message.
        fields: the fields of a point.
        points: a structured array; or an array or lists, with one row a point. A structured array
            of two dimensions gives an organized cloud.
        step: the bytes of a point; None for no bytes behind the last field.
    """
    dtype = dtype_from_fields(fields, point_step=step)
    if isinstance(points, np.ndarray) and points.dtype.names is not None:
        assert points.dtype == dtype, (
            "PointFields and structured NumPy array dtype do not match for all fields!"
            " Check their field order, names and types."
        )
    elif isinstance(points, np.ndarray):
        rows = needed("numpy.lib.recfunctions", "sensor_msgs_py")
        points = rows.unstructured_to_structured(points, dtype=dtype)
    else:
        points = np.array([tuple(each) for each in points], dtype=dtype)
    height, width = points.shape if points.ndim == 2 else (1, points.size)
    return PointCloud2(
        header=header,
        height=height,
        width=width,
        is_dense=False,
        is_bigendian=sys.byteorder == "big",
        fields=list(fields),
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * width,
        data=np.ascontiguousarray(points).tobytes(),
    )


def create_cloud_xyz32(header: Any, points: Any, step: int | None = None) -> PointCloud2:
    """A cloud of points with the fields x, y and z as 32-bit floats."""
    fields = [
        PointField(name=name, offset=4 * number, datatype=PointField.FLOAT32, count=1)
        for number, name in enumerate("xyz")
    ]
    return create_cloud(header, fields, points, step)


def _has_nan(points: Any) -> Any:
    found = np.zeros(len(points), dtype=bool)
    for name in points.dtype.names:
        values = points[name]
        found |= np.isnan(values).any(axis=tuple(range(1, values.ndim)))
    return found


def _numbers(uvs: Iterable[Any], width: int) -> Any:
    """The numbers of points that are given as numbers or as pairs (column, row)."""
    given = uvs if isinstance(uvs, np.ndarray) else np.array(list(uvs), dtype=int)
    return given[:, 1] * width + given[:, 0] if given.ndim == 2 else given
