"""The taskrpc programs that an engine sees, and what they offer. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import msgspec

from taskrpc.transport.discovery.entries import RegistryEntry, TrackedEntry

_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(RegistryEntry).decode


class Directory:
    """The entries of the other programs, by place."""

    def __init__(self) -> None:
        self.revision = 0
        """Counts the changes."""
        self._programs: dict[str, TrackedEntry] = {}

    def seen(self, place: str, announced: bytes) -> bool:
        """Add a program, or replace its entry; return whether the announcement is valid."""
        try:
            entry = _decode(announced)
            bytes.fromhex(entry.token)
        except (msgspec.MsgspecError, ValueError):
            return False
        address = place if entry.address else ""
        self._programs[place] = TrackedEntry(msgspec.structs.replace(entry, address=address))
        self.revision += 1
        return True

    def gone(self, place: str) -> bool:
        """Remove a program; return whether it was there."""
        if self._programs.pop(place, None) is None:
            return False
        self.revision += 1
        return True

    def clear(self) -> list[str]:
        """Remove all programs; return their places."""
        places = list(self._programs)
        self._programs.clear()
        self.revision += 1
        return places

    def __contains__(self, place: str) -> bool:
        return place in self._programs

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


def announcement(entry: RegistryEntry, token: bytes) -> bytes:
    """Return what others may see of this program's entry; `token` is empty or no secret.

    The process id and the folder have no meaning on another machine.
    """
    return _encode(
        msgspec.structs.replace(entry, pid=0, folder="", certificate="", token=token.hex())
    )
