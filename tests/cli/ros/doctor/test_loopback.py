"""`taskrpc doctor` says that the loopback interface is down, and blames no program for it."""

import json
import os
import shutil
import socket
import subprocess
import sys

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import checks, loopback
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint

pytestmark = pytest.mark.real_time

_ALONE = ("unshare", "--map-root-user", "--net")
"""Runs a program in a network of its own, whose loopback interface is down."""


def test_working_loopback_is_not_reported():
    assert loopback.loopback() is None


@pytest.mark.parametrize(
    ("error", "reason"),
    [(TimeoutError(), "no response within 2 s"), (OSError(1, "Not permitted"), "Not permitted")],
)
def test_firewall_between_programs_of_this_machine_is_reported(monkeypatch, error, reason):
    class Refused(socket.socket):
        def connect(self, address):
            raise error

    monkeypatch.setattr(socket, "socket", Refused)
    found = loopback.loopback()
    assert found.text == f"connections of this machine to 127.0.0.1 fail: {reason}"
    assert "a firewall of this machine may block them" in found.advice


async def test_no_program_is_asked_and_blamed_while_loopback_fails(monkeypatch):
    service = ServiceEndpoint("/add", "std_srvs/srv/Unknown", "", "/add")
    where = {"folder": "", "since": 0.0, "address": "127.0.0.1:1", "services": [service]}
    entry = RegistryEntry(pid=os.getpid(), script="adder.py", **where)
    monkeypatch.setattr(checks.suggestions, "domains", lambda: {0: [entry]})
    found = [each async for each in checks.programs(reachable=False)]
    assert not [each for each in found if "does not answer" in each.text]


@pytest.mark.parametrize("argv", [[], ["127.0.0.1:7450"]])
def test_failing_loopback_is_the_only_problem(monkeypatch, capsys, argv):
    broken = checks.problem("the loopback interface lo is down", "bring it up")
    monkeypatch.setattr("taskrpc.cli.ros.doctor.command_line.loopback", lambda: broken)
    assert main(["doctor", *argv, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert [each["text"] for each in found if each["state"] == "problem"] == [broken.text]


@pytest.mark.skipif(
    shutil.which("unshare") is None or subprocess.run([*_ALONE, "true"]).returncode != 0,
    reason="needs unshare, and the right to make networks",
)
def test_loopback_interface_that_is_down_is_named_with_the_command():
    script = (
        "from taskrpc.cli.ros.doctor.loopback import loopback as l; print(l().text, l().advice)"
    )
    said = subprocess.run([*_ALONE, sys.executable, "-c", script], capture_output=True, text=True)
    assert said.stdout == (
        "the loopback interface lo is down: programs of this machine cannot reach each other at"
        " 127.0.0.1 bring it up: sudo ip link set lo up\n"
    )
