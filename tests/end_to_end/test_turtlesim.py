"""The turtlesim chapters of ROS's tutorials, line by line: commands, and what they print."""

import subprocess

import pytest

from tests.ros.turtlesim.running import turtlesim_in

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

TWIST = "{linear: {x: 2.0, y: 0.0, z: 0.0}, angular: {x: 0.0, y: 0.0, z: 1.8}}"
PARAMETER_SERVICES = (
    ("describe_parameters", "rcl_interfaces/srv/DescribeParameters"),
    ("get_parameter_types", "rcl_interfaces/srv/GetParameterTypes"),
    ("get_parameters", "rcl_interfaces/srv/GetParameters"),
    ("get_type_description", "type_description_interfaces/srv/GetTypeDescription"),
    ("list_parameters", "rcl_interfaces/srv/ListParameters"),
    ("set_parameters", "rcl_interfaces/srv/SetParameters"),
    ("set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically"),
)
TURTLE_SERVICES = (
    ("/clear", "std_srvs/srv/Empty"),
    ("/kill", "turtlesim/srv/Kill"),
    ("/reset", "std_srvs/srv/Empty"),
    ("/spawn", "turtlesim/srv/Spawn"),
    ("/turtle1/set_pen", "turtlesim/srv/SetPen"),
    ("/turtle1/teleport_absolute", "turtlesim/srv/TeleportAbsolute"),
    ("/turtle1/teleport_relative", "turtlesim/srv/TeleportRelative"),
)


@pytest.fixture
def turtlesim(tmp_path, monkeypatch, capsys):
    with turtlesim_in(tmp_path, monkeypatch, capsys) as turtlesim:
        yield turtlesim


def test_understanding_nodes(turtlesim):
    turtlesim.node("--ros-args", "--remap", "__node:=my_turtle")
    teleop, _ = turtlesim.run("turtle_teleop_key", stdin=subprocess.PIPE)
    teleop.wait_for("'q' to quit.")
    assert turtlesim.command("node", "list") == "/my_turtle\n/teleop_turtle\n"
    services = [
        *TURTLE_SERVICES,
        *((f"/my_turtle/{name}", kind) for name, kind in PARAMETER_SERVICES),
    ]
    assert turtlesim.command("node", "info", "/my_turtle") == "\n".join(
        [
            "/my_turtle",
            "  Subscribers:",
            "    /parameter_events: rcl_interfaces/msg/ParameterEvent",
            "    /turtle1/cmd_vel: geometry_msgs/msg/Twist",
            "  Publishers:",
            "    /parameter_events: rcl_interfaces/msg/ParameterEvent",
            "    /rosout: rcl_interfaces/msg/Log",
            "    /turtle1/color_sensor: turtlesim/msg/Color",
            "    /turtle1/pose: turtlesim/msg/Pose",
            "  Service Servers:",
            *(f"    {name}: {kind}" for name, kind in sorted(services)),
            "  Service Clients:",
            "",
            "  Action Servers:",
            "    /turtle1/rotate_absolute: turtlesim/action/RotateAbsolute",
            "  Action Clients:",
            "",
            "",
        ]
    )


def test_launching_nodes(turtlesim):
    launch, _ = turtlesim.start("launch", "turtlesim", "multisim.launch.py")
    launch.wait_for("Spawning turtle [turtle1]", times=2)
    assert turtlesim.command("node", "list") == "/turtlesim1/turtlesim\n/turtlesim2/turtlesim\n"
    launch.interrupt()
    assert (launch.out + launch.err).count("process has finished cleanly") == 2


def test_understanding_topics(turtlesim):
    turtlesim.node()
    command = turtlesim.command
    assert command("topic", "list", "-t") == (
        "/parameter_events [rcl_interfaces/msg/ParameterEvent]\n"
        "/rosout [rcl_interfaces/msg/Log]\n"
        "/turtle1/cmd_vel [geometry_msgs/msg/Twist]\n"
        "/turtle1/color_sensor [turtlesim/msg/Color]\n"
        "/turtle1/pose [turtlesim/msg/Pose]\n"
    )
    echo, _ = turtlesim.start("topic", "echo", "/turtle1/cmd_vel")
    published = command(
        "topic", "pub", "--once", "-w", "2", "/turtle1/cmd_vel", "geometry_msgs/msg/Twist", TWIST
    )
    vectors = [
        f"geometry_msgs.msg.Vector3(x={x}, y=0.0, z={z})"
        for x, z in (("2.0", "0.0"), ("0.0", "1.8"))
    ]
    twist = "geometry_msgs.msg.Twist(linear={}, angular={})".format(*vectors)
    assert published.endswith(f"publisher: beginning loop\npublishing #1: {twist}\n\n")
    echo.wait_for("---")
    assert echo.out == (
        "linear:\n  x: 2.0\n  y: 0.0\n  z: 0.0\nangular:\n  x: 0.0\n  y: 0.0\n  z: 1.8\n---\n"
    )
    assert command("topic", "info", "/turtle1/cmd_vel") == (
        "Type: geometry_msgs/msg/Twist\nPublisher count: 0\nSubscription count: 2\n"
    )
    hertz, _ = turtlesim.start("topic", "hz", "/turtle1/pose")
    hertz.wait_for("average rate: ")
    assert command("topic", "find", "geometry_msgs/msg/Twist") == "/turtle1/cmd_vel\n"


def test_understanding_services(turtlesim):
    turtlesim.node()
    command = turtlesim.command
    services = [
        *TURTLE_SERVICES,
        *((f"/turtlesim/{name}", kind) for name, kind in PARAMETER_SERVICES),
    ]
    assert command("service", "list", "-t") == "".join(
        f"{name} [{kind}]\n" for name, kind in sorted(services)
    )
    assert command("service", "type", "/clear") == "std_srvs/srv/Empty\n"
    assert command("service", "info", "/clear") == (
        "Type: std_srvs/srv/Empty\nClients count: 0\nServices count: 1\n"
    )
    assert command("service", "find", "std_srvs/srv/Empty") == "/clear\n/reset\n"
    assert command("interface", "show", "std_srvs/srv/Empty") == "---\n"
    assert command("service", "call", "/clear", "std_srvs/srv/Empty") == (
        "requester: making request: std_srvs.srv.Empty_Request()\n\n"
        "response:\nstd_srvs.srv.Empty_Response()\n\n"
    )
    request = "{x: 2, y: 2, theta: 0.2, name: ''}"
    assert command("service", "call", "/spawn", "turtlesim/srv/Spawn", request) == (
        "requester: making request: "
        "turtlesim.srv.Spawn_Request(x=2.0, y=2.0, theta=0.2, name='')\n\n"
        "response:\nturtlesim.srv.Spawn_Response(name='turtle2')\n\n"
    )


def test_understanding_parameters(turtlesim, tmp_path):
    node, command = turtlesim.node(), turtlesim.command
    assert command("param", "get", "/turtlesim", "background_g") == "Integer value is: 86\n"
    command("param", "set", "/turtlesim", "background_r", "150")
    dump = command("param", "dump", "/turtlesim")
    (tmp_path / "turtlesim.yaml").write_text(dump)
    assert "    background_b: 255\n    background_g: 86\n    background_r: 150\n" in dump
    command("param", "set", "/turtlesim", "background_r", "0")
    loaded = command("param", "load", "/turtlesim", "turtlesim.yaml")
    assert "Set parameter background_r successful\n" in loaded
    assert node.interrupt() == 0
    turtlesim.node("--ros-args", "--params-file", "turtlesim.yaml")
    assert command("param", "get", "/turtlesim", "background_r") == "Integer value is: 150\n"


def test_understanding_actions(turtlesim):
    node = turtlesim.node()
    command, name = turtlesim.command, "/turtle1/rotate_absolute"
    assert command("action", "list", "-t") == f"{name} [turtlesim/action/RotateAbsolute]\n"
    assert command("action", "type", name) == "turtlesim/action/RotateAbsolute\n"
    assert command("action", "info", name) == (
        f"Action: {name}\nAction clients: 0\nAction servers: 1\n    /turtlesim\n"
    )
    goal = (name, "turtlesim/action/RotateAbsolute", "{theta: 0.25}")
    sent = command("action", "send_goal", *goal, "--feedback").splitlines()
    assert sent[:2] == ["Waiting for an action server to become available...", "Sending goal:"]
    assert sent[2].strip() == "theta: 0.25"
    assert sent[4].startswith("Goal accepted with ID: ")
    feedback = [float(line.split()[1]) for line in sent if line.startswith("    remaining: ")]
    assert feedback == sorted(feedback, reverse=True)
    assert len(feedback) > 5
    assert sent[-1] == "Goal finished with status: SUCCEEDED"
    delta = float(sent[sent.index("Result:") + 1].partition("delta: ")[2])
    assert delta == pytest.approx(-0.25, abs=0.03)
    node.wait_for("Rotation goal completed successfully")


def test_recording_and_playing_back_data(turtlesim):
    turtlesim.node()
    command, echo = turtlesim.command, ("topic", "echo", "--once", "/turtle1/pose")
    start = command(*echo)
    record, _ = turtlesim.start("bag", "record", "-o", "subset", "/turtle1/cmd_vel")
    record.wait_for("recording to subset")
    publish = ("topic", "pub", "--once", "-w", "2", "/turtle1/cmd_vel", "geometry_msgs/msg/Twist")
    command(*publish, TWIST)
    record.wait_for("recording /turtle1/cmd_vel")
    assert record.interrupt() == 0
    about = command("bag", "info", "subset")
    assert "Topic: /turtle1/cmd_vel | Type: geometry_msgs/msg/Twist | Count: 1 |" in about
    command("service", "call", "/reset", "std_srvs/srv/Empty")
    assert command(*echo) == start
    command("bag", "play", "subset")
    assert command(*echo) != start
