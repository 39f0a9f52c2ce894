"""Connections in memory behave like sockets: order, backpressure, closing."""

import asyncio
import random

from taskrpc.core.transport.pipe import HIGH_WATER, join


class Recorder(asyncio.BufferedProtocol):
    def __init__(self, room=1000):
        self.buffer = bytearray(room)
        self.received = b""
        self.log = []

    def connection_made(self, transport):
        self.transport = transport

    def get_buffer(self, sizehint):
        return memoryview(self.buffer)

    def buffer_updated(self, nbytes):
        self.received += self.buffer[:nbytes]

    def pause_writing(self):
        self.log.append("pause")

    def resume_writing(self):
        self.log.append("resume")

    def connection_lost(self, exc):
        self.log.append("lost")


def joined(room=1000):
    one, other = Recorder(room), Recorder(room)
    join(one, other, "here")
    return one, other


async def turns(count=10):
    for _ in range(count):
        await asyncio.sleep(0)


async def test_bytes_arrive_in_order_in_later_turns():
    chance = random.Random(1)
    one, other = joined(room=7)
    data = chance.randbytes(5000)
    rest = data
    while rest:
        count = chance.randrange(1, 100)
        one.transport.write(rest[:count])
        rest = rest[count:]
    assert other.received == b""
    await turns()
    assert other.received == data


async def test_a_writer_is_paused_while_the_reader_pauses():
    one, other = joined()
    other.transport.pause_reading()
    one.transport.write(bytes(HIGH_WATER + 1))
    assert one.log == ["pause"]
    assert one.transport.get_write_buffer_size() == HIGH_WATER + 1
    await turns()
    assert other.received == b""
    other.transport.resume_reading()
    await turns()
    assert one.log == ["pause", "resume"]
    assert len(other.received) == HIGH_WATER + 1


async def test_bytes_written_before_close_are_read():
    one, other = joined()
    one.transport.write(b"last words")
    one.transport.close()
    one.transport.write(b"too late")
    await turns()
    assert other.received == b"last words"
    assert one.log == other.log == ["lost"]


async def test_abort_drops_unread_bytes():
    one, other = joined()
    one.transport.write(b"gone")
    one.transport.abort()
    await turns()
    assert other.received == b""
    assert one.log == other.log == ["lost"]


async def test_closing_both_ends_loses_each_once():
    one, other = joined()
    one.transport.close()
    other.transport.close()
    await turns()
    assert one.log == other.log == ["lost"]


async def test_a_paused_reader_sees_the_end_after_all_bytes():
    one, other = joined()
    other.transport.pause_reading()
    one.transport.write(b"data")
    one.transport.close()
    await turns()
    assert other.log == []
    other.transport.resume_reading()
    await turns()
    assert (other.received, other.log) == (b"data", ["lost"])
