"""turtle_teleop_key."""

import os
import sys

import pytest

if sys.platform == "win32":
    pytest.skip("these terminals are POSIX's", allow_module_level=True)

import pty

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]


def test_keys_move_turn_and_stop_the_turtle(turtlesim):
    node = turtlesim.node()
    ours, theirs = pty.openpty()
    teleop, _ = turtlesim.run("turtle_teleop_key", stdin=theirs)
    teleop.wait_for("'q' to quit.")
    assert teleop.out == (
        "Reading from keyboard\n---------------------------\n"
        "Use arrow keys to move the turtle.\n"
        "Use g|b|v|c|d|e|r|t keys to rotate to absolute orientations. 'f' to cancel a rotation.\n"
        "'q' to quit.\n"
    )
    os.write(ours, b"t")
    node.wait_for("Rotation goal completed successfully")
    os.write(ours, b"d")
    pose = turtlesim.command(
        "topic", "echo", "--once", "--field", "angular_velocity", "/turtle1/pose"
    )
    assert pose.startswith(("0.0", "1.0"))
    os.write(ours, b"f")
    node.wait_for("Rotation goal canceled")
    os.write(ours, b"\x1b[A")
    program = turtlesim.script(
        "import rclpy\nfrom rclpy.node import Node\nfrom turtlesim.msg import Pose\n"
        "rclpy.init()\nnode = Node('watching')\nspeeds = []\n"
        "node.create_subscription(Pose, '/turtle1/pose',"
        " lambda pose: speeds.append(pose.linear_velocity), 10)\n"
        "print('ready', flush=True)\n"
        "while 2.0 not in speeds:\n    rclpy.spin_once(node)\n"
    )
    program.wait_for("ready")
    os.write(ours, b"\x1b[A")
    assert program.end() == 0
    os.write(ours, b"q")
    assert teleop.end() == 0
    assert teleop.err == ""
    os.close(ours)
    os.close(theirs)


def test_ctrl_c_ends_teleop_without_a_traceback(turtlesim):
    ours, theirs = pty.openpty()
    teleop, _ = turtlesim.run("turtle_teleop_key", stdin=theirs)
    teleop.wait_for("'q' to quit.")
    assert teleop.interrupt() == 0
    assert teleop.err == ""
    os.close(ours)
    os.close(theirs)
