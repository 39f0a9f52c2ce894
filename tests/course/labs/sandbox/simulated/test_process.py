"""Programs of a submission in virtual time: what the checks see, and what they refuse."""

from __future__ import annotations

import dataclasses
import json

import pytest

import srvgen
from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.grading import findings
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.sandbox import speed
from taskrpc.course.labs.sandbox.child_trial import ChildTrial
from taskrpc.course.labs.trial import Call, Service
from taskrpc.course.labs.variants import Variant
from tests.labs.confined import child_trial
from tests.labs.submissions import LECTURERS, solution_of, submission

pytestmark = pytest.mark.real_time

TRIGGER = "std_srvs/srv/Trigger"
DEFINITION = "---\nbool success\nstring message\n"

CLIENT = """
import sys
import time
import srvgen
import taskrpc
from taskrpc.sync import Node

with Node("client") as node:
    client = node.create_client(srvgen.load("std_srvs/srv/Trigger"), "/robot")
    client.wait_for_service()
    for wait in (0.0, 3600.0):
        time.sleep(wait)
        try:
            print(client.call(client.srv_type.Request(), timeout=2.0).message)
        except taskrpc.DeadlineExceeded:
            print("no response")
sys.exit(3)
"""
SERVER = """
import time
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

def respond(request, response):
    time.sleep(100.0)
    response.message = "scanned"
    return response

rclpy.init()
node = Node("server")
node.create_service(Trigger, "scan", respond)
rclpy.spin(node)
"""
# Each check that runs in virtual time, with submissions that fail it.
SIMULATED = {
    4: {
        "the waits double, and the client ends its attempts": [
            "waits_after_the_last_attempt",
            "waits_always_the_same",
        ],
    },
    5: {
        "the most important task is the next one": ["lowest_priority_first", "compares_dicts"],
        "the estimate counts the work ahead": [
            "estimates_its_own_time_only",
            "counts_the_whole_queue",
        ],
    },
    6: {"the robot answers while it scans": ["sleeps_in_the_callback"]},
}
CASES = [
    (number, title, source)
    for number, checks in SIMULATED.items()
    for title, names in checks.items()
    for source in [
        solution_of(number),
        *(LECTURERS / f"lab{number}" / "wrong" / name for name in names),
    ]
]


async def simulated(folder, code, **settings):
    (folder / "program.py").write_text(code)
    async with child_trial(folder) as trial:
        return await trial.simulate("program.py", duration=10_000.0, **settings)


async def test_requests_come_to_the_checks_with_their_virtual_times(tmp_path):
    times = []

    def respond(request, time):
        times.append(time)
        return None if len(times) == 1 else srvgen.load(TRIGGER).Response(message="at the dock")

    service = Service(TRIGGER, DEFINITION, "/robot", respond)
    found = await simulated(tmp_path, CLIENT, service=service)
    assert (found.output, found.code) == (["no response", "at the dock"], 3)
    assert times[1] - times[0] == pytest.approx(3602, abs=0.1)
    assert list(found.times) == pytest.approx([times[0] + 2, times[1]], abs=0.1)


async def test_calls_of_the_checks_are_made_at_their_virtual_times(tmp_path):
    request = srvgen.load(TRIGGER).Request()
    calls = [Call(TRIGGER, "/scan", request, 0.0), Call(TRIGGER, "/scan", request, 50.0)]
    found = await simulated(tmp_path, SERVER, calls=calls)
    first, second = found.responses
    assert (first.message.message, found.code) == ("scanned", None)
    assert second.began - first.began == pytest.approx(50, abs=0.1)
    assert second.time - first.began == pytest.approx(200, abs=0.1)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import os; os._exit(7)", "its process ended with 7"),
        ("import socket\nsocket.socket()", r"program\.py:2 of program uses a socket"),
        ("if", r"program\.py, line 1"),
    ],
)
async def test_a_program_that_cannot_be_simulated_fails_the_check(tmp_path, code, message):
    with pytest.raises(NotMet, match=message):
        await simulated(tmp_path, code)


@pytest.mark.parametrize("message", ["x", '{"type":"Asked","time":0.0,"request":"AAAA"}'])
async def test_made_up_messages_are_refused(tmp_path, message):
    code = f"""
import os
for number in range(1, 100):
    try:
        os.write(number, {message.encode()!r} + b"\\n")
    except OSError:
        pass
"""
    with pytest.raises(Exception, match=r"JSON is malformed|offers no service"):
        await simulated(tmp_path, code)


async def found_by(number, title, folder):
    """Run one check of a lab; returns its problem as text."""
    check = next(each for each in lab(number).checks if each.title == title)
    only = dataclasses.replace(lab(number), checks=(dataclasses.replace(check, needs=()),))
    [found] = [each async for each in findings(only, lambda: child_trial(folder))]
    return str(found.problem)


async def test_a_made_up_report_without_requests_earns_nothing(tmp_path):
    submission(4, solution_of(4), tmp_path, Variant())
    line = {"time": 11.0, "text": "[ERROR] [1.0] [client]: dock: no response in 4 attempts"}
    report = {"type": "Ended", "code": 0, "lines": [line], "problem": "", "refused": ""}
    (tmp_path / "client.py").write_text(f"""
import os
for number in range(3, 100):
    try:
        os.write(number, {json.dumps(report).encode()!r} + b"\\n")
    except OSError:
        pass
""")
    found = await found_by(4, "the waits double, and the client ends its attempts", tmp_path)
    assert "it sent 0 requests" in found


@pytest.mark.labs
@pytest.mark.parametrize(
    ("number", "title", "source"), CASES, ids=lambda value: getattr(value, "name", value)
)
async def test_marks_do_not_depend_on_how_fast_real_time_passes(
    tmp_path, monkeypatch, number, title, source
):
    submission(number, source, tmp_path, Variant())
    found = []
    monkeypatch.setattr(ChildTrial, "unpredictable", lambda _, lowest, __: lowest)
    for factor in (1.0, 10_000.0):  # time would pass so fast that no program keeps up
        monkeypatch.setattr(speed, "_speed", factor)
        found.append(await found_by(number, title, tmp_path))
    assert found[0] == found[1]
    assert (found[0] == "None") == (source == solution_of(number))
