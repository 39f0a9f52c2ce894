"""The connections on which a process calls: one to each place, made when it is first wanted."""

from __future__ import annotations

import asyncio
import os
import ssl
from collections.abc import Callable

from taskrpc.errors import ConnectionLost
from taskrpc.transport.calling import CallingConnection
from taskrpc.transport.network import Address, Network
from taskrpc.transport.tls import reason_of

READY_TIMEOUT = 4.0
"""Seconds for dialling and the handshake together."""


class Dialler:
    """Dials each place once, however many ask for it; `make` builds a connection's protocol."""

    def __init__(self, network: Network, make: Callable[[Address], CallingConnection]) -> None:
        self.connections: dict[CallingConnection, None] = {}
        """All that have not ended, those that only finish their calls included."""
        self._network = network
        self._make = make
        self._newest: dict[str, CallingConnection] = {}
        self._dialling: dict[str, asyncio.Task[CallingConnection]] = {}
        self._closed = False

    async def connection(self, address: Address, deadline: float | None) -> CallingConnection:
        """A usable connection to a process, made if need be.

        Raises ConnectionLost when nobody answers there, or what the other side refused it for.
        """
        known = self._newest.get(address.place)
        if known is not None and known.is_usable:
            return known
        if self._closed:
            raise _destroyed()
        if known is not None:
            known.retire()
        task = self._dialling.get(address.place) or self._begin(address)
        loop = asyncio.get_running_loop()
        left = None if deadline is None else max(0.0, deadline - loop.time())
        # Whoever gives up waiting must not take the connection from the others.
        done, _ = await asyncio.wait((task,), timeout=left)
        if not done:
            raise ConnectionLost(f"{address.place} did not answer in time", not_executed=True)
        if task.cancelled():
            raise _destroyed()
        return task.result()

    def ended(self, connection: CallingConnection) -> None:
        """A connection is gone."""
        self.connections.pop(connection, None)
        for place, each in list(self._newest.items()):
            if each is connection:
                del self._newest[place]

    async def close(self) -> None:
        """Dial no more and begin to close every connection."""
        self._closed = True
        tasks = list(self._dialling.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)
        for connection in list(self.connections):
            connection.close()

    def _begin(self, address: Address) -> asyncio.Task[CallingConnection]:
        task = asyncio.get_running_loop().create_task(self._dial(address))
        self._dialling[address.place] = task
        task.add_done_callback(lambda done: self._dialled(address.place, done))
        return task

    def _dialled(self, place: str, task: asyncio.Task[CallingConnection]) -> None:
        del self._dialling[place]
        if not task.cancelled():
            task.exception()  # nobody may be left to ask

    async def _dial(self, address: Address) -> CallingConnection:
        connection = self._make(address)
        try:
            async with asyncio.timeout(READY_TIMEOUT):
                await self._network.dial(address, lambda: connection)
                await connection.ready
            if connection.why_closed is not None:  # by what followed the handshake
                raise connection.why_closed
        except TimeoutError:
            raise ConnectionLost(f"{address.place} did not answer", not_executed=True) from None
        except ssl.SSLError as error:
            problem = f"{address.place}: no TLS connection: {reason_of(error)}"
            raise ConnectionLost(problem, not_executed=True) from None
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise ConnectionLost(f"{address.place}: {reason}", not_executed=True) from None
        except UnicodeError:
            problem = f"{address.place}: no host can have this name"
            raise ConnectionLost(problem, not_executed=True) from None
        else:
            self._newest[address.place] = connection
            return connection
        finally:
            if not connection.is_open:
                connection.abort(ConnectionLost(f"{address.place} was given up"))


def _destroyed() -> ConnectionLost:
    return ConnectionLost("the node was destroyed", not_executed=True)
