"""Messages in another frame. The numbers are those of the original's own tests."""

import importlib
from types import SimpleNamespace

import pytest

COVARIANCE = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0] * 6
TURNED_COVARIANCE = [
    *(1, -2, -3, 4, -5, -6),
    *(-1, 2, 3, -4, 5, 6),
    *(-1, 2, 3, -4, 5, 6),
    *(1, -2, -3, 4, -5, -6),
    *(-1, 2, 3, -4, 5, 6),
    *(-1, 2, 3, -4, 5, 6),
]


@pytest.fixture
def ros(ros_names):
    load = importlib.import_module
    return SimpleNamespace(
        msg=load("geometry_msgs.msg"),
        tf2=load("tf2_geometry_msgs"),
        tf2_ros=load("tf2_ros"),
        Time=load("rclpy.time").Time,
    )


def transform_of(ros, x, y, z, rotation):
    message = ros.msg.TransformStamped(child_frame_id="b")
    message.header.frame_id = "a"
    message.header.stamp.sec = 2
    moved = message.transform.translation
    moved.x, moved.y, moved.z = x, y, z
    turned = message.transform.rotation
    turned.x, turned.y, turned.z, turned.w = rotation
    return message


def stamped(kind, frame="a"):
    message = kind()
    message.header.frame_id = frame
    message.header.stamp.sec = 2
    return message


def xyz(message):
    return (message.x, message.y, message.z)


def fill(message, x, y, z):
    message.x, message.y, message.z = x, y, z


@pytest.fixture
def buffer(ros):
    buffer = ros.tf2_ros.Buffer()
    buffer.set_transform(transform_of(ros, 1.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0)), "test")
    return buffer


def test_buffer_transforms_points_and_poses(ros, buffer):
    point = stamped(ros.msg.PointStamped)
    fill(point.point, 1.0, 2.0, 3.0)
    found = buffer.transform(point, "b", new_type=ros.msg.PointStamped)
    assert (xyz(found.point), found.header.frame_id) == ((0, -2, -3), "b")
    pose = stamped(ros.msg.PoseStamped)
    fill(pose.pose.position, 1.0, 2.0, 3.0)
    pose.pose.orientation = ros.msg.Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)
    found = buffer.transform(pose, "b")
    assert (xyz(found.pose.position), found.header.stamp.sec) == ((0, -2, -3), 2)
    uncertain = stamped(ros.msg.PoseWithCovarianceStamped)
    uncertain.pose.pose, uncertain.pose.covariance = pose.pose, COVARIANCE
    found = buffer.transform(uncertain, "b")
    assert xyz(found.pose.pose.position) == (0, -2, -3)
    assert list(found.pose.covariance) == TURNED_COVARIANCE


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [((0.0, 0.0, 0.0, 1.0), (1, 0, 0)), ((0.0, 1.0, 0.0, 0.0), (-1, 0, 0))],
)
def test_vector_is_rotated_and_not_moved(ros, rotation, expected):
    transform = transform_of(ros, 1.0, 2.0, 3.0, rotation)
    vector = stamped(ros.msg.Vector3Stamped)
    fill(vector.vector, 1.0, 0.0, 0.0)
    assert xyz(ros.tf2.do_transform_vector3(vector, transform).vector) == pytest.approx(expected)
    assert xyz(transform.transform.translation) == (1, 2, 3)
    wrench = stamped(ros.msg.WrenchStamped)
    fill(wrench.wrench.force, 1.0, 0.0, 0.0)
    fill(wrench.wrench.torque, 2.0, 0.0, 0.0)
    found = ros.tf2.do_transform_wrench(wrench, transform).wrench
    assert xyz(found.force) == pytest.approx(expected)
    assert xyz(found.torque) == pytest.approx([2 * each for each in expected])


def test_pose_with_covariance_has_the_documented_numbers(ros):
    transform = transform_of(ros, 1.0, 2.0, 3.0, (1.0, 0.0, 0.0, 0.0))
    pose = stamped(ros.msg.PoseWithCovarianceStamped)
    fill(pose.pose.pose.position, 1.0, 2.0, 3.0)
    pose.pose.pose.orientation = ros.msg.Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)
    pose.pose.covariance = COVARIANCE
    found = ros.tf2.do_transform_pose_with_covariance_stamped(pose, transform).pose
    turned = found.pose.orientation
    assert xyz(found.pose.position) == (2, 0, 0)
    assert (*xyz(turned), turned.w) == (0, 0, 0, 1)
    assert list(found.covariance) == TURNED_COVARIANCE
    assert list(ros.tf2.transform_covariance(COVARIANCE, transform)) == TURNED_COVARIANCE


def test_four_zeros_rotate_nothing(ros):
    transform = transform_of(ros, 1.0, 2.0, 3.0, (0.0, 0.0, 0.0, 0.0))
    pose = ros.msg.Pose()
    fill(pose.position, 1.0, 1.0, 1.0)
    found = ros.tf2.do_transform_pose(pose, transform)
    assert (xyz(found.position), found.orientation.w) == ((2, 3, 4), 1)


def test_result_shares_nothing_with_the_transform(ros):
    transform = transform_of(ros, 1.0, 2.0, 3.0, (0.0, 0.0, 0.0, 1.0))
    found = ros.tf2.do_transform_point(ros.msg.PointStamped(), transform)
    found.header.frame_id = "changed"
    assert transform.header.frame_id == "a"


def test_messages_are_their_own_conversion(ros):
    registration = ros.tf2_ros.ConvertRegistration()
    pose = ros.msg.PoseStamped()
    for get in (registration.get_to_msg, registration.get_from_msg):
        assert get(ros.msg.PoseStamped)(pose) is pose
    assert ros.tf2.to_msg_msg(pose) is ros.tf2.from_msg_msg(pose) is pose
