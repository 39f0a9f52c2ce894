"""The graph shows all programs and who calls what, also between other programs."""

import asyncio
import json

import taskrpc
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint
from taskrpc.observe.web import graph
from taskrpc.observe.web.calls import Caller, CallLog
from taskrpc.observe.web.graph import NodeGraph, nodes_json
from tests.core.transport.helpers import Add, add, ask, until


def service(name, node):
    return ServiceEndpoint(name, "x/srv/X", "", node)


def topic(name, node):
    return TopicEndpoint(name, "x/msg/X", "", node, 10, True, False)


def entry(script, *nodes, pid=7, **endpoints):
    return RegistryEntry(pid, script, "/", 0.0, nodes=nodes, **endpoints)


def test_nodes_have_their_endpoints_without_hidden_ones():
    [ada, ben] = nodes_json(
        [
            entry(
                "ada.py",
                "/ada",
                "/ben",
                "/_hidden",
                services=(service("/add", "/ada"), service("/ada/_internal", "/ada")),
                clients=(service("/add", "/ben"), service("/add", "/ben")),
                publishers=(topic("/add/_service_event", "/ada"), topic("/chat", "/ada")),
                subscriptions=(topic("/chat", "/ben"),),
            )
        ],
        [],
    )
    assert ada == {
        "name": "/ada",
        "program": "ada.py",
        "host": "",
        "services": ["/add"],
        "clients": [],
        "publishers": ["/chat"],
        "subscriptions": [],
    }
    assert ben["clients"] == ["/add"]
    assert ben["subscriptions"] == ["/chat"]


def test_callers_of_other_machines_are_nodes_too():
    callers = [
        Caller("/client", "ada", "192.0.2.7", {"/robot_task": None}, 0.0),
        Caller("/_taskrpc_cli_1", "", "", {"/robot_task": None}, 0.0),
        Caller("/ben", "", "", {"/add": None}, 0.0),
    ]
    found = nodes_json([entry("ben.py", "/ben")], callers)
    assert [(each["name"], each["host"], each["clients"]) for each in found] == [
        ("/ben", "", ["/add"]),
        ("ada", "192.0.2.7", ["/robot_task"]),
    ]


def test_lists_of_one_node_are_bounded():
    many = tuple(service(f"/s{number}", "/ada") for number in range(500))
    [ada] = nodes_json([entry("ada.py", "/ada", services=many)], [])
    assert len(ada["services"]) == graph.MAX_ITEMS


async def test_calls_between_other_programs_are_shown_where_introspection_is_on():
    log = CallLog()
    log.is_active = True
    now = asyncio.get_running_loop().time
    async with (
        taskrpc.Node("watcher", transport="memory", token="watcher") as watcher,
        taskrpc.Node("server", transport="memory", token="server") as server,
        taskrpc.Node("ada", transport="memory", token="ada") as ada,
    ):
        offered = server.create_service(Add, "add", add)
        server.configure_introspection(offered, "metadata")
        client = ada.create_client(Add, "add")
        shown = NodeGraph(watcher, log, is_own=lambda entry: False)
        assert {each["name"] for each in await shown.look()} == {"/watcher", "/server", "/ada"}

        async def shows_calls():
            await client.call(ask(1, 2))
            event = log.event(now())
            return [json.loads(each) for each in event.calls] if event else []

        found = []
        for _ in range(100):
            await asyncio.sleep(0.05)
            if found := await shows_calls():
                break
        assert found[0]["id"] < 0
        assert (found[0]["client"], found[0]["service"]) == ("/ada", "/add")
        assert found[0]["state"] == "ok"
        assert found[0]["ms"] >= 0.0
        shown.close()
        await until(lambda: not server.status().topics["/add/_service_event"].subscriptions)
