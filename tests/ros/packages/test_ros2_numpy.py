"""Messages as NumPy arrays and back."""

import importlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st


@pytest.fixture
def rnp(ros_names):
    return importlib.import_module("ros2_numpy")


@pytest.fixture
def geometry(ros_names):
    return importlib.import_module("geometry_msgs.msg")


def test_image_and_array_have_the_same_pixels(rnp):
    image = importlib.import_module("sensor_msgs.msg").Image
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    message = rnp.msgify(image, pixels, encoding="rgb8")
    assert (message.height, message.width, message.step) == (2, 4, 12)
    np.testing.assert_array_equal(rnp.numpify(message), pixels)
    grey = rnp.msgify(image, np.ones((2, 4), np.float32), "32FC1")
    assert rnp.numpify(grey).shape == (2, 4)
    with pytest.raises(TypeError, match="expected an array of uint8 with 1 channels for mono8"):
        rnp.msgify(image, pixels, "mono8")
    with pytest.raises(TypeError, match="Unrecognized encoding cmyk"):
        rnp.msgify(image, pixels, "cmyk")


def test_map_masks_unknown_cells(rnp):
    grid = importlib.import_module("nav_msgs.msg").OccupancyGrid
    cells = np.ma.array(np.array([[0, 100, 5]], np.int8), mask=[[False, False, True]])
    message = rnp.msgify(grid, cells)
    assert (list(message.data), message.info.width, message.info.height) == ([0, 100, -1], 3, 1)
    assert rnp.numpify(message).mask.tolist() == [[False, False, True]]
    with pytest.raises(TypeError, match="Array must be of int8s"):
        rnp.msgify(grid, np.zeros((2, 2)))


def test_points_and_vectors(rnp, geometry):
    point = geometry.Point(x=1.0, y=2.0, z=3.0)
    assert rnp.numpify(point).tolist() == [1, 2, 3]
    assert rnp.numpify(point, hom=True).tolist() == [1, 2, 3, 1]
    assert rnp.msgify(geometry.Point, np.array([2, 4, 6, 2])) == point
    assert rnp.numpify(geometry.Vector3(x=1.0), hom=True).tolist() == [1, 0, 0, 0]
    assert rnp.msgify(geometry.Vector3, [0, 1, 0]).y == 1
    with pytest.raises(ValueError, match="or 0 as the fourth one"):
        rnp.msgify(geometry.Vector3, [0, 1, 0, 1])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.floats(-10, 10), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-100, 100), min_size=3, max_size=3),
)
def test_matrix_of_a_pose_gives_the_same_pose(rnp, geometry, rotation, place):
    x, y, z, w = np.array(rotation) / np.linalg.norm(rotation) * (1 if rotation[3] >= 0 else -1)
    pose = geometry.Pose()
    pose.position.x, pose.position.y, pose.position.z = place
    pose.orientation = geometry.Quaternion(x=float(x), y=float(y), z=float(z), w=float(w))
    matrix = rnp.numpify(pose)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(matrix) == pytest.approx(1)
    same = rnp.msgify(geometry.Pose, matrix)
    assert rnp.numpify(same.position).tolist() == pytest.approx(place)
    np.testing.assert_allclose(rnp.numpify(same), matrix, atol=1e-6)


def test_a_quarter_turn_about_z_turns_x_into_y(rnp, geometry):
    turn = geometry.Transform()
    turn.rotation.z = turn.rotation.w = 0.5**0.5
    turn.translation.x = 5.0
    np.testing.assert_allclose(rnp.numpify(turn) @ [1, 0, 0, 1], [5, 1, 0, 1], atol=1e-12)
    same = rnp.msgify(geometry.Transform, rnp.numpify(turn))
    assert same.rotation.z == pytest.approx(0.5**0.5)


def test_cloud_is_a_dict_of_arrays(rnp):
    cloud = importlib.import_module("sensor_msgs.msg").PointCloud2
    xyz = np.array([[1, 2, 3], [4, 5, 6]], np.float32)
    colours = np.array([[255, 0, 7], [1, 2, 3]], np.uint8)
    message = rnp.msgify(cloud, {"xyz": xyz, "rgb": colours, "intensity": np.array([[9], [8]])})
    assert [one.name for one in message.fields] == ["x", "y", "z", "rgb", "intensity"]
    found = rnp.numpify(message)
    np.testing.assert_array_equal(found["xyz"], xyz)
    np.testing.assert_array_equal(found["rgb"], colours)
    assert found["intensity"].tolist() == [[9], [8]]


def test_structured_clouds(rnp):
    made = np.zeros(2, [("x", np.float32), ("y", np.float32), ("z", np.float32), ("rgb", "f4")])
    made["x"] = [1, np.nan]
    message = rnp.point_cloud2.array_to_pointcloud2(made, frame_id="lidar")
    assert message.header.frame_id == "lidar"
    assert rnp.point_cloud2.pointcloud2_to_array(message).tobytes() == made.tobytes()
    assert rnp.point_cloud2.pointcloud2_to_xyz_array(message).tolist() == [[1, 0, 0]]
    split = rnp.point_cloud2.split_rgb_field(made)
    split["g"] = 200
    again = rnp.point_cloud2.split_rgb_field(rnp.point_cloud2.merge_rgb_fields(split))
    assert again["g"].tolist() == [200, 200]
    assert rnp.point_cloud2.fields_to_dtype(message.fields, message.point_step) == made.dtype


def test_a_program_can_register_a_conversion(rnp):
    text = importlib.import_module("std_msgs.msg").String
    assert rnp.numpify(None) is rnp.msgify(text, None) is rnp.numpify([]) is None
    with pytest.raises(ValueError, match="Unable to convert message String, only supports"):
        rnp.numpify(text())
    rnp.converts_to_numpy(text, plural=True)(lambda all_: np.array([one.data for one in all_]))
    rnp.converts_from_numpy(text)(lambda array: text(data=str(array)))
    assert rnp.numpify([text(data="a")]).tolist() == ["a"]
    assert rnp.msgify(text, 5).data == "5"
