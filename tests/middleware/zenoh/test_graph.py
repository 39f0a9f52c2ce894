"""The graph has what the present tokens show."""

from __future__ import annotations

import msgspec

from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint
from taskrpc.middleware.zenoh.graph import Graph
from taskrpc.middleware.zenoh.tokens import Kind, Qos, Token
from tests.middleware.zenoh.test_tokens import SERVER

NODE = Token(Kind.NODE, 0, "c0ffee", 0, 0, "/taskrpc_server")
PUBLISHER = msgspec.structs.replace(
    SERVER,
    kind=Kind.PUBLISHER,
    endpoint_id=2,
    name="/text",
    type_name="std_msgs/msg/String",
    qos=Qos(reliable=False, latched=True, depth=3),
)


def graph_of(*tokens):
    graph = Graph()
    for token in tokens:
        assert graph.add(token.key()) == token
    return graph


def test_tokens_are_found_by_kind_and_name_until_they_are_removed():
    other = msgspec.structs.replace(SERVER, session="beef")
    graph = graph_of(SERVER, other)
    assert list(graph.named(Kind.SERVER, "/add_two_ints")) == [SERVER, other]
    assert not list(graph.named(Kind.CLIENT, "/add_two_ints"))
    assert graph.remove(SERVER.key()) == SERVER
    assert list(graph.named(Kind.SERVER, "/add_two_ints")) == [other]
    graph.clear()
    assert not list(graph.named(Kind.SERVER, "/add_two_ints"))


def test_a_token_counts_once_and_garbage_not_at_all():
    graph = graph_of(SERVER)
    assert graph.add(SERVER.key()) is None
    assert graph.add("@ros2_lv/0/garbage") is None
    assert graph.remove("@ros2_lv/0/garbage") is None


def test_each_session_has_an_entry_except_for_taskrpc_programs():
    graph = graph_of(NODE, SERVER, PUBLISHER, msgspec.structs.replace(NODE, session="beef"))
    (entry,) = graph.entries(without={"beef"})
    assert entry.nodes == ("/taskrpc_server",)
    assert entry.services == (
        ServiceEndpoint("/add_two_ints", SERVER.type_name, SERVER.type_hash, "/taskrpc_server"),
    )
    assert entry.publishers == (
        TopicEndpoint(
            *("/text", "std_msgs/msg/String", SERVER.type_hash, "/taskrpc_server"), 3, False, True
        ),
    )
    assert entry.address == ""
    assert len(graph.entries(without=())) == 2
