"""What the checks and a simulating process send to each other: JSON, one message a line.

The checks believe nothing of a `Told`: a program of the submission may have sent it.
"""

from __future__ import annotations

import msgspec


class MessageType(msgspec.Struct, frozen=True):
    """A service type; `text` is its definition, "" for one that comes with taskrpc."""

    name: str
    text: str = ""


class Offered(msgspec.Struct, frozen=True):
    """A service that the checks offer."""

    type: MessageType
    name: str


class Planned(msgspec.Struct, frozen=True):
    """A call that the checks make."""

    type: MessageType
    name: str
    request: bytes
    """CDR."""
    at: float
    """Seconds after the services of all calls are there."""


class Plan(msgspec.Struct, frozen=True):
    """What to simulate besides the submission's program."""

    duration: float
    """Virtual seconds after which the run ends at the latest."""
    service: Offered | None = None
    calls: tuple[Planned, ...] = ()


class Asked(msgspec.Struct, frozen=True, tag=True):
    """A request for the checks' service; answered by a `Reply`."""

    time: float
    """Virtual seconds, as in all messages."""
    request: bytes


class Reply(msgspec.Struct, frozen=True):
    """The response to a request; None if it gets lost."""

    response: bytes | None


class Answered(msgspec.Struct, frozen=True, tag=True):
    """A call of the checks has got its response, or an error."""

    call: int
    """Its place in the plan."""
    began: float
    time: float
    response: bytes | None
    problem: str = ""


class Printed(msgspec.Struct, frozen=True):
    """A line of the program."""

    time: float
    text: str


class Ended(msgspec.Struct, frozen=True, tag=True):
    """The run has ended; the last message."""

    code: int | None
    """The exit code of the program; None if it still ran."""
    lines: list[Printed]
    problem: str
    """What is wrong with the program in the eyes of the simulation, "" for nothing."""
    refused: str
    """What the program used that cannot be simulated, "" for nothing."""


Told = Asked | Answered | Ended
