"""The steps of the ROS tutorials on tf2, as own programs: each prints what it prints on ROS 2."""

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

STATIC_BROADCASTER = """
import sys

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf_transformations import quaternion_from_euler


class FrameSender(Node):
    def __init__(self, words):
        super().__init__("frame_sender")
        message = TransformStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "world"
        message.child_frame_id = words[0]
        x, y, z, *angles = map(float, words[1:])
        translation = message.transform.translation
        translation.x, translation.y, translation.z = x, y, z
        rotation = message.transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = quaternion_from_euler(*angles)
        self.broadcaster = StaticTransformBroadcaster(self)
        self.broadcaster.sendTransform(message)
        self.get_logger().info("sent")


rclpy.init()
try:
    rclpy.spin(FrameSender(sys.argv[1:]))
except KeyboardInterrupt:
    pass
rclpy.shutdown()
"""

ECHO = "from tf2_ros.tf2_echo import main\nmain()\n"
MONITOR = """
from tf2_ros import tf2_monitor

tf2_monitor._REPORTS_EVERY = 1  # half a second instead of ten
tf2_monitor.main()
"""

BROADCASTER = """
import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import TransformBroadcaster
from turtlesim.msg import Pose


class FrameSender(Node):
    def __init__(self):
        super().__init__("frame_sender")
        self.turtle = self.declare_parameter("turtlename", "turtle").value
        self.broadcaster = TransformBroadcaster(self)
        self.create_subscription(Pose, f"/{self.turtle}/pose", self.on_pose, 1)

    def on_pose(self, pose):
        message = TransformStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "world"
        message.child_frame_id = self.turtle
        message.transform.translation.x = pose.x
        message.transform.translation.y = pose.y
        message.transform.rotation.z = math.sin(pose.theta / 2)
        message.transform.rotation.w = math.cos(pose.theta / 2)
        self.broadcaster.sendTransform(message)


rclpy.init()
rclpy.spin(FrameSender())
"""

LISTENER = """
import math

import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import TransformException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class Follower(Node):
    def __init__(self):
        super().__init__("follower")
        self.target = self.declare_parameter("target_frame", "turtle1").value
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(Twist, "turtle2/cmd_vel", 1)
        self.create_timer(0.05, self.follow)
        self.follow()  # nothing has arrived yet

    def follow(self):
        try:
            found = self.buffer.lookup_transform("turtle2", self.target, Time())
        except TransformException as error:
            self.get_logger().info(f"no transform yet: {error}", once=True)
            return
        x, y = found.transform.translation.x, found.transform.translation.y
        command = Twist()
        command.angular.z = math.atan2(y, x)
        command.linear.x = 0.5 * math.hypot(x, y)
        self.publisher.publish(command)


rclpy.init()
rclpy.spin(Follower())
"""

TURTLES = """
import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from turtlesim.msg import Pose


class Turtles(Node):
    def __init__(self):
        super().__init__("turtles")
        self.poses = {
            self.create_publisher(Pose, f"/turtle{number}/pose", 1): pose
            for number, pose in ((1, Pose(x=5.0, y=9.0)), (2, Pose(x=5.0, y=5.0)))
        }
        self.create_subscription(Twist, "/turtle2/cmd_vel", self.on_command, 1)
        self.create_timer(0.05, self.send)

    def send(self):
        for publisher, pose in self.poses.items():
            publisher.publish(pose)

    def on_command(self, command):
        print(f"forward {command.linear.x:.3f}, left {command.angular.z:.3f}")
        raise SystemExit


rclpy.init()
rclpy.spin(Turtles())
"""

TIME_TRAVEL = """
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import (
    Buffer,
    ExtrapolationException,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
)


def transform(parent, child, seconds, x):
    message = TransformStamped(child_frame_id=child)
    message.header.stamp = Time(seconds=seconds).to_msg()
    message.header.frame_id = parent
    message.transform.translation.x = x
    return message


def told(found):
    return f"{found.header.stamp.sec} s: {found.transform.translation.x:.1f} m"


with rclpy.init():
    node = Node("traveller")
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, None, spin_thread=True)
    moving = TransformBroadcaster(node)
    carrot = StaticTransformBroadcaster(node)
    carrot.sendTransform(transform("turtle1", "carrot1", 0, 2.0))
    while not moving.pub_tf.get_subscription_count():
        time.sleep(0.01)
    for now in range(100, 106):
        turtles = [transform("world", "turtle1", now, now - 90.0)]
        moving.sendTransform([*turtles, transform("world", "turtle2", now, 0.0)])
    wait = Duration(seconds=60)
    last, past = Time(seconds=105), Time(seconds=100)
    print(told(buffer.lookup_transform("turtle2", "carrot1", last, wait)))
    print(told(buffer.lookup_transform("turtle2", "carrot1", Time(seconds=102.5))))
    print(told(buffer.lookup_transform_full("turtle2", last, "turtle1", past, "world", wait)))
    try:
        buffer.lookup_transform("turtle2", "turtle1", Time(seconds=106), Duration(seconds=0.05))
    except ExtrapolationException as error:
        print(error)

    async def look():
        print(told(await buffer.lookup_transform_async("turtle2", "turtle1", Time(seconds=106))))

    executor = rclpy.get_global_executor()
    executor.add_node(node)
    task = executor.create_task(look)
    executor.spin_once(timeout_sec=0.01)
    moving.sendTransform(
        [transform("world", "turtle1", 106, 50.0), transform("world", "turtle2", 106, 0.0)]
    )
    executor.spin_until_future_complete(task)
"""

BUFFER_CLIENT = """
import threading

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, BufferClient, LookupException
from tf2_ros.buffer_server import BufferServer


def spin():
    try:
        executor.spin()
    except ExternalShutdownException:
        pass


with rclpy.init():
    buffer = Buffer()
    shelf = TransformStamped(child_frame_id="shelf")
    shelf.header.frame_id = "world"
    shelf.transform.translation.x = 4.0
    buffer.set_transform_static(shelf, "me")
    node = Node("buffers")
    server = BufferServer(buffer, node, "tf2_buffer_server")
    client = BufferClient(node, "tf2_buffer_server")
    executor = MultiThreadedExecutor(2)
    executor.add_node(node)
    thread = threading.Thread(target=spin)
    thread.start()
    assert client.action_client.wait_for_server(60)
    print(client.lookup_transform("world", "shelf", Time()).transform.translation.x)
    try:
        client.lookup_transform("world", "box", Time())
    except LookupException as error:
        print(error)
thread.join()
"""


def test_echo_and_monitor_find_a_static_transform_that_was_sent_before(ros):
    sender = ros(STATIC_BROADCASTER, "shelf", 0, 0, 1, 0, 0, 0.5, name="sender.py")
    sender.wait_for("sent")
    echo = ros(ECHO, "world", "shelf", 20, name="echo.py")
    monitor = ros(MONITOR, "world", "shelf", name="monitor.py")
    echo.wait_for("At time", times=2)
    assert echo.interrupt() == 0
    assert "- Translation: [0.000, 0.000, 1.000]\n" in echo.out
    assert "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.247, 0.969]\n" in echo.out
    assert "- Rotation: in RPY (radian) [0.000, -0.000, 0.500]\n" in echo.out
    assert "[tf2_echo]: Waiting for transform world ->  shelf: Invalid frame ID" in echo.err
    monitor.wait_for("Node: <no authority available>")
    assert monitor.interrupt() == 0
    assert "Gathering data on world -> shelf for 10 seconds...\n" in monitor.out
    assert "\n\n\nRESULTS: for world to shelf\nChain is: world -> shelf\nNet" in monitor.out
    assert "\nFrame: shelf, published by <no authority available>, Average" in monitor.out
    assert sender.interrupt() == 0


def test_listener_follows_a_turtle_that_two_broadcasters_describe(ros):
    turtles = ros(TURTLES, name="turtles.py")
    for number in (1, 2):
        parameter = f"turtlename:=turtle{number}"
        ros(BROADCASTER, "--ros-args", "-p", parameter, name=f"broadcaster{number}.py")
    listener = ros(LISTENER, name="listener.py")
    assert turtles.end() == 0
    assert turtles.out == "forward 2.000, left 1.571\n"
    listener.wait_for("[follower]: no transform yet: ")


def test_lookups_reach_other_times_and_wait(run):
    code, out, err = run(TIME_TRAVEL)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "105 s: 17.0 m",
        "102 s: 14.5 m",
        "105 s: 10.0 m",
        "Lookup would require extrapolation into the future.  Requested time 106.000000 but the"
        " latest data is at time 105.000000, when looking up transform from frame [turtle1] to"
        " frame [turtle2]",
        "106 s: 50.0 m",
    ]


def test_buffer_client_asks_the_action_of_a_server(run):
    said = '"box" passed to lookupTransform argument source_frame does not exist. '
    assert run(BUFFER_CLIENT) == (0, f"4.0\n{said}\n", "")
