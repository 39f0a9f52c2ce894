"""mimic."""

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]


def test_a_second_turtle_does_what_the_first_does(turtlesim):
    turtlesim.node("--ros-args", "-r", "__ns:=/sim1")
    turtlesim.node("--ros-args", "-r", "__ns:=/sim2")
    remaps = ("/input/pose:=/sim1/turtle1/pose", "/output/cmd_vel:=/sim2/turtle1/cmd_vel")
    arguments = [part for remap in remaps for part in ("-r", remap)]
    turtlesim.run("mimic", "--ros-args", *arguments)
    program = turtlesim.script(
        "import rclpy\nfrom rclpy.node import Node\nfrom geometry_msgs.msg import Twist\n"
        "from turtlesim.msg import Pose\n"
        "rclpy.init()\nnode = Node('watching')\nspeeds = []\n"
        "commands = node.create_publisher(Twist, '/sim1/turtle1/cmd_vel', 10)\n"
        "twist = Twist()\ntwist.linear.x = 2.0\n"
        "node.create_timer(0.1, lambda: commands.publish(twist))\n"
        "node.create_subscription(Pose, '/sim2/turtle1/pose',"
        " lambda pose: speeds.append(pose.linear_velocity), 10)\n"
        "while 2.0 not in speeds:\n    rclpy.spin_once(node)\n"
    )
    assert program.end() == 0
