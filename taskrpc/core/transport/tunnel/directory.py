"""The taskrpc programs that an engine sees, and what they offer. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import msgspec

from taskrpc.core.transport.discovery.entries import RegistryEntry, TrackedEntry
from taskrpc.core.wire import messages
from taskrpc.core.wire.messages import Listing, Name

MAX_SCRIPT = 200
"""Characters of a script's name in a presence."""


class Presence(msgspec.Struct, array_like=True):
    """What a program shows to all others; a msgpack array. Later versions may append fields."""

    script: Name
    since: float
    """When the program started, in seconds since 1970."""
    accepts: bool
    """Whether it accepts calls."""
    token: bytes
    """The token that it expects from all callers; b"" if the token is a secret."""
    names: Listing
    revision: int = 0
    """Counts the presences of the program: a middleware may deliver an old one after a new one."""


_decode = messages.decoder(Presence)


class Directory:
    """The entries of the other programs, by address."""

    def __init__(self) -> None:
        self._programs: dict[str, TrackedEntry] = {}
        self._revisions: dict[str, tuple[float, int]] = {}
        """When the program at an address started, and the revision of its entry."""

    def seen(self, address: str, presence: bytes) -> None:
        """Add a program, or replace its entry by a newer one.

        Raises ProtocolError for an invalid presence.
        """
        shown = _decode(presence)
        since, revision = self._revisions.get(address, (shown.since, shown.revision))
        if shown.since == since and shown.revision < revision:
            return
        self._revisions[address] = shown.since, shown.revision
        self._programs[address] = TrackedEntry(_entry_of(shown, address))

    def gone(self, address: str) -> bool:
        """Remove a program; return whether it was there."""
        self._revisions.pop(address, None)
        return self._programs.pop(address, None) is not None

    def clear(self) -> None:
        """Remove all programs."""
        self._programs.clear()
        self._revisions.clear()

    def __contains__(self, address: str) -> bool:
        return address in self._programs

    def serving(self, service: str) -> Iterator[TrackedEntry]:
        """The programs that offer a service and accept calls."""
        return (
            each for each in self._programs.values() if each.about.address and each.offers(service)
        )

    def publishing(self, topics: Collection[str]) -> Iterator[tuple[TrackedEntry, list[str]]]:
        """The programs that publish some of these topics, with the topics."""
        for each in self._programs.values():
            there = [topic for topic in topics if each.publishes(topic)]
            if there and each.about.address:
                yield each, there

    def entries(self) -> list[RegistryEntry]:
        """The entries of all programs."""
        return [each.entry() for each in self._programs.values()]


def entry_in(presence: bytes, address: str) -> RegistryEntry:
    """Return the entry of the program at an address. Raises ProtocolError for garbage."""
    return _entry_of(_decode(presence), address)


def _entry_of(shown: Presence, address: str) -> RegistryEntry:
    return RegistryEntry(
        pid=0,
        script=shown.script,
        folder="",
        since=shown.since,
        address=address if shown.accepts else "",
        token=shown.token.hex(),
        nodes=tuple(shown.names.nodes),
        services=tuple(shown.names.services),
        clients=tuple(shown.names.clients),
        publishers=tuple(shown.names.publishers),
        subscriptions=tuple(shown.names.subscriptions),
    )


def presence_of(entry: RegistryEntry, token: bytes, revision: int) -> bytes:
    """Return what others may see of this program; `token` is empty or no secret."""
    script = "".join(each if each.isprintable() else "?" for each in entry.script[:MAX_SCRIPT])
    names = Listing(
        list(entry.nodes),
        list(entry.services),
        list(entry.clients),
        list(entry.publishers),
        list(entry.subscriptions),
    )
    return messages.encode(
        Presence(script, entry.since, bool(entry.address), token, names, revision)
    )
