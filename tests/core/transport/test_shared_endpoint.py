"""Transports are found by name; what is missing is named; nodes share endpoints."""

import asyncio
import re
import sys
from contextvars import copy_context
from inspect import signature

import pytest

import taskrpc
from taskrpc.core.current_program import current_program
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.memory import MemoryNetwork
from taskrpc.core.transport.shared_endpoint import ENTRY_POINTS, TRANSPORTS, Registration
from taskrpc.testing import CallFaults
from tests.installed import add_package


def register(monkeypatch, name, *arguments, **more):
    monkeypatch.setitem(TRANSPORTS, name, Registration(*arguments, **more))


def test_an_unknown_transport_lists_those_that_exist(monkeypatch):
    register(monkeypatch, "pigeon", "pigeon.post:open_network")
    problem = "transport: expected 'tcp', 'memory', .* or 'pigeon', got 'dove'"
    with pytest.raises(taskrpc.TaskRpcError, match=problem):
        taskrpc.Node("node", transport="dove")


async def test_an_installed_package_adds_a_transport(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    text = "from taskrpc.core.transport.memory import open_network\n"
    points = {"raven": "ravens:open_network", "tcp": "ravens:open_network"}
    add_package(tmp_path, "ravens", {"ravens": text}, {ENTRY_POINTS: points})
    async with taskrpc.Node("node", transport="raven") as node:
        assert isinstance(node._transport.network, MemoryNetwork)
    assert shared_endpoint.registered("tcp") is TRANSPORTS["tcp"]
    with pytest.raises(taskrpc.TaskRpcError, match=r"'zenoh' or 'raven', got 'dove'"):
        taskrpc.Node("node", transport="dove")


ENGINE = """
from taskrpc.spi import TunnelNetwork

class Engine:
    name, address, discovery_ends = "the post", "", 0.0
    async def open(self, events): ...
    def announce(self, entry): ...

def open_network(settings):
    return TunnelNetwork(Engine(), settings)
"""


@pytest.mark.parametrize(
    ("text", "opener", "problem"),
    [
        ("1 / 0", ":open_network", "ZeroDivisionError: division by zero"),
        ("", "s:open_network", "ModuleNotFoundError: No module named '.*s'"),
        ("", ":open_netwrk", "TypeError: expected module:function, a function that takes"),
        ("", "", "TypeError: expected module:function, a function that takes"),
        ("def open_network(): ...", ":open_network", "TypeError: open_network.. takes 0 pos"),
        (
            "def open_network(it): ...",
            ":open_network",
            "TypeError: expected a Network, got None, which lacks ",
        ),
        (ENGINE, ":open_network", "TypeError: the engine Engine lacks close, send$"),
    ],
)
async def test_a_broken_transport_of_a_package_is_named(
    tmp_path, monkeypatch, text, opener, problem
):
    monkeypatch.syspath_prepend(str(tmp_path))
    module = f"broken_{tmp_path.name}"
    add_package(tmp_path, "ravens", {module: text}, {ENTRY_POINTS: {"raven": module + opener}})
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        await taskrpc.Node("node", transport="raven").start()
    begin = f"transport='raven': the package ravens adds it as {module}{opener}, which cannot be"
    assert re.match(f"{re.escape(begin)} used: {problem}", str(caught.value))


async def test_an_error_that_a_transport_raises_for_its_user_is_kept(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    text = (
        "import taskrpc\ndef open_network(settings):\n    raise taskrpc.TaskRpcError('no router')"
    )
    points = {ENTRY_POINTS: {"raven": "no_router:open_network"}}
    add_package(tmp_path, "ravens", {"no_router": text}, points)
    with pytest.raises(taskrpc.TaskRpcError, match=r"^no router$"):
        await taskrpc.Node("node", transport="raven").start()


async def test_a_missing_module_is_named_with_the_command_that_installs_it(monkeypatch):
    class Missing:
        def find_spec(self, name, path=None, target=None):
            if name == "pigeon":
                raise ModuleNotFoundError("No module named 'pigeon'", name="pigeon")

    monkeypatch.setattr(sys, "meta_path", [Missing(), *sys.meta_path])
    advice = "install it with: pip install pigeons"
    register(monkeypatch, "pigeon", "pigeon:open_network", needs="pigeon", advice=lambda: advice)
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        await taskrpc.Node("node", transport="pigeon").start()
    assert str(caught.value) == (
        "transport='pigeon' needs the module pigeon, which is not installed; " + advice
    )


async def test_a_module_that_is_missing_for_another_reason_is_a_mistake_of_ours(monkeypatch):
    register(monkeypatch, "pigeon", "taskrpc.core.transport.absent:open_network", needs="pigeon")
    with pytest.raises(ModuleNotFoundError, match=r"taskrpc\.core\.transport\.absent"):
        await taskrpc.Node("node", transport="pigeon").start()


class Slow(MemoryNetwork):
    """A network that takes a second to open, or fails."""

    opened = 0
    problem = None

    async def open(self):
        await asyncio.sleep(1)
        if self.problem is not None:
            raise taskrpc.TaskRpcError(self.problem)
        type(self).opened += 1


@pytest.fixture
def slow(monkeypatch):
    monkeypatch.setattr(shared_endpoint, "slow", lambda it: Slow(domain=it.domain), raising=False)
    monkeypatch.setattr(Slow, "opened", 0)
    register(monkeypatch, "slow", "taskrpc.core.transport.shared_endpoint:slow")


async def test_a_node_starts_when_its_transport_is_open(slow):
    began = asyncio.get_running_loop().time()
    async with taskrpc.Node("node", transport="slow") as node:
        assert asyncio.get_running_loop().time() - began == pytest.approx(1)
        assert [entry.nodes for entry in await node.graph()] == [("/node",)]


async def test_a_transport_that_cannot_open_leaves_nothing_behind(slow, monkeypatch):
    monkeypatch.setattr(Slow, "problem", "the router is not there")
    node = taskrpc.Node("node", transport="slow")
    with pytest.raises(taskrpc.TaskRpcError, match="the router is not there"):
        await node.start()
    monkeypatch.setattr(Slow, "problem", None)
    async with node:
        assert [entry.nodes for entry in await node.graph()] == [("/node",)]


async def test_a_node_that_two_tasks_start_joins_once(slow):
    node = taskrpc.Node("node", transport="slow")
    await asyncio.gather(node.start(), node.start())
    assert [entry.nodes for entry in await node.graph()] == [("/node",)]
    endpoint = node._transport
    assert endpoint.holders == 1
    await node.destroy()
    assert endpoint.holders == 0


async def test_nodes_with_equal_settings_share_an_endpoint():
    async with (
        taskrpc.Node("one", transport="memory") as one,
        taskrpc.Node("other", transport="memory") as other,
        taskrpc.Node("apart", transport="memory", listen="apart") as apart,
    ):
        assert one._transport is other._transport
        assert one._transport is not apart._transport


async def test_nodes_that_differ_in_any_setting_share_no_endpoint():
    other = {
        "listen": "apart",
        "peers": ["apart"],
        "token": "a token of the test",
        "tls": taskrpc.Tls(ca="ca.pem"),
        "accounts": taskrpc.Accounts(),
        "keepalive": "robot",
        "domain": 7,
        "faults": CallFaults("busy"),
    }
    one_loop = {"threads"}  # the nodes of one event loop agree in it
    settings = signature(shared_endpoint.shared_endpoint).parameters.keys() - {"name"} - one_loop
    assert settings == other.keys(), "a new setting belongs into the key, and needs a value here"
    usual = {"listen": None, "peers": None, "token": None, "tls": None}
    endpoints = [
        shared_endpoint.shared_endpoint("memory", **usual | changed)
        for changed in [{}, *({name: value} for name, value in other.items())]
    ]
    assert len(set(endpoints)) == len(endpoints)
    for endpoint in endpoints:
        await endpoint.release()


async def test_programs_in_one_interpreter_have_endpoints_of_their_own():
    def in_program(name):
        context = copy_context()
        context.run(current_program.set, name)
        return context

    async def started(name):
        node = taskrpc.Node(name, transport="memory")
        await node.start()
        return node

    async with taskrpc.Node("apart", transport="memory") as apart:
        one, same, other = [
            await asyncio.create_task(started(name), context=in_program(program))
            for name, program in [("one", "a"), ("same", "a"), ("other", "b")]
        ]
        assert one._transport is same._transport
        assert len({one._transport, other._transport, apart._transport}) == 3

        await shared_endpoint.close_program("a")  # its nodes were never destroyed
        names = {node for entry in await other.graph() for node in entry.nodes}
        assert names == {"/other", "/apart"}
        await other.destroy()
