"""Point clouds as NumPy arrays."""

import importlib

import numpy as np
import pytest

POINTS = [[1.0, 2.0, 3.0], [4.0, float("nan"), 6.0]]


@pytest.fixture
def clouds(ros_names):
    return importlib.import_module("sensor_msgs_py.point_cloud2")


@pytest.fixture
def msg(ros_names):
    return importlib.import_module("sensor_msgs.msg")


@pytest.fixture
def header(ros_names):
    return importlib.import_module("std_msgs.msg").Header(frame_id="map")


@pytest.mark.parametrize("kind", [list, np.array, iter])
def test_points_of_a_cloud_are_those_it_was_created_with(clouds, header, kind):
    cloud = clouds.create_cloud_xyz32(header, kind(POINTS))
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 2, 12, 24)
    assert (cloud.header.frame_id, cloud.is_dense, cloud.is_bigendian) == ("map", False, False)
    assert [(one.name, one.offset, one.datatype, one.count) for one in cloud.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
    ]
    points = clouds.read_points(cloud)
    assert points.dtype.names == ("x", "y", "z")
    np.testing.assert_array_equal(clouds.read_points_numpy(cloud), np.array(POINTS, np.float32))


def test_points_with_a_nan_and_other_fields_are_left_out(clouds, header):
    cloud = clouds.create_cloud_xyz32(header, POINTS)
    assert clouds.read_points_list(cloud, skip_nans=True) == [(1.0, 2.0, 3.0)]
    (first, _) = clouds.read_points_list(cloud, field_names=["z", "x"])
    assert (first.z, first.x) == (3.0, 1.0)
    assert clouds.read_points(cloud, ["x"], skip_nans=True)["x"].tolist() == [1.0, 4.0]
    assert clouds.read_points(cloud, ["x"], uvs=[1])["x"].tolist() == [4.0]


def test_cloud_without_points_has_none_with_a_nan(clouds, header):
    cloud = clouds.create_cloud_xyz32(header, [])
    assert len(clouds.read_points(cloud, skip_nans=True)) == 0


def test_fields_of_different_types_with_padding(clouds, msg, header):
    fields = [
        msg.PointField(name="x", offset=0, datatype=msg.PointField.FLOAT64, count=1),
        msg.PointField(name="ring", offset=8, datatype=msg.PointField.UINT16, count=1),
    ]
    cloud = clouds.create_cloud(header, fields, [(0.5, 7), (1.5, 8)], step=16)
    assert (cloud.point_step, len(cloud.data)) == (16, 32)
    assert clouds.read_points(cloud)["ring"].tolist() == [7, 8]
    with pytest.raises(AssertionError, match="All fields need to have the same datatype"):
        clouds.read_points_numpy(cloud)
    assert clouds.read_points_numpy(cloud, ["ring"]).tolist() == [[7], [8]]
    with pytest.raises(AssertionError, match="Requests field is not in the fields"):
        clouds.read_points(cloud, ["y"])


def test_organized_cloud_keeps_rows_and_columns(clouds, header):
    dtype = np.dtype([(name, np.float32) for name in "xyz"])
    points = np.zeros((2, 3), dtype)
    points["x"] = [[0, 1, 2], [3, 4, 5]]
    cloud = clouds.create_cloud_xyz32(header, points)
    assert (cloud.height, cloud.width, cloud.row_step) == (2, 3, 36)
    found = clouds.read_points(cloud, reshape_organized_cloud=True)
    np.testing.assert_array_equal(found["x"], points["x"])
    assert clouds.read_points(cloud, uvs=[(2, 0), (0, 1)])["x"].tolist() == [2, 3]


def test_big_endian_points_and_padded_rows(clouds, msg):
    rows = b"".join(np.array([n, n + 1], ">f4").tobytes() + b"pad!" for n in (1, 3))
    cloud = msg.PointCloud2(height=2, width=2, point_step=4, row_step=12, is_bigendian=True)
    cloud.fields = [msg.PointField(name="x", offset=0, datatype=7, count=1)]
    cloud.data = rows
    assert clouds.read_points(cloud)["x"].tolist() == [1, 2, 3, 4]
    assert bytes(cloud.data) == rows


def test_unknown_datatype_of_a_field_is_named(clouds, msg, header):
    field = msg.PointField(name="x", datatype=99, count=1)
    with pytest.raises(AssertionError, match="Field 'x' has the unknown datatype 99"):
        clouds.create_cloud(header, [field], [])


def test_a_field_may_have_several_values_and_no_name(clouds, msg):
    fields = [msg.PointField(name="", offset=4, datatype=msg.PointField.INT8, count=3)]
    dtype = clouds.dtype_from_fields(fields, point_step=8)
    assert (dtype.names, dtype.itemsize, dtype[0].shape) == (("unnamed_field_0",), 8, (3,))
