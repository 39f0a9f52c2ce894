"""`taskrpc doctor` calls the health services of servers; the docs show it on this machine."""

import os
import sys
import time

import pytest

import srvgen
import taskrpc.sync
from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import checks
from taskrpc.cli.shared.remote import Remote
from taskrpc.core.security.lab import Lab, remember_lab
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint

pytestmark = pytest.mark.real_time

Trigger = srvgen.load("std_srvs/srv/Trigger")


def offered(node, *, success=True, message="ready", name="lab/health", srv_type=Trigger):
    def tell(request, response):
        response.success, response.message = success, message
        return response

    return node.create_service(srv_type, name, tell)


@pytest.fixture
def node():
    with taskrpc.sync.Node("lab") as made:
        yield made


@pytest.mark.parametrize(("success", "line"), [(True, "ok      "), (False, "problem ")])
def test_response_of_a_health_service_is_reported(node, capsys, success, line):
    offered(node, success=success, message="this and that")
    assert main(["doctor", node.address]) == (0 if success else 1)
    assert f"{line} /lab/health: this and that\n" in capsys.readouterr().out


def test_only_trigger_services_named_health_are_called(node, capsys):
    offered(node, name="lab/reset", message="it was reset!")
    offered(node, name="lab/health", srv_type=srvgen.load("std_srvs/srv/Empty"))
    assert main(["doctor", node.address]) == 0
    assert "reset!" not in capsys.readouterr().out


def test_health_service_that_does_not_respond_is_a_problem(node, capsys, monkeypatch):
    monkeypatch.setattr(checks, "LISTING_TIMEOUT", 0.1)
    node.create_service(Trigger, "lab/health", lambda request, response: time.sleep(0.5))
    assert main(["doctor", node.address]) == 1
    assert "/lab/health does not answer: no response by the deadline" in capsys.readouterr().out


def test_unreachable_server_is_not_reported_again_by_the_health_check(capsys, monkeypatch):
    gone = ServiceEndpoint("/gone/health", "std_srvs/srv/Trigger", Trigger._HASH, "/gone")

    async def services(remote):
        return [gone]

    monkeypatch.setattr(checks, "_services", services)
    assert main(["doctor"]) == 0
    assert "/gone" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("listens", "asked"), [("0.0.0.0:7450", "127.0.0.1:7450"), ("[::]:7450", "[::1]:7450")]
)
async def test_server_of_all_networks_is_reached_from_this_machine(listens, asked, monkeypatch):
    places = []

    class Here:
        async def listing(self, place):
            places.append(place)

    monkeypatch.setattr(checks, "HERE", Here())
    entry = RegistryEntry(pid=1, script="taskrpc", folder="", since=0.0, address=listens)
    assert (await checks._reach(entry)).state == "ok"
    assert places == [asked]


@pytest.mark.skipif(sys.platform == "win32", reason="Python has no Unix sockets on Windows")
async def test_removed_socket_of_a_running_program_is_named(tmp_path):
    path = tmp_path / "robot.sock"
    entry = RegistryEntry(os.getpid(), "robot.py", "/home/ada", 0.0, f"unix:{path}")
    where = f"robot.py (pid {os.getpid()}, in /home/ada)"
    assert await checks._reach(entry) == checks.problem(
        f"{where} cannot be called: its socket {path} was removed",
        f"end it with `taskrpc stop {os.getpid()}`, and start it again",
    )


@pytest.fixture
def joined():
    """This user has joined a lab."""
    remember_lab(Lab(address="192.0.2.1:7450", token="ada.secret", certificate="PEM"))


async def advice_without_a_program():
    (finding,) = [each async for each in checks.programs() if "offers a service" in each.text]
    return finding.text.removeprefix("no program of this machine offers a service in domain 0")


async def test_joined_laptop_is_not_advised_to_start_a_server(joined, monkeypatch):
    assert await advice_without_a_program() == ": all calls go to the lab at 192.0.2.1:7450"
    monkeypatch.setenv("TASKRPC_PEERS", "192.0.2.9:1, 192.0.2.8:1")
    said = ": programs call 192.0.2.9:1, 192.0.2.8:1 (TASKRPC_PEERS)"
    assert await advice_without_a_program() == said


async def test_program_that_takes_calls_meant_for_the_lab_is_noted(monkeypatch):
    def listed(*names):
        return [ServiceEndpoint(each, "std_srvs/srv/Trigger", "", each) for each in names]

    async def services_of_the_lab(remote):
        return listed("/robot_task", "/robot_task/list", "/robot_task/stop")

    where = {"folder": "/home/ada", "since": 0.0, "address": "127.0.0.1:1"}
    own = RegistryEntry(pid=7, script="greet.py", services=listed("/ada/greet"), **where)
    offered = listed("/robot_task", "/robot_task/list", "/ada/greet")
    shadow = RegistryEntry(pid=8, script="taskrpc-server", services=offered, **where)
    monkeypatch.setattr(checks, "_services", services_of_the_lab)
    monkeypatch.setattr(checks.suggestions, "domains", lambda: {0: [own, shadow]})
    (found,) = [each async for each in checks.in_place_of_the_lab(Remote("192.0.2.1:7450"))]
    assert found == checks.note(
        "taskrpc-server (pid 8, in /home/ada) offers /robot_task and 1 more, as the lab at"
        " 192.0.2.1:7450 does: this machine's calls go to this program, not to the lab",
        "to call the lab, end it: taskrpc stop 8",
    )
