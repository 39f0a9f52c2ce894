"""The engine inside one event loop keeps the rules of every engine."""

import asyncio

import pytest

import taskrpc
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.testing.memory_engine import MemoryEngine, bus_of
from tests.core.transport.helpers import Add, add, ask

NAMED = ServiceEndpoint("/add", Add._TYPE, Add._HASH, "/server")


class Recorder:
    """Records the events of an engine."""

    def __init__(self):
        self.log = []

    def __getattr__(self, name):
        return lambda *arguments: self.log.append((name, *arguments))


async def opened(domain=0):
    engine, events = MemoryEngine(domain), Recorder()
    await engine.open(events)
    return engine, events


async def turn():
    await asyncio.sleep(0)
    await asyncio.sleep(0)


async def test_programs_see_each_other_in_any_order():
    first, seen_by_first = await opened()
    first.announce(b"first")
    second, seen_by_second = await opened()
    assert seen_by_second.log == [("program_seen", first.address, b"first")]
    second.announce(b"second")
    second.announce(b"second again")
    await turn()
    assert seen_by_first.log == [
        ("program_seen", second.address, b"second"),
        ("program_seen", second.address, b"second again"),
    ]
    second.close()
    second.close()
    await turn()
    assert seen_by_first.log[2:] == [("program_gone", second.address)]


async def test_datagrams_arrive_later_and_in_order():
    one, _ = await opened()
    other, events = await opened()
    for number in range(5):
        one.send(other.address, b"%d" % number)
    assert events.log == []
    one.send("nowhere", b"lost")
    await turn()
    assert events.log == [("received", b"%d" % number) for number in range(5)]


async def test_faults_replace_datagrams():
    one, _ = await opened()
    other, events = await opened()
    bus_of(0).faults = lambda place, datagram: [datagram, b"more"]
    one.send(other.address, b"sent")
    await turn()
    assert events.log == [("received", b"sent"), ("received", b"more")]


async def test_domains_are_apart():
    one, events = await opened(domain=1)
    other, _ = await opened(domain=2)
    other.announce(b"other")
    one.send(other.address, b"sent")
    await turn()
    assert events.log == []


async def test_a_native_call_gets_a_copy_of_the_response():
    server, _ = await opened()
    client, events = await opened()
    response = Add.Response(sum=7)
    closable = server.serve(NAMED, Add, lambda request, reply: reply.reply(response))
    await turn()
    assert ("foreign_changed",) in events.log
    (found,) = client.foreign_servers("/add")
    assert (found.type_name, found.type_hash, found.node) == (Add._TYPE, Add._HASH, "/server")
    done = []
    client.call("/add", Add, ask(), lambda *result: done.append(result))
    await turn()
    await turn()
    assert done == [(response, None)]
    assert done[0][0] is not response
    closable.close()
    assert client.foreign_servers("/add") == []
    client.call("/add", Add, ask(), lambda *result: done.append(result))
    await turn()
    assert isinstance(done[-1][1], taskrpc.ServiceUnavailable)


async def test_a_server_that_closes_leaves_the_outcome_of_its_calls_unknown():
    server, _ = await opened()
    client, _ = await opened()
    waiting, done = [], []
    server.serve(NAMED, Add, lambda *call: waiting.append(call))
    client.call("/add", Add, ask(1), lambda *result: done.append(result))
    forgotten = client.call("/add", Add, ask(2), lambda *result: pytest.fail("it was cancelled"))
    await turn()
    forgotten.cancel()
    server.close()
    await turn()
    assert [type(error) for _, error in done] == [taskrpc.OutcomeUnknown]
    request, reply = waiting[0]
    reply.reply(add(request, Add.Response()))
    await turn()
    assert len(done) == 1


async def test_the_services_of_taskrpc_programs_are_not_foreign():
    server, _ = await opened()
    client, _ = await opened()
    server.announce(b"entry")
    server.serve(NAMED, Add, lambda request, reply: None)
    assert client.foreign_servers("/add") == []
    assert client.foreign_entries() == []
