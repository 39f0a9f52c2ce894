"""The contract suite runs over each transport, on virtual time or on the machine's clock."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import itertools

import pytest

import taskrpc
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.shared_endpoint import Registration
from taskrpc.testing import VirtualTimeLoop
from tests.core.transport import helpers
from tests.core.transport.contract.transports import CASES, LOOPS, NATIVE_TOPICS, case_of
from tests.ros_domains import own_domains


def is_contract(path):
    """Whether every transport must pass the tests of a file."""
    return path.parent.name == "contract" or "_contract" in path.name


def pytest_asyncio_loop_factories(config, item):
    return LOOPS if is_contract(item.path) else None


def pytest_collection_modifyitems(items):
    for item in items:
        factory = getattr(item, "callspec", None) and item.callspec.params.get(
            "_asyncio_loop_factory"
        )
        name = case_of(factory) if factory else ""
        if not name or not is_contract(item.path):
            continue
        case = CASES[name]
        if case.needs and importlib.util.find_spec(case.needs) is None:
            item.add_marker(pytest.mark.skip(reason=f"needs {case.needs}"))
        if not issubclass(case.loop, VirtualTimeLoop):
            item.add_marker(pytest.mark.real_time)
        if case.mark:
            item.add_marker(case.mark)
            # The imports of foreign packages may use what Python is going to remove.
            item.add_marker(pytest.mark.filterwarnings("ignore::DeprecationWarning"))
        if (reason := case.lacks.get(item.originalname)) is not None:
            item.add_marker(pytest.mark.skip(reason=reason))


class Network:
    """Creates nodes that are destroyed with the test; each has its own endpoint by default."""

    def __init__(self, stack, case, name):
        self.name = name
        self.is_virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self.transport = case.transport
        self.by_address = case.by_address
        self.has_native_topics = NATIVE_TOPICS.keys() <= case.lacks.keys()
        self.shares_secrets = case.shares_secrets
        self._case = case
        self._stack = stack
        self._count = itertools.count()
        self._networks = []

    def options(self, name="server", *, shared=False, **options):
        """Return the arguments of a node."""
        # Nodes with different settings do not share an endpoint.
        own = "shared" if shared else f"{name} {next(self._count)}"
        return {"transport": self.transport, **self._case.settings, self._case.apart: own} | options

    async def node(self, name="server", *, shared=False, **options):
        node = taskrpc.Node(name, **self.options(name, shared=shared, **options))
        await self._stack.enter_async_context(node)
        if self.transport == "ros":
            await self._until_discovered(node._transport.network)
        return node

    async def _until_discovered(self, network):
        """Wait until DDS has shown the programs of the test to each other."""
        self._networks = [each for each in self._networks if not each._closed]
        pairs = [
            pair
            for each in self._networks
            if each is not network and each.domain == network.domain
            for pair in ((each, network), (network, each))
        ]
        if network not in self._networks:
            self._networks.append(network)
        try:
            await helpers.until(
                lambda: all(to._engine.address in of._directory for of, to in pairs)
            )
        except TimeoutError:
            pytest.fail("\n".join(missing_link(of._engine, to._engine) for of, to in pairs))

    def reaching(self, server):
        """Return the arguments with which a node with another secret reaches the server."""
        return {"peers": [server.address]} if self._case.by_address else {}

    async def client(self, srv_type, name, *, node="client", **options):
        return (await self.node(node)).create_client(srv_type, name, **options)


def missing_link(of, to):
    """Return what one program on ROS knows of another one, to tell why it has not found it."""
    known = of._links._programs.get(to._id)
    if known is None:
        nodes = of._node.get_node_names()
        return f"{of._id} does not know {to._id}; DDS has shown it the nodes {nodes}"
    publishers = of._node.count_publishers(f"/_taskrpc/program_{to._id}")
    return (
        f"{of._id} knows {to._id}: alive {known.is_alive}, entry {known.entry}, reported"
        f" {known.is_reported}; DDS has shown it {publishers} publishers of the entry"
    )


@pytest.fixture
async def net(monkeypatch, request):
    name = case_of(type(asyncio.get_running_loop())) or "tcp"
    case = CASES[name]
    if case.opener:
        registration = Registration(case.opener)
        monkeypatch.setitem(shared_endpoint.TRANSPORTS, case.transport, registration)
    if case.transport == "ros":
        monkeypatch.setenv("ROS_DOMAIN_ID", str(next(own_domains())))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        # `Network.node` waits as long as DDS needs, mostly less than a fixed time.
        monkeypatch.setattr("taskrpc.middleware.ros.ros_engine.SETTLE", 0.0)
        monkeypatch.setattr("taskrpc.middleware.ros.ros_engine.SETTLE_ALONE", 0.0)
    if case.transport == "zenoh":
        place = request.getfixturevalue("zenoh_router")
        monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", f'connect/endpoints=["tcp/{place}"]')
    async with contextlib.AsyncExitStack() as stack:
        yield Network(stack, case, name)
