"""`taskrpc service echo` prints introspection events as `ros2 service echo` does."""

import os
import subprocess
import sys

import pytest

import srvgen
from taskrpc.cli.main import main
from taskrpc.cli.ros.service.echo import event_text
from taskrpc.ros.message_text import Cut, csv_of

PROGRAM = """
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState

def add(request, response):
    response.sum = request.a + request.b
    return response

rclpy.init()
node = rclpy.create_node("adder")
service = node.create_service(AddTwoInts, "add", add)
service.configure_introspection(
    node.get_clock(), qos_profile_system_default, ServiceIntrospectionState.CONTENTS
)
print("up", flush=True)
rclpy.spin(node)
"""


def _event(**fields):
    cls = srvgen.load("example_interfaces/srv/AddTwoInts")
    info = srvgen.load("service_msgs/msg/ServiceEventInfo")
    stamp = srvgen.load("builtin_interfaces/msg/Time")(sec=3344, nanosec=686279829)
    gid = [39, 207, 111, 243, 5, 208, 50, 30, 232, 34, 87, 206, 98, 49, 246, 127]
    event = cls.Event()
    kind = info.RESPONSE_SENT if "sum" in fields else info.REQUEST_RECEIVED
    event.info = info(event_type=kind, stamp=stamp, client_gid=gid, sequence_number=1)
    if "sum" in fields:
        event.response = [cls.Response(**fields)]
    else:
        event.request = [cls.Request(**fields)]
    return event


GID = "39, 207, 111, 243, 5, 208, 50, 30, 232, 34, 87, 206, 98, 49, 246, 127"


def test_an_event_is_yaml_with_the_name_of_its_step():
    gid = "".join(f"  - {each}\n" for each in GID.split(", "))
    assert event_text(_event(a=2, b=3), Cut()) == (
        "info:\n  event_type: REQUEST_RECEIVED\n  stamp:\n    sec: 3344\n    nanosec: 686279829\n"
        f"  client_gid:\n{gid}  sequence_number: 1\nrequest:\n- a: 2\n  b: 3\nresponse: []\n"
    )


def test_flow_style_writes_arrays_in_one_line():
    assert event_text(_event(sum=5), Cut(), flow=True) == (
        "info:\n  event_type: RESPONSE_SENT\n  stamp:\n    sec: 3344\n    nanosec: 686279829\n"
        f"  client_gid: [{GID}]\n  sequence_number: 1\nrequest: []\nresponse: [{{sum: 5}}]\n"
    )


def test_csv_equals_the_csv_of_ros2():
    gid = GID.replace(" ", "")
    assert csv_of(_event(a=2, b=3), Cut(texts=False)) == f"1,3344,686279829,{gid},1,2,3,"
    assert csv_of(_event(sum=5), Cut(texts=False)) == f"2,3344,686279829,{gid},1,,5"


def test_long_arrays_are_cut_and_no_arr_prints_type_and_length():
    cut = event_text(_event(a=1, b=2), Cut(length=2), flow=True)
    assert "client_gid: [39, 207, '...']" in cut
    none = event_text(_event(a=1, b=2), Cut(arrays=False))
    assert "client_gid: '<array type: " in none
    assert "response: '<sequence type: " in none


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    return folder


@pytest.fixture
def start(runtime, tmp_path):
    started = []

    def start(*arguments, command=("-m", "taskrpc")):
        process = subprocess.Popen(
            [sys.executable, *command, *arguments],
            cwd=tmp_path,
            env={**os.environ},
            stdout=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def wait_for_echo(service, capsys):
    for _ in range(100):
        capsys.readouterr()
        main(["topic", "info", f"{service}/_service_event"])
        if "Subscription count: 1" in capsys.readouterr().out:
            return
    pytest.fail("service echo does not subscribe")


@pytest.mark.real_time
def test_calls_of_a_task_server_with_introspection_are_echoed(start, capsys):
    told = ("--db", ":memory:", "--introspection", "contents")
    start(*told, command=("-m", "taskrpc.cli.robot.server.command_line"))
    call = ["service", "call", "/robot_task/pause", "taskrpc_interfaces/srv/PauseTasks"]
    assert main([*call, "--timeout", "60"]) == 0  # it waits until the server has started
    echo = start("service", "echo", "robot_task/pause", "--csv")
    wait_for_echo("/robot_task/pause", capsys)
    assert main(call) == 0
    assert echo.stdout.readline().startswith("1,")
    assert ",True," in echo.stdout.readline()


@pytest.mark.real_time
def test_calls_of_a_running_program_are_echoed(start, tmp_path, capsys):
    (tmp_path / "adder.py").write_text(PROGRAM)
    assert start("run", "adder.py").stdout.readline() == "up\n"
    echo = start("service", "echo", "add", "--csv")
    call = ["service", "call", "/add", "example_interfaces/srv/AddTwoInts", "{a: 2, b: 3}"]
    wait_for_echo("/add", capsys)
    assert main(call) == 0
    first, second = echo.stdout.readline(), echo.stdout.readline()
    assert first.startswith("1,")
    assert first.endswith(",2,3,\n")
    assert second.startswith("2,")
    assert second.endswith(",,5\n")


@pytest.mark.real_time
def test_failed_echo_prints_the_text_of_ros2(runtime, capsys):
    assert main(["service", "echo", "/nope"]) == 1
    assert capsys.readouterr().err.startswith("Cannot find type for '/nope'\n")
    for wrong in ("example_interfaces/srv/Nope", "std_msgs/msg/String"):
        assert main(["service", "echo", "/nope", wrong]) == 1
        assert capsys.readouterr().err.startswith(f"The service type '{wrong}' is invalid")
