"""The network between the checks and a sandbox."""

import sys

import pytest

import srvgen
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.network import Address
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.course.labs.sandbox.network import SandboxNetwork
from taskrpc.errors import NameInUse
from tests.labs.confined import child_trial, needs_bubblewrap

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork")
both = pytest.mark.parametrize("confined", [False, pytest.param(True, marks=needs_bubblewrap)])
PROGRAM = RegistryEntry(2, "server.py", "/submission", 0.0, "127.0.0.1:7000", "no hex")
SERVICE = ServiceEndpoint("/add", "std_srvs/srv/Trigger", "", "/adder")


class Check:
    """What a check has in a sandbox in which one program offers a service."""

    def __init__(self):
        program = TrackedEntry(PROGRAM)
        program.apply(EntryChange(service=SERVICE))
        self.entries = [program.entry()]
        self.revision = 0
        self.published = []

    def publish(self, entry, change):
        self.published.append(change)

    async def new_socket(self):
        raise AssertionError("no socket is needed")


@posix
@pytest.mark.real_time
@both
async def test_the_programs_of_a_check_see_each_other_and_the_checks(confined, tmp_path):
    code = """
import rclpy
from std_srvs.srv import Trigger

def answer(request, response):
    response.message = NAME
    return response

rclpy.init()
node = rclpy.create_node(NAME)
node.create_service(Trigger, NAME, answer)
client = node.create_client(Trigger, CALLS)
client.wait_for_service()
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future)
print("got", future.result().message, flush=True)
rclpy.spin(node)
"""
    for name, calls in (("one", "two"), ("two", "checks")):
        text = code.replace("NAME", repr(name)).replace("CALLS", repr(calls))
        (tmp_path / f"{name}.py").write_text(text)

    def answer(request, response):
        response.message = "checks"
        return response

    Trigger = srvgen.load("std_srvs/srv/Trigger")
    async with child_trial(tmp_path, confined=confined) as trial:
        trial.node.create_service(Trigger, "checks", answer)
        programs = [await trial.start("one.py"), await trial.start("two.py")]
        client = trial.node.create_client(Trigger, "one")
        assert await client.wait_for_service(timeout=20)
        response = await client.call(Trigger.Request(), timeout=10)
        assert response.message == "one"
        for program, other in zip(programs, ("two", "checks"), strict=True):
            assert await program.wait_for_line(f"got {other}", 20), program.output


def test_a_program_with_a_broken_token_is_still_located():
    (address,) = SandboxNetwork(Check(), 0).locate("/add")
    assert (address.text, address.token) == ("127.0.0.1:7000", b"")


def test_the_checks_cannot_take_the_name_of_a_program():
    check = Check()
    network = SandboxNetwork(check, 0)
    mine = TrackedEntry(RegistryEntry(1, "checks", "", 0.0))
    with pytest.raises(NameInUse, match="/add is already offered by a program"):
        network.publish(mine, EntryChange(service=SERVICE), claim="/add")
    assert check.published == []


@pytest.mark.parametrize("place", ["192.0.2.1:80", "unix:/run/agent.sock", "example.org:80"])
async def test_only_the_loopback_of_the_sandbox_is_dialled(place):
    network = SandboxNetwork(Check(), 0)
    with pytest.raises(ConnectionRefusedError):
        await network.dial(Address(place, b""), lambda: None)
