"""Fair shares of what callers have in common: connections, calls in flight, bytes of requests."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from functools import lru_cache
from typing import Generic, TypeAlias, TypeVar

_Item = TypeVar("_Item")

QuotaKey: TypeAlias = tuple[str, str]
"""A caller in the quotas: its account, and the address of its machine ("" for this one)."""


def quota_key_of(principal: str, peername: object) -> QuotaKey:
    """The key of a caller; `peername` is the socket address of the other end.

    A whole class may use one account, or the server's own token: so each machine counts for
    itself. The programs of this machine count together.
    """
    if not isinstance(peername, tuple):
        return principal, ""
    return principal, _machine(peername[0])


@lru_cache(1024)  # even a flood of connections comes from few machines
def _machine(host: str) -> str:
    address = ipaddress.ip_address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped  # how a socket for both IP versions shows an IPv4 address
        host = str(address)
    return "" if address.is_loopback else host


def name_of(caller: QuotaKey) -> str:
    """A caller, for logs."""
    account, host = caller
    where = f"the machine {host}" if host else "this machine"
    return f"the account {account} at {where}" if account else where


class FairQuota:
    """A quota that callers share: a caller may take as much as it leaves for the others.

    One caller alone gets half, two get a third each, so some is always left for the next caller.
    """

    __slots__ = ("_taken", "_total", "left")

    def __init__(self, total: int) -> None:
        self._total = total
        self.left = total
        """The amount that is not taken."""
        self._taken: dict[QuotaKey, int] = {}

    def take(self, caller: QuotaKey, amount: int) -> bool:
        """Take more; False, and nothing is taken, if that exceeds the fair share."""
        taken = self._taken.get(caller, 0) + amount
        if taken > self.left - amount:
            return False
        self.left -= amount
        self._taken[caller] = taken
        return True

    def give(self, caller: QuotaKey, amount: int) -> None:
        """Return an amount that was taken."""
        self.left += amount
        self._taken[caller] -= amount
        if not self._taken[caller]:
            del self._taken[caller]


def host_of(peername: object) -> str:
    """The address of the machine at the other end, "" for this one."""
    return quota_key_of("", peername)[1]


class HostQueues(Generic[_Item]):
    """A queue of items for each machine; `pop_next` takes from the machines in turn."""

    __slots__ = ("_count", "_hosts")

    def __init__(self) -> None:
        self._hosts: dict[str, dict[_Item, None]] = {}
        """The items of each machine; the machine whose turn is next comes first."""
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[_Item]:
        for items in self._hosts.values():
            yield from items

    def add(self, host: str, item: _Item) -> None:
        """Add an item behind all others of its machine."""
        self._hosts.setdefault(host, {})[item] = None
        self._count += 1

    def remove(self, host: str, item: _Item) -> bool:
        """Remove an item; return whether it was there."""
        items = self._hosts.get(host, {})
        if item not in items:
            return False
        del items[item]
        self._count -= 1
        if not items:
            del self._hosts[host]
        return True

    def largest(self) -> str:
        """The machine with the most items; "" if there are none."""
        return max(self._hosts, key=lambda host: len(self._hosts[host]), default="")

    def pop_oldest(self, host: str) -> _Item:
        """Remove and return the oldest item of a machine. Raises KeyError if it has none."""
        item = next(iter(self._hosts[host]))
        self.remove(host, item)
        return item

    def pop_next(self) -> _Item:
        """Remove and return the oldest item of the next machine. Raises KeyError if empty."""
        host = next(iter(self._hosts), "")
        item = self.pop_oldest(host)
        if host in self._hosts:
            self._hosts[host] = self._hosts.pop(host)
        return item
