"""Blocking programs: each transport serves the threads of `taskrpc.sync`."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

import taskrpc.sync
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.shared_endpoint import Registration
from tests.core.transport.contract.transports import CASES
from tests.core.transport.helpers import Add, add, ask

pytestmark = pytest.mark.real_time

TRANSPORTS = {case.transport: case for case in CASES.values()}


def _marked(name):
    mark = TRANSPORTS[name].mark
    ignored = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of foreign packages
    return pytest.param(name, marks=[getattr(pytest.mark, mark), ignored] if mark else [])


@pytest.fixture(params=[_marked(name) for name in TRANSPORTS])
def case(request, monkeypatch):
    case = TRANSPORTS[request.param]
    if case.opener:
        monkeypatch.setitem(shared_endpoint.TRANSPORTS, case.transport, Registration(case.opener))
    if case.transport == "zenoh":
        place = request.getfixturevalue("zenoh_router")
        monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", f'connect/endpoints=["tcp/{place}"]')
    return case


def test_threads_call_a_server_and_get_their_own_responses(case):
    options = {"transport": case.transport, **case.settings}
    with (
        taskrpc.sync.Node("server", **options | {case.apart: "server"}) as server,
        taskrpc.sync.Node("client", **options | {case.apart: "client"}) as node,
    ):
        server.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        assert client.wait_for_service(60)
        with ThreadPoolExecutor(4) as threads:
            sums = threads.map(lambda n: client.call(ask(n, n)).sum, range(100))
            assert list(sums) == [2 * n for n in range(100)]
        with pytest.raises(taskrpc.ServiceUnavailable):
            node.create_client(Add, "absent").call(ask())
        with pytest.raises(taskrpc.DeadlineExceeded):
            client.call(ask(), timeout=0)
