"""Reads the statistics of other programs, for `Node.statistics` and `taskrpc top`."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from taskrpc.core.transport.base import ProgramStatistics
from taskrpc.core.transport.connection.dialling import Dialler, why_silent
from taskrpc.core.transport.discovery.entries import RegistryEntry, entry_of
from taskrpc.core.transport.network import Address, Network
from taskrpc.core.wire.messages import STATISTICS, Listing, Resolve
from taskrpc.core.wire.statistics import Statistics
from taskrpc.errors import DeadlineExceeded, TaskRpcError


async def read_statistics(
    network: Network, dialler: Dialler, entries: Iterable[RegistryEntry], timeout: float
) -> list[ProgramStatistics]:
    """Return the statistics of the programs of these entries, and of the network's peers.

    `timeout`: seconds for all programs together. A program that does not answer has a `problem`.
    """
    deadline = asyncio.get_running_loop().time() + timeout
    reader = _Reader(dialler, deadline)
    here = [reader.of_entry(entry, network) for entry in entries]
    return await asyncio.gather(*here, *map(reader.of_peer, network.peers()))


class _Reader:
    """Asks programs until a deadline, on the event loop's clock."""

    def __init__(self, dialler: Dialler, deadline: float) -> None:
        self._dialler = dialler
        self._deadline = deadline

    async def of_entry(self, entry: RegistryEntry, network: Network) -> ProgramStatistics:
        """Ask a program whose services and nodes are known."""
        address = network.address_of(entry)
        if not entry.address:
            return ProgramStatistics(entry, None, why_silent(address))
        try:
            return ProgramStatistics(entry, await self._statistics(address))
        except TaskRpcError as error:
            return ProgramStatistics(entry, None, _why_unmeasured(address, error))

    async def of_peer(self, address: Address) -> ProgramStatistics:
        """Ask a program for its services and nodes too."""
        entry = entry_of(address.text, Listing([], [], []))
        try:
            connection = await self._dialler.connection(address, self._deadline)
            listing = await connection.resolve(Resolve(""), self._deadline).future
            entry = entry_of(address.text, listing)
            return ProgramStatistics(entry, await self._statistics(address))
        except TaskRpcError as error:
            return ProgramStatistics(entry, None, _why_unmeasured(address, error))

    async def _statistics(self, address: Address) -> Statistics:
        connection = await self._dialler.connection(address, self._deadline)
        found: Statistics = await connection.resolve(Resolve(STATISTICS), self._deadline).future
        return found


def _why_unmeasured(address: Address, error: TaskRpcError) -> str:
    if silent := why_silent(address):
        return silent
    return "it did not respond in time" if isinstance(error, DeadlineExceeded) else str(error)
