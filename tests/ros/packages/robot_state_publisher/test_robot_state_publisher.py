"""The two nodes together publish the frames of a robot, and say what is wrong in one line."""

import importlib
import subprocess
import sys
from types import SimpleNamespace

import pytest

from tests.ros.packages.rclpy.living import PATIENCE

pytestmark = pytest.mark.real_time

ROBOT = """
<robot name="arm">
  <link name="base"/><link name="arm"/><link name="finger"/><link name="laser"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="arm"/>
    <origin xyz="0.5 0 0.2" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="arm"/><child link="finger"/><origin xyz="0.3 0 0"/>
    <limit lower="0.02" upper="0.04" effort="1" velocity="1"/>
  </joint>
  <joint name="screw" type="fixed">
    <parent link="base"/><child link="laser"/><origin xyz="0.1 0 0.3"/>
  </joint>
</robot>
"""


@pytest.fixture
def ros(ros_names, tmp_path, monkeypatch):
    """rclpy in a network of its own, and the modules of the nodes."""
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    load = importlib.import_module
    rclpy = load("rclpy")
    yield SimpleNamespace(
        rclpy=rclpy,
        tf2_ros=load("tf2_ros"),
        Parameter=load("rclpy.parameter").Parameter,
        robot=load("robot_state_publisher.robot_state_publisher"),
        joints=load("joint_state_publisher.joint_state_publisher"),
    )
    rclpy.try_shutdown()


def spin_until(ros, nodes, condition):
    executor = ros.rclpy.executors.SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    clock = nodes[0].get_clock()
    end = clock.now().nanoseconds + PATIENCE * 10**9
    while not condition():
        assert clock.now().nanoseconds < end, "it does not happen"
        executor.spin_once(timeout_sec=0.1)


def test_the_frames_of_the_robot_are_published(ros):
    ros.rclpy.init(args=["--ros-args", "-p", "rate:=50", "-p", "zeros.shoulder:=0.5"])
    listener = ros.rclpy.create_node("listener")
    buffer = ros.tf2_ros.Buffer()
    ros.tf2_ros.TransformListener(buffer, listener)
    publisher = ros.robot.RobotStatePublisher(ROBOT)
    joints = ros.joints.JointStatePublisher()
    time = ros.rclpy.time.Time()

    def is_known():
        wanted = [("base", "finger"), ("laser", "base")]
        return all(buffer.can_transform(*pair, time) for pair in wanted)

    spin_until(ros, [listener, publisher, joints], is_known)
    found = buffer.lookup_transform("base", "finger", time).transform
    # The arm points to 90 degrees and 0.5 radians; the finger is in the middle, at 0.3 + 0.03 m.
    moved, turned = found.translation, found.rotation
    assert (moved.x, moved.y, moved.z) == pytest.approx((0.3417895723, 0.2896022454, 0.2))
    assert (turned.z, turned.w) == pytest.approx((0.8600655610, 0.5101835265))
    static = buffer.lookup_transform("laser", "base", time).transform.translation
    assert (static.x, static.z) == pytest.approx((-0.1, -0.3))


def test_parameters_are_checked_and_used_while_the_node_runs(ros):
    ros.rclpy.init(args=["--ros-args", "-p", "frame_prefix:=one/"])
    publisher = ros.robot.RobotStatePublisher(ROBOT)
    listener = ros.rclpy.create_node("listener")
    seen = []
    latched = ros.rclpy.qos.QoSProfile(
        depth=10, durability=ros.rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL
    )
    load = importlib.import_module
    messages, texts = load("tf2_msgs.msg"), load("std_msgs.msg")
    listener.create_subscription(messages.TFMessage, "/tf_static", seen.append, latched)
    descriptions = []
    listener.create_subscription(texts.String, "robot_description", descriptions.append, latched)
    spin_until(ros, [listener, publisher], lambda: seen and descriptions)
    [laser] = seen[-1].transforms
    assert (laser.header.frame_id, laser.child_frame_id) == ("one/base", "one/laser")
    assert descriptions[-1].data == ROBOT

    def set_parameter(name, value):
        return publisher.set_parameters([ros.Parameter(name, value=value)])[0]

    assert set_parameter("robot_description", "").reason == "Empty URDF is not allowed"
    assert set_parameter("robot_description", "<robot>").reason.startswith("line 1: invalid XML")
    assert not set_parameter("publish_frequency", 0.0).successful
    other = ROBOT.replace("laser", "camera")
    assert set_parameter("robot_description", other).successful
    spin_until(ros, [listener, publisher], lambda: descriptions[-1].data == other)
    names = {each.child_frame_id for message in seen for each in message.transforms}
    spin_until(
        ros,
        [listener, publisher],
        lambda: "one/camera" in {each.child_frame_id for each in seen[-1].transforms},
    )
    assert "one/laser" in names


@pytest.mark.end_to_end
@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([], "cannot start: robot_description parameter must not be empty"),
        (["gone.urdf"], "cannot read the URDF file gone.urdf: No such file"),
        (["bad.urdf"], "cannot start: line 1: invalid XML: syntax error"),
        (
            ["good.urdf", "--ros-args", "-p", "publish_frequency:=0.0"],
            "cannot start: publish_frequency must be between 0 (exclusive) and 1000, got 0",
        ),
        (
            ["good.urdf", "--ros-args", "-p", "publish_frequency:=5"],
            "Trying to set parameter 'publish_frequency' to '5' of type 'INTEGER'",
        ),
    ],
)
def test_a_mistake_is_one_line(tmp_path, arguments, problem):
    (tmp_path / "bad.urdf").write_text("robot")
    (tmp_path / "good.urdf").write_text(ROBOT)
    name = "robot_state_publisher"
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", name, name, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert done.returncode == 1
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1
