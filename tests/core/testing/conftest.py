"""Programs in a faulty network."""

from __future__ import annotations

import pytest

import taskrpc
from taskrpc.testing import FaultyNetwork
from tests.core.transport.helpers import Add, add


@pytest.fixture
async def lab(request):
    """A server and a client on a network with the settings of the test's parameter."""
    server = taskrpc.Node("server", transport="memory", listen="server")
    user = taskrpc.Node("user", transport="memory", listen="user")
    with FaultyNetwork(seed=3, **getattr(request, "param", {})) as network:
        async with server, user:
            server.create_service(Add, "add", add)
            client = user.create_client(Add, "add", timeout=5)
            yield network, client
