"""Connections that break at seeded points: a TCP proxy on loopback, and pipes in memory.

Like TCP, they neither lose nor repeat bytes within a stream. They delay, truncate, close,
reset, or discard everything from some byte on (a black hole: no side is notified).
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
import struct
from dataclasses import dataclass
from typing import Any

from taskrpc.core.transport.pipe import Pipe
from tests.faults.harness import Counts

DELAY, TRUNCATE, CUT, RESET, HOLE = "delayed", "truncated", "cut", "reset", "black-holed"
KINDS = (DELAY, TRUNCATE, CUT, RESET, HOLE)


@dataclass
class Fault:
    """A fault of a stream: its kind, the byte where it happens, and the delay in seconds."""

    kind: str
    after: int
    seconds: float = 0.05


class Faults:
    """Draws the faults of streams from a seed.

    Args:
        share: the share of the streams that have a fault.
        reach: a fault happens within this many bytes after `skip`.
    """

    def __init__(
        self,
        chance: random.Random,
        counts: Counts,
        *,
        kinds: tuple[str, ...] = KINDS,
        share: float = 0.8,
        skip: int = 0,
        reach: int = 2000,
    ) -> None:
        self._chance, self.counts, self._kinds = chance, counts, kinds
        self._share, self._skip, self._reach = share, skip, reach

    def draw(self) -> Fault | None:
        """Draw the fault of a new stream."""
        chance = self._chance
        if chance.random() >= self._share:
            return None
        after = self._skip + chance.randrange(self._reach)
        return Fault(chance.choice(self._kinds), after, chance.uniform(0.001, 0.2))


def faulty_pipe(faults: Faults) -> type[Pipe]:
    """The class of pipes to patch into `taskrpc.core.transport.pipe.Pipe`."""

    class FaultyPipe(Pipe):
        """A pipe that breaks when its fault's number of bytes was written."""

        def __init__(self, protocol: Any, name: str) -> None:
            super().__init__(protocol, name)
            self._fault = faults.draw()
            self._passed = 0
            self._swallows = False
            self._late: list[bytes] | None = None

        def write(self, data: Any) -> None:
            fault, data = self._fault, bytes(data)
            self._passed += len(data)
            if self._swallows or self._closing:
                return
            if self._late is not None:
                self._late.append(data)
            elif fault is None or self._passed <= fault.after:
                super().write(data)
            else:
                self._fault = None
                faults.counts[fault.kind] += 1
                self._strike(fault, data, len(data) - (self._passed - fault.after))

        def _strike(self, fault: Fault, data: bytes, at: int) -> None:
            match fault.kind:
                case "delayed":
                    self._late = [data]
                    self._loop.call_later(fault.seconds, self._catch_up)
                case "truncated":
                    super().write(data[:at])
                    self._swallows = True  # after half a frame nothing may follow
                    self._loop.call_soon(self._loop.call_soon, self.close)
                case "cut":
                    self.close()
                case "reset":
                    super().write(data[:at])
                    self._swallows = True
                    self._loop.call_soon(self.abort)
                case "black-holed":
                    self._swallows = self.peer._swallows = True

        def _catch_up(self) -> None:
            late, self._late = self._late or [], None
            for data in late:
                super().write(data)

    return FaultyPipe


class Proxy:
    """A proxy on loopback in front of a server; clients dial `address`."""

    def __init__(self, target: str, faults: Faults) -> None:
        host, _, port = target.rpartition(":")
        self._target = host, int(port)
        self._faults = faults
        self._ways: set[asyncio.Task[None]] = set()
        self.address = ""

    async def __aenter__(self) -> Proxy:
        self._server = await asyncio.start_server(self._accepted, "127.0.0.1", 0)
        self.address = f"127.0.0.1:{self._server.sockets[0].getsockname()[1]}"
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        ways = list(self._ways)
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        await self._server.wait_closed()

    async def _accepted(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        self._ways.add(task)
        self._faults.counts["connections through the proxy"] += 1
        there = None
        try:
            # Cancelled only at the end; asyncio would log the cancelled callback.
            with contextlib.suppress(OSError, asyncio.CancelledError):
                back, there = await asyncio.open_connection(*self._target)
                await self._joined((reader, there), (back, writer))
        finally:
            self._ways.discard(task)
            for each in (writer, there):
                if each is not None:
                    each.close()

    async def _joined(self, *ways: tuple[asyncio.StreamReader, asyncio.StreamWriter]) -> None:
        """Forward in both directions until one ends; then end the other as well."""
        pumps = [asyncio.ensure_future(self._pump(*way, self._faults.draw())) for way in ways]
        try:
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            if any(pump.done() and pump.result() == RESET for pump in pumps):
                for _, writer in ways:
                    _reset(writer)
        finally:
            for pump in pumps:
                pump.cancel()
            await asyncio.gather(*pumps, return_exceptions=True)

    async def _pump(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, fault: Fault | None
    ) -> str:
        passed = 0
        with contextlib.suppress(OSError):
            while data := await reader.read(65_536):
                if fault is not None and passed + len(data) > fault.after:
                    struck, fault = fault, None
                    self._faults.counts[struck.kind] += 1
                    if struck.kind != DELAY:
                        return await self._strike(struck, writer, data[: struck.after - passed])
                    await asyncio.sleep(struck.seconds)
                passed += len(data)
                writer.write(data)
                await writer.drain()
        return ""

    async def _strike(self, fault: Fault, writer: asyncio.StreamWriter, before: bytes) -> str:
        if fault.kind != CUT:
            writer.write(before)
            await writer.drain()
        if fault.kind == HOLE:
            await asyncio.Event().wait()
        return fault.kind


def _reset(writer: asyncio.StreamWriter) -> None:
    """Close with a reset instead of an end."""
    sock = writer.get_extra_info("socket")
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    writer.transport.abort()
