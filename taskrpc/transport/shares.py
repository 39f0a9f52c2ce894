"""What callers have in common and nobody may take all of: seats, calls in flight, their bytes."""

from __future__ import annotations

import ipaddress
from typing import TypeAlias

Caller: TypeAlias = tuple[str, str]
"""Who calls, where things are divided: the account, and the address of another machine."""


def caller_of(principal: str, peername: object) -> Caller:
    """Between whom things are divided: `peername` is the other end's, as a socket has it.

    One account may be a whole class, and so may be all who have the server's own token: then each
    machine counts for itself. The programs of this machine are one caller.
    """
    if not isinstance(peername, tuple):
        return principal, ""
    host: str = peername[0]
    address = ipaddress.ip_address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped  # as a socket for both versions shows it
        host = str(address)
    return principal, "" if address.is_loopback else host


def name_of(caller: Caller) -> str:
    """A caller, for logs."""
    account, host = caller
    where = f"the machine {host}" if host else "this machine"
    return f"the account {account} at {where}" if account else where


class Shares:
    """So much of something. A caller may have as much of it as is left for the others.

    One alone can take a half, two a third each: there is always some for who comes next.
    """

    __slots__ = ("_taken", "_total", "left")

    def __init__(self, total: int) -> None:
        self._total = total
        self.left = total
        """What nobody has."""
        self._taken: dict[Caller, int] = {}

    def take(self, caller: Caller, amount: int) -> bool:
        """Take more, if it is not too much."""
        taken = self._taken.get(caller, 0) + amount
        if taken > self.left - amount:
            return False
        self.left -= amount
        self._taken[caller] = taken
        return True

    def give(self, caller: Caller, amount: int) -> None:
        """Give back what was taken."""
        self.left += amount
        self._taken[caller] -= amount
        if not self._taken[caller]:
            del self._taken[caller]
