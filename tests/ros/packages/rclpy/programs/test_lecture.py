"""The programs on the slides of the lecture run unchanged, and print the same as on ROS 2."""

import pytest

from tests.ros.packages.rclpy.programs.lecture import listing, program_of
from tests.ros.packages.rclpy.programs.running import INTERRUPTED

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]


def test_a_client_gets_its_sum_from_the_server(ros, run):
    server = ros(listing("add_two_ints_server.py"), name="add_two_ints_server.py")
    server.wait_for("is ready")
    code, out, err = run(listing("add_two_ints_client.py"), 2, 3, name="add_two_ints_client.py")
    assert (code, out) == (0, "")
    assert err == (
        "[INFO] [T] [add_two_ints_client]: Connected to service\n"
        "[INFO] [T] [add_two_ints_client]: Result: 2 + 3 = 5\n"
    )
    assert server.interrupt() == 0
    assert server.out == ""
    assert server.err == (
        "[INFO] [T] [add_two_ints_server]: Add Two Ints Server is ready\n"
        "[INFO] [T] [add_two_ints_server]: Incoming request: 2 + 3 = 5\n"
    )


def test_a_client_waits_for_its_server(ros):
    client = ros(listing("add_two_ints_client.py"), 40, 2, name="add_two_ints_client.py")
    client.wait_for("Service not available, waiting...")
    ros(listing("add_two_ints_server.py"), name="add_two_ints_server.py")
    assert client.end() == 0
    assert client.err.endswith("[add_two_ints_client]: Result: 40 + 2 = 42\n")


def test_client_without_arguments_prints_its_usage(run):
    assert run(listing("add_two_ints_client.py"))[:2] == (0, "Usage: ros2 run pkg client  \n")


def test_the_task_server_runs_four_tasks_by_priority(ros):
    server = ros(listing("task_server.py"), name="task_server.py")
    server.wait_for("Task Management Server ready")
    client = ros(listing("task_client.py"), name="task_client.py")
    client.wait_for("Task accepted!", times=4)
    server.wait_for("Task 2 completed")
    assert client.err.splitlines() == [
        "[INFO] [T] [task_client]: Task client ready",
        "[INFO] [T] [task_client]: Task accepted! ID: 1, ETA: 5.0s - Task queued: move",
        "[INFO] [T] [task_client]: Task accepted! ID: 2, ETA: 3.0s - Task queued: scan",
        "[INFO] [T] [task_client]: Task accepted! ID: 3, ETA: 5.0s - Task queued: move",
        "[INFO] [T] [task_client]: Task accepted! ID: 4, ETA: 1.0s - Task queued: report",
    ]
    queued = [line for line in server.err.splitlines() if "queued" in line]
    assert queued == [
        "[INFO] [T] [task_management_server]:"
        f" Task {number} queued: {kind} to {target} (priority: {priority})"
        for number, (kind, target, priority) in enumerate(
            [
                ("move", "warehouse", 8),
                ("scan", "area_a", 9),
                ("move", "station_1", 5),
                ("report", "central", 3),
            ],
            1,
        )
    ]
    assert client.interrupt() == INTERRUPTED
    assert "Traceback" not in client.err


def test_timeout_snippet_gets_a_response_or_returns_none_at_the_timeout(ros, run):
    name, request = "send_request_with_timeout", "AddTwoInts.Request(a=1, b=2)"
    code, out, err = run(program_of(name, f"{request}, timeout=0.5", waits=False))
    assert (code, out) == (0, "None\n")
    assert "[WARN] [T] [caller]: Service call timed out\n" in err
    server = ros(listing("add_two_ints_server.py"), name="add_two_ints_server.py")
    server.wait_for("is ready")
    code, out, _ = run(program_of(name, f"{request}, timeout=60"))
    assert (code, out) == (0, "example_interfaces.srv.AddTwoInts_Response(sum=3)\n")


def test_retry_snippet_gets_a_response_at_the_first_attempt(ros, run):
    ros(listing("add_two_ints_server.py"), name="add_two_ints_server.py").wait_for("is ready")
    code, out, err = run(program_of("send_request_with_retry", "AddTwoInts.Request(a=1, b=2)"))
    assert (code, out, err) == (0, "example_interfaces.srv.AddTwoInts_Response(sum=3)\n", "")
