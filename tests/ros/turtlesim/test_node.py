"""The node turtlesim, as programs and commands see it."""

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

SPAWN, TELEPORT = "turtlesim/srv/Spawn", "turtlesim/srv/TeleportAbsolute"


def test_turtles_are_added_and_removed_with_the_log_lines_of_ros(turtlesim):
    node = turtlesim.node()
    call, command = ("service", "call"), turtlesim.command
    out = command(*call, "/spawn", SPAWN, "{x: 2, y: 2, theta: 0.2, name: ''}")
    assert "turtlesim.srv.Spawn_Response(name='turtle2')" in out
    command(*call, "/spawn", SPAWN, "{x: 2, y: 2, name: turtle2}")
    command(*call, "/kill", "turtlesim/srv/Kill", "{name: turtle2}")
    command(*call, "/kill", "turtlesim/srv/Kill", "{name: turtle2}")
    assert "/turtle2/pose" not in command("topic", "list")
    command(*call, "/turtle1/teleport_absolute", TELEPORT, "{x: 12, y: 2}")
    node.wait_for("hit the wall")
    command(*call, "/clear", "std_srvs/srv/Empty")
    command(*call, "/reset", "std_srvs/srv/Empty")
    pose = command("topic", "echo", "--once", "/turtle1/pose")
    assert pose == (
        "x: 5.544444561004639\ny: 5.544444561004639\ntheta: 0.0\n"
        "linear_velocity: 0.0\nangular_velocity: 0.0\n---\n"
    )
    assert command("topic", "echo", "--once", "/turtle1/color_sensor").startswith("r: 255\n")
    assert node.interrupt() == 0
    assert node.err.splitlines() == [
        "[INFO] [T] [turtlesim]: Starting turtlesim with node name /turtlesim",
        "[INFO] [T] [turtlesim]: "
        "Spawning turtle [turtle1] at x=[5.544445], y=[5.544445], theta=[0.000000]",
        "[INFO] [T] [turtlesim]: "
        "Spawning turtle [turtle2] at x=[2.000000], y=[2.000000], theta=[0.200000]",
        "[ERROR] [T] [turtlesim]: A turtle named [turtle2] already exists",
        "[ERROR] [T] [turtlesim]: Tried to kill turtle [turtle2], which does not exist",
        "[WARN] [T] [turtlesim]: Oh no! I hit the wall! (Clamping from [x=12.000000, y=9.088889])",
        "[INFO] [T] [turtlesim]: Clearing turtlesim.",
        "[INFO] [T] [turtlesim]: Resetting turtlesim.",
        "[INFO] [T] [turtlesim]: "
        "Spawning turtle [turtle1] at x=[5.544445], y=[5.544445], theta=[0.000000]",
    ]


def test_names_and_namespaces_can_be_remapped(turtlesim):
    node = turtlesim.node("--ros-args", "-r", "__node:=my_turtle", "-r", "__ns:=/sim")
    node.wait_for("Starting turtlesim with node name /sim/my_turtle")
    assert "/sim/turtle1/cmd_vel" in turtlesim.command("topic", "list")
    assert "/sim/spawn" in turtlesim.command("service", "list")


def test_parameters_have_the_names_ranges_and_values_of_ros(turtlesim):
    turtlesim.node()
    listed = turtlesim.command("param", "list", "/turtlesim").split()
    assert listed[:3] == ["background_b", "background_g", "background_r"]
    assert "holonomic" in listed
    assert turtlesim.command("param", "get", "/turtlesim", "background_g") == (
        "Integer value is: 86\n"
    )
    assert turtlesim.command("param", "set", "/turtlesim", "background_r", "150") == (
        "Set parameter successful\n"
    )
    described = turtlesim.command("param", "describe", "/turtlesim", "background_r")
    assert "Red channel of the background color" in described
    assert "Max value: 255" in described


ROTATIONS = """
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from turtlesim.action import RotateAbsolute

rclpy.init()
node = Node("asking")
client = ActionClient(node, RotateAbsolute, "/turtle1/rotate_absolute")
client.wait_for_server()

def done(future):
    rclpy.spin_until_future_complete(node, future)
    return future.result()

def sent(theta, **settings):
    return done(client.send_goal_async(RotateAbsolute.Goal(theta=theta), **settings))

lefts = []
keep = lambda message: lefts.append(message.feedback.remaining)
result = done(sent(0.5, feedback_callback=keep).get_result_async())
print(result.status, round(result.result.delta, 1), len(lefts) > 5, lefts[0] > lefts[-1])
first = sent(3.0)
second = sent(-1.0)
print(done(first.get_result_async()).status)
done(second.cancel_goal_async())
print(done(second.get_result_async()).status)
"""


def test_rotations_succeed_and_are_aborted_and_cancelled(turtlesim):
    node = turtlesim.node()
    program = turtlesim.script(ROTATIONS)
    assert program.end() == 0, program.err
    assert program.out.splitlines() == ["4 -0.5 True True", "6", "5"]
    assert node.interrupt() == 0
    assert [line.partition("]: ")[2] for line in node.err.splitlines()[2:]] == [
        "Rotation goal completed successfully",
        "Rotation goal received before a previous goal finished. Aborting previous goal",
        "Rotation goal canceled",
    ]


LOST = """
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from std_srvs.srv import Empty
from turtlesim.action import RotateAbsolute

rclpy.init()
node = Node("asking")
client = ActionClient(node, RotateAbsolute, "/turtle1/rotate_absolute")
reset = node.create_client(Empty, "/reset")
client.wait_for_server()
reset.wait_for_service()
for _ in range(2):
    sending = client.send_goal_async(RotateAbsolute.Goal(theta=3.0))
    rclpy.spin_until_future_complete(node, sending)
    rclpy.spin_until_future_complete(node, reset.call_async(Empty.Request()))
    client.wait_for_server()
"""


def test_a_reset_during_a_rotation_leaves_the_node_running(turtlesim):
    node = turtlesim.node()
    program = turtlesim.script(LOST)
    assert program.end() == 0, program.err
    call = ("service", "call", "/spawn", SPAWN)
    assert "name='turtle2'" in turtlesim.command(*call, "{x: 2, y: 2}")
    assert node.interrupt() == 0
    assert "Traceback" not in node.err
    assert node.err.count("Resetting turtlesim.") == 2


def test_a_name_that_topics_cannot_have_is_an_error_in_the_log(turtlesim):
    node = turtlesim.node()
    call = ("service", "call", "/spawn", SPAWN)
    assert "name=''" in turtlesim.command(*call, "{x: 2, y: 2, name: my turtle}")
    node.wait_for("A turtle cannot be named [my turtle]: ")
    long = "x" * 250  # longer than a topic's name may be
    assert "name=''" in turtlesim.command(*call, f"{{x: 2, y: 2, name: {long}}}")
    node.wait_for(f"A turtle cannot be named [{long}]: ")
    assert "name='turtle2'" in turtlesim.command(*call, "{x: 2, y: 2}")
    assert node.interrupt() == 0


def test_a_view_that_does_not_work_is_one_line(turtlesim):
    node, _ = turtlesim.run("turtlesim_node", "--view", "terminal")
    assert node.end() == 1
    assert node.err.startswith("turtlesim_node: cannot draw: expected a terminal as the output")
    assert "Traceback" not in node.err
