"""The node joint_state_publisher: its parameters, its sources, and mistakes in one line."""

import importlib
import subprocess
import sys

import pytest

from tests.ros.packages.rclpy.living import PATIENCE

pytestmark = pytest.mark.real_time

NAME = "joint_state_publisher"
ROBOT = """
<robot name="r">
  <link name="base"/><link name="a"/><link name="b"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="a"/></joint>
  <joint name="twin" type="continuous"><parent link="base"/><child link="b"/></joint>
</robot>
"""
ARGUMENTS = (
    "--ros-args -p zeros.turn:=0.5 -p dependent_joints.twin.parent:=turn"
    " -p dependent_joints.twin.factor:=-2.0 -p rate:=100 -p source_list:=[sensed]"
)


def test_the_positions_follow_parameters_sources_and_new_descriptions(
    ros_names, tmp_path, monkeypatch
):
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    rclpy = importlib.import_module("rclpy")
    state = importlib.import_module("sensor_msgs.msg").JointState
    made = importlib.import_module("joint_state_publisher.joint_state_publisher")
    with rclpy.init(args=ARGUMENTS.split()):
        node, other = made.JointStatePublisher(ROBOT), rclpy.create_node("other")
        seen = []
        other.create_subscription(state, "joint_states", seen.append, 10)
        sensor = other.create_publisher(state, "sensed", 10)
        executor = rclpy.executors.SingleThreadedExecutor()
        for each in (node, other):
            executor.add_node(each)

        def spin_until(condition, do=lambda: None):
            end = node.get_clock().now().nanoseconds + PATIENCE * 10**9
            while not condition():
                assert node.get_clock().now().nanoseconds < end, "it does not happen"
                do()
                executor.spin_once(timeout_sec=0.1)

        spin_until(lambda: seen)
        assert list(seen[0].name) == ["turn", "twin"]
        assert list(seen[0].position) == [0.5, -1.0]
        message = state(name=["turn"], position=[0.25])
        spin_until(lambda: list(seen[-1].position) == [0.25, -0.5], lambda: sensor.publish(message))
        node._configure("<robot>")  # is ignored
        assert list(node._joints.states().names) == ["turn", "twin"]


def test_without_a_file_the_description_comes_from_its_topic(ros_names, tmp_path, monkeypatch):
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    rclpy = importlib.import_module("rclpy")
    string = importlib.import_module("std_msgs.msg").String
    made = importlib.import_module("joint_state_publisher.joint_state_publisher")
    with rclpy.init():
        node = made.JointStatePublisher()
        publisher = node.create_publisher(
            string,
            "robot_description",
            rclpy.qos.QoSProfile(depth=1, durability=rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL),
        )
        publisher.publish(string(data=ROBOT))
        end = node.get_clock().now().nanoseconds + PATIENCE * 10**9
        while node._joints is None:
            assert node.get_clock().now().nanoseconds < end, "no description arrives"
            rclpy.spin_once(node, timeout_sec=0.1)


@pytest.mark.end_to_end
@pytest.mark.parametrize(
    ("argument", "problem"),
    [
        ("dependent_joints.a.factor:=2.0", "must at least have a parent; 'a' has none"),
        ("dependent_joints.a.b:=2.0", "Invalid dependent_joint name 'a.b': expected JOINT.KEY"),
        ("rate:=0", "expected a rate above 0, up to 1000, got 0"),
    ],
)
def test_a_mistake_is_one_line(argument, problem):
    run = [sys.executable, "-m", "taskrpc", "run", NAME, NAME, "--ros-args", "-p", argument]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode == 1
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1
