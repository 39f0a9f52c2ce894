"""Datagrams and presence over hidden topics."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from taskrpc.core.transport.tunnel.handoff import Handoff
from taskrpc.middleware.ros import bytes_message
from taskrpc.middleware.ros.program_links import ProgramLinks, address_of, id_of_node
from tests.middleware.ros.fake_ros import Ros

A, B = "a" * 16, "b" * 16


class Events:
    """What the links reported."""

    def __init__(self):
        self.got = []

    def received(self, datagram):
        self.got.append(("received", datagram))

    def program_seen(self, address, entry):
        self.got.append(("seen", address, entry))

    def program_gone(self, address):
        self.got.append(("gone", address))


@pytest.fixture
async def pair():
    """Two programs that have announced themselves."""
    ros, made = Ros(), {}
    for own in (A, B):
        node = ros.new_node(f"_taskrpc_{own}")
        links, events = ProgramLinks(ros, object, Handoff(asyncio.get_running_loop())), Events()
        links.open(node, own, events)
        links.announce(f"entry of {own[0]}".encode())
        made[own] = SimpleNamespace(links=links, events=events, node=node)
    for each in made.values():
        each.links.look([node.name for node in ros.nodes])
    await asyncio.sleep(0)
    return SimpleNamespace(ros=ros, a=made[A], b=made[B])


def alive(program, is_alive):
    """Let DDS report whether the watched program is alive."""
    (watch,) = [
        each
        for topic, ends in program.node.ros.topics.items()
        for each in ends
        if "/program_" in topic and each.node is program.node and each.callback
    ]
    watch.events.liveliness(SimpleNamespace(alive_count=int(is_alive)))


@pytest.mark.parametrize(
    ("name", "found"), [(f"_taskrpc_{A}", A), ("_taskrpc_cli_12", ""), ("arm", ""), (A, "")]
)
def test_only_hidden_nodes_of_programs_have_an_id(name, found):
    assert id_of_node(name) == found


async def test_each_program_sees_the_entry_of_the_other(pair):
    assert pair.a.events.got == [("seen", address_of(B), b"entry of b")]
    assert pair.b.events.got == [("seen", address_of(A), b"entry of a")]
    assert pair.a.links.awaited == []


async def test_datagrams_arrive_in_order(pair):
    pair.b.events.got.clear()
    for number in range(5):
        pair.a.links.send(address_of(B), bytes([number]))
    await asyncio.sleep(0)
    assert pair.b.events.got == [("received", bytes([number])) for number in range(5)]


async def test_datagram_to_the_own_address_arrives(pair):
    pair.a.events.got.clear()
    pair.a.links.send(address_of(A), b"to myself")
    await asyncio.sleep(0)
    assert pair.a.events.got == [("received", b"to myself")]


async def test_datagrams_wait_until_dds_has_connected_the_programs(pair):
    inbox = pair.ros.topics[f"/_taskrpc/inbox_{B}"]
    (reader,) = inbox
    inbox.clear()
    pair.a.links.send(address_of(B), b"one")
    pair.a.links.send(address_of(B), b"two")
    pair.b.events.got.clear()
    inbox.append(reader)
    (sender,) = [each for each in inbox if each.callback is None]
    sender.events.matched(None)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert pair.b.events.got == [("received", b"one"), ("received", b"two")]


async def test_datagram_to_an_unknown_address_is_dropped(pair):
    pair.a.links.send("ros/unknown", b"x")
    await asyncio.sleep(0)


async def test_response_waits_until_the_graph_shows_the_program_that_asked(pair):
    # DDS may deliver a program's first datagram before it shows the program's node.
    other = "c" * 16
    for text in (b"one", b"two"):
        pair.a.links.send(address_of(other), text)
    node, events = pair.ros.new_node(f"_taskrpc_{other}"), Events()
    late = ProgramLinks(pair.ros, object, Handoff(asyncio.get_running_loop()))
    late.open(node, other, events)
    pair.a.links.look([each.name for each in pair.ros.nodes])
    await asyncio.sleep(0)
    assert events.got == [("received", b"one"), ("received", b"two")]


async def test_datagrams_for_programs_that_never_appear_are_bounded(pair):
    for number in range(1000):
        pair.a.links.send(f"ros/{number:016x}", b"x")
    assert len(pair.a.links._early) == 100


async def test_program_that_leaves_the_graph_is_gone(pair):
    pair.a.links.look([pair.a.node.name])
    assert pair.a.events.got[-1] == ("gone", address_of(B))


async def test_silent_program_is_gone_and_may_come_back(pair):
    alive(pair.a, False)
    await asyncio.sleep(0)
    assert pair.a.events.got[-1] == ("gone", address_of(B))
    alive(pair.a, True)
    await asyncio.sleep(0)
    assert pair.a.events.got[-1] == ("seen", address_of(B), b"entry of b")


async def test_silent_program_that_then_leaves_is_reported_once(pair):
    alive(pair.a, False)
    await asyncio.sleep(0)
    pair.a.links.look([pair.a.node.name])
    assert [each[0] for each in pair.a.events.got] == ["seen", "gone"]


async def test_message_of_another_kind_is_reported_as_garbage(pair):
    pair.a.events.got.clear()
    pair.ros.topics[f"/_taskrpc/inbox_{A}"][0].callback(b"garbage")
    await asyncio.sleep(0)
    assert pair.a.events.got == [("received", b"")]


async def test_full_queue_of_dds_loses_the_datagram_with_a_warning(pair, caplog):
    pair.a.links.send(address_of(B), b"connects")
    (sender,) = [e for e in pair.ros.topics[f"/_taskrpc/inbox_{B}"] if e.callback is None]

    def full(_):
        raise RuntimeError("out of resources")

    sender.publish = full
    pair.a.links.send(address_of(B), b"lost")
    assert "out of resources" in caplog.text


async def test_closed_links_report_nothing(pair):
    pair.a.links.close()
    pair.a.events.got.clear()
    pair.ros.topics[f"/_taskrpc/inbox_{A}"][0].callback(bytes_message.pack(b"late"))
    await asyncio.sleep(0)
    assert pair.a.events.got == []
