"""What happened in a run: events with virtual times, and their hash; pure."""

from __future__ import annotations

from hashlib import blake2b
from typing import Literal

import msgspec

Kind = Literal[
    "start",
    "print",
    "call",
    "answer",
    "error",
    "begin",
    "cancel",
    "message",
    "fault",
    "crash",
    "end",
    "raise",
]
"""What happens: a program starts, prints a line, makes a call, gets the response or an error; its
service begins to handle a request, or cancels that; it publishes a message; a fault; it is killed;
it ends, or ends with an exception."""


class Event(msgspec.Struct, frozen=True):
    """One event."""

    time: float
    """Virtual seconds since the begin of the run."""
    program: str
    kind: Kind
    text: str
    """What happened, in words: the printed line, the service, the fault."""
    where: str = ""
    """The file and line of the program, such as `client.py:12`; "" where it is not known."""


class Trace:
    """The events of a run, in their order."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def add(self, event: Event) -> None:
        """Add an event."""
        self.events.append(event)

    def hash(self) -> str:
        """Return a hash of all events: runs with the same hash went the same way."""
        data = msgspec.msgpack.encode(
            [(each.time, each.program, each.kind, each.text) for each in self.events]
        )
        return blake2b(data, digest_size=8).hexdigest()

    def shape(self) -> int:
        """Return a hash of what happened in which order, without the times."""
        data = msgspec.msgpack.encode(
            [(each.program, each.kind, each.text) for each in self.events]
        )
        return int.from_bytes(blake2b(data, digest_size=8).digest())
