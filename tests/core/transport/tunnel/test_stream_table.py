"""The connections of a program begin, end and are forgotten as the datagrams say."""

import asyncio

import pytest

from taskrpc.core.transport.tunnel import frames, stream_table
from taskrpc.core.transport.tunnel.frames import Kind
from taskrpc.core.transport.tunnel.stream_table import StreamTable
from tests.core.transport.test_pipe import Recorder, turns


class Wire:
    """Two tables, and the datagrams between them."""

    def __init__(self):
        self.sent = []
        self.tables = {place: StreamTable(self.send) for place in ("ada", "bob")}
        self.served = []
        self.tables["bob"].accepts = self._served

    def _served(self):
        self.served.append(Recorder())
        return self.served[-1]

    def send(self, place, datagram):
        self.sent.append((place, datagram))

    def pass_on(self):
        """Pass on what was sent, and what is sent as a result."""
        while self.sent:
            place, datagram = self.sent.pop(0)
            if place in self.tables:
                self.tables[place].received(datagram)

    async def connected(self):
        """Return the protocols of both ends of a connection from ada to bob."""
        dial = asyncio.ensure_future(self.tables["ada"].dial("bob", "ada", Recorder))
        await asyncio.sleep(0)
        self.pass_on()
        return await dial, self.served[-1]


async def test_a_connection_carries_bytes_both_ways_and_ends():
    wire = Wire()
    one, other = await wire.connected()
    one.transport.write(b"hello")
    other.transport.write(b"hi")
    wire.pass_on()
    assert (other.received, one.received) == (b"hello", b"hi")
    assert one.transport.get_extra_info("peername") == "bob"
    one.transport.write(b" and bye")
    one.transport.close()
    wire.pass_on()
    await turns()
    assert other.received == b"hello and bye"
    assert one.log == other.log == ["lost"]
    for table in wire.tables.values():
        assert (table.streams, table.accepted, table.dialling) == ({}, {}, {})
        assert len(table.forgotten) == 1


async def test_an_end_that_waits_for_the_reader_ends_when_all_is_read():
    wire = Wire()
    one, other = await wire.connected()
    other.transport.pause_reading()
    one.transport.write(bytes(3_000_000))
    assert one.log == ["pause"]
    one.transport.close()
    wire.pass_on()
    await turns()
    assert (one.log, other.log) == (["pause"], [])
    other.transport.resume_reading()
    for _ in range(10):
        await turns()
        wire.pass_on()
    assert len(other.received) == 3_000_000
    assert (one.log, other.log) == (["pause", "resume", "lost"], ["lost"])


async def test_a_repeated_request_makes_no_second_connection():
    wire = Wire()
    dial = asyncio.ensure_future(wire.tables["ada"].dial("bob", "ada", Recorder))
    await asyncio.sleep(0)
    (syn,) = wire.sent
    wire.sent = [syn, syn]
    wire.pass_on()
    await dial
    assert len(wire.served) == 1
    assert len(wire.tables["bob"].streams) == 1


async def test_a_program_that_accepts_nothing_refuses():
    wire = Wire()
    wire.tables["bob"].accepts = None
    with pytest.raises(ConnectionRefusedError, match="the program accepts no calls"):
        await wire.connected()


@pytest.mark.parametrize("end", ["program_gone", "end_all"])
async def test_a_request_ends_when_its_program_is_gone(end):
    wire = Wire()
    table = wire.tables["ada"]
    dials = [asyncio.ensure_future(table.dial(place, "ada", Recorder)) for place in ("bob", "eve")]
    await asyncio.sleep(0)
    if end == "program_gone":
        table.program_gone("bob")
    else:
        table.end_all("the router is gone", tell=False)
    await turns()
    assert isinstance(dials[0].exception(), ConnectionRefusedError)
    assert dials[1].done() == (end == "end_all")
    dials[1].cancel()
    await turns()
    assert table.dialling == {}


async def test_only_the_connections_with_a_program_that_is_gone_end():
    wire = Wire()
    one, _ = await wire.connected()
    table = wire.tables["ada"]
    table.program_gone("eve")
    await turns()
    assert one.log == []
    table.program_gone("bob")
    await turns()
    assert one.log == ["lost"]
    assert wire.sent == []


@pytest.mark.parametrize("tell", [True, False])
async def test_the_other_end_hears_of_the_end_if_it_can(tell):
    wire = Wire()
    one, other = await wire.connected()
    wire.tables["ada"].end_all("the node was destroyed", tell=tell)
    wire.pass_on()
    await turns()
    assert one.log == ["lost"]
    assert other.log == (["lost"] if tell else [])
    if not tell:  # it hears of it when it sends
        other.transport.write(b"are you there?")
        wire.pass_on()
        await turns()
        assert other.log == ["lost"]


async def test_a_forgotten_connection_responds_only_to_data():
    wire = Wire()
    one, other = await wire.connected()
    (own_id,) = wire.tables["ada"].streams
    wire.tables["ada"].end_all("", tell=False)
    await turns()
    for kind in Kind:
        wire.tables["ada"].received(frames.pack(kind, own_id) + b"x")
        assert bool(wire.sent) == (kind == Kind.DATA)
        wire.sent.clear()
    assert other.log == []
    assert one.log == ["lost"]


async def test_the_number_of_forgotten_connections_is_bounded(monkeypatch):
    monkeypatch.setattr(stream_table, "FORGOTTEN", 3)
    wire = Wire()
    for _ in range(10):
        one, _ = await wire.connected()
        one.transport.close()
        wire.pass_on()
        await turns()
    assert [len(table.forgotten) for table in wire.tables.values()] == [3, 3]


async def test_an_invalid_request_or_acceptance_is_ignored():
    wire = Wire()
    wire.tables["bob"].received(frames.pack(Kind.SYN, 0) + b"short")
    assert (wire.served, wire.sent) == ([], [])
    dial = asyncio.ensure_future(wire.tables["ada"].dial("bob", "ada", Recorder))
    await asyncio.sleep(0)
    (own_id,) = wire.tables["ada"].dialling
    wire.tables["ada"].received(frames.pack(Kind.ACK, own_id) + b"short")
    wire.pass_on()
    await dial
