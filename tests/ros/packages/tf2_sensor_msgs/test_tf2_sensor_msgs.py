"""Point clouds in another frame. The numbers are those of the original's own tests."""

import importlib
from types import SimpleNamespace

import numpy as np
import pytest

POINTS = np.array([[1, 2, 0], [10, 20, 30]], dtype=np.float32)


@pytest.fixture
def ros(ros_names):
    load = importlib.import_module
    clouds = load("sensor_msgs_py.point_cloud2")
    return SimpleNamespace(
        tf2=load("tf2_sensor_msgs"),
        tf2_ros=load("tf2_ros"),
        clouds=clouds,
        msg=load("geometry_msgs.msg"),
        PointField=load("sensor_msgs.msg").PointField,
        cloud=clouds.create_cloud_xyz32(load("std_msgs.msg").Header(frame_id="test"), POINTS),
    )


def transform_of(ros, translation, rotation):
    message = ros.msg.TransformStamped()
    moved = message.transform.translation
    moved.x, moved.y, moved.z = translation
    message.transform.rotation = ros.msg.Quaternion(**{"w": 0.0, **rotation})
    return message


def points_of(ros, cloud):
    return ros.clouds.read_points_numpy(cloud)


@pytest.mark.parametrize(
    ("translation", "rotation", "expected"),
    [
        ((300.0, 300.0, 300.0), {"w": 1.0}, POINTS + 300),
        ((0.0, 0.0, 0.0), {"x": 1.0}, [[1, -2, 0], [10, -20, -30]]),
        ((0.0, 0.0, 100.0), {"x": 1.0, "w": 6.1e-17}, [[1, -2, 100], [10, -20, 70]]),
        ((0.0, 0.0, 1.0), {}, POINTS + np.array([0, 0, 1])),  # four zeros rotate nothing
    ],
)
def test_points_have_the_documented_numbers(ros, translation, rotation, expected):
    transform = transform_of(ros, translation, rotation)
    before = bytes(ros.cloud.data)
    assert np.allclose(points_of(ros, ros.tf2.do_transform_cloud(ros.cloud, transform)), expected)
    assert np.allclose(ros.tf2.transform_points(POINTS, transform.transform), expected)
    assert bytes(ros.cloud.data) == before


def test_buffer_transforms_a_cloud(ros):
    buffer = ros.tf2_ros.Buffer()
    transform = transform_of(ros, (0.0, 0.0, 100.0), {"w": 1.0})
    transform.header.frame_id, transform.child_frame_id = "test", "base_footprint"
    buffer.set_transform_static(transform, "")
    found = buffer.transform(ros.cloud, "base_footprint")
    assert found.header.frame_id == "base_footprint"
    assert np.allclose(points_of(ros, found), POINTS - (0, 0, 100))


def test_other_fields_and_the_shape_of_the_cloud_stay(ros):
    fields = [
        ros.PointField(name=name, offset=4 * number, datatype=ros.PointField.FLOAT32, count=1)
        for number, name in enumerate(["x", "y", "z", "a"])
    ]
    dtype = ros.clouds.dtype_from_fields(fields, point_step=20)
    points = np.zeros((2, 3), dtype=dtype)
    points["a"] = 9
    cloud = ros.clouds.create_cloud(ros.cloud.header, fields, points, 20)
    found = ros.tf2.do_transform_cloud(cloud, transform_of(ros, (1.0, 2.0, 3.0), {"w": 1.0}))
    assert (found.height, found.width, found.point_step) == (2, 3, 20)
    assert ros.clouds.read_points(found)[0].tolist() == (1, 2, 3, 9)
    registration = ros.tf2_ros.ConvertRegistration()
    for get in (registration.get_to_msg, registration.get_from_msg):
        assert get(type(cloud))(cloud) is cloud
