"""What the checks and the supervisor of a sandbox send to each other: JSON, one message a line.

The checks believe nothing of a `Report`: programs of the submission may have sent it.
"""

from __future__ import annotations

import socket
import sys

import msgspec

from taskrpc.course.labs.sandbox.child import Start
from taskrpc.spi import EntryChange, RegistryEntry

LONGEST = 2**20
"""Most bytes of a message."""
_CHUNK = 2**16
_DESCRIPTORS = 3
"""Most descriptors that come with a part of a message."""


class Setup(msgspec.Struct, frozen=True):
    """The first argument of the supervisor.

    Attributes:
        control: the descriptor of the socket over which the messages go.
        base: the folder in which each check gets a folder.
        submission: the folder of the submission.
        confined: whether this is a sandbox.
    """

    control: int
    base: str
    submission: str
    confined: bool


class Begin(msgspec.Struct, frozen=True, tag=True):
    """Begin a check."""


class End(msgspec.Struct, frozen=True, tag=True):
    """End the check: kill its programs, and remove its files."""


class Run(msgspec.Struct, frozen=True, tag=True):
    """Start a program, with the descriptors of its standard streams."""

    start: Start


class Signal(msgspec.Struct, frozen=True, tag=True):
    """Send a signal to a program and its group."""

    pid: int
    number: int


class Publish(msgspec.Struct, frozen=True, tag=True):
    """Publish a change of the checks' own entry in the registry of the sandbox."""

    entry: RegistryEntry
    """The entry before the first change."""
    change: EntryChange


class Socket(msgspec.Struct, frozen=True, tag=True):
    """Make a socket for TCP that can connect within the sandbox."""


Order = Begin | End | Run | Signal | Publish | Socket


class Begun(msgspec.Struct, frozen=True, tag=True):
    """A check has begun; comes with a listening socket and a descriptor of the files' folder."""


class Cleaned(msgspec.Struct, frozen=True, tag=True):
    """The check has ended, and nothing of it is left."""


class Started(msgspec.Struct, frozen=True, tag=True):
    """A program has started."""

    pid: int


class Ended(msgspec.Struct, frozen=True, tag=True):
    """A program has ended."""

    pid: int
    code: int


class Entries(msgspec.Struct, frozen=True, tag=True):
    """The entries of all programs in the registry of the sandbox."""

    entries: list[RegistryEntry]


class Made(msgspec.Struct, frozen=True, tag=True):
    """A socket; comes with its descriptor."""


Report = Begun | Cleaned | Started | Ended | Entries | Made
DESCRIPTORS = {Run: 3, Begun: 2, Made: 1}
"""How many descriptors come with a message."""


if sys.platform != "win32":

    class Reader:
        """Cuts what arrives at a socket into messages with their descriptors.

        The caller owns the descriptors of `descriptors`.
        """

        def __init__(self, sock: socket.socket) -> None:
            self._sock = sock
            self._received = b""
            self.descriptors: list[int] = []

        def read(self) -> list[bytes] | None:
            """Read what there is, as complete messages; None at the end.

            Raises OSError, or ValueError for a message that is too long.
            """
            data, files, _, _ = socket.recv_fds(self._sock, _CHUNK, _DESCRIPTORS)
            self.descriptors += files
            if not data:
                return None
            *lines, self._received = (self._received + data).split(b"\n")
            if len(self._received) > LONGEST:
                raise ValueError(f"a message has more than {LONGEST} bytes")
            return lines

        def take(self, count: int) -> list[int]:
            """Return the oldest descriptors. Raises ValueError if fewer have arrived."""
            if len(self.descriptors) < count:
                raise ValueError(f"expected {count} descriptors, got {len(self.descriptors)}")
            taken, self.descriptors = self.descriptors[:count], self.descriptors[count:]
            return taken
