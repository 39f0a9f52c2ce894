"""Datagrams between taskrpc programs, and their presence, over hidden topics of ROS 2.

Each program has an id, and a node `_taskrpc_<id>` with two topics:

- `/_taskrpc/inbox_<id>`: what others send to this program.
- `/_taskrpc/program_<id>`: its entry, latched. DDS reports to the others when this publisher
  vanishes, or is silent for `LEASE` seconds because the program was killed or its machine is gone.
"""

from __future__ import annotations

import logging
import re
from collections import deque
from collections.abc import Iterable
from typing import Any

from taskrpc.middleware.ros import bytes_message, qualities
from taskrpc.spi import EngineEvents, Handoff

log = logging.getLogger("taskrpc.transport")

NODE = "_taskrpc_"
"""The beginning of the node names; ROS hides names with an underscore."""
_ADDRESS = "ros/"
_ID = re.compile(r"[0-9a-f]{16}")
LEASE = 4.0
"""Seconds after which a silent program counts as gone."""
_MOST_WAITING = 1000
"""Datagrams for one program that wait until DDS has connected the topic."""
_MOST_EARLY = 100
"""Datagrams for programs that are not in the graph yet."""


def id_of_node(name: str) -> str:
    """Return the id of the program whose node this is, "" for other nodes."""
    found = name.removeprefix(NODE)
    return found if found != name and _ID.fullmatch(found) else ""


def address_of(program: str) -> str:
    """Return the address of a program."""
    return _ADDRESS + program


class ProgramLinks:
    """The connections of one program to the others; used on the event loop only."""

    def __init__(self, ros: Any, message_class: Any, handoff: Handoff) -> None:
        self._ros = ros
        self._class = message_class
        self._handoff = handoff
        self._id = ""
        self._node: Any = None
        self._events: EngineEvents | None = None
        """None before `open` and after `close`."""
        self._announcer: Any = None
        self._programs: dict[str, _Program] = {}
        """The other programs by id."""
        self._early: deque[tuple[str, bytes]] = deque(maxlen=_MOST_EARLY)
        """Responses to programs whose datagrams arrived before this program saw their nodes."""

    def open(self, node: Any, own_id: str, events: EngineEvents) -> None:
        """Create the topics of this program on its hidden node."""
        self._node, self._id, self._events = node, own_id, events
        self._announcer = node.create_publisher(
            self._class, f"/_taskrpc/program_{own_id}", qualities.presence_profile(self._ros, LEASE)
        )
        node.create_subscription(
            self._class,
            f"/_taskrpc/inbox_{own_id}",
            lambda body: self._handoff.put(self._received, body),
            qualities.lossless_profile(self._ros),
            raw=True,
        )

    def close(self) -> list[Any]:
        """Send and report nothing any more; return the publishers with the last datagrams."""
        self._events = None
        senders = [each.sender for each in self._programs.values() if each.sender is not None]
        self._programs.clear()
        self._early.clear()
        return senders

    @property
    def awaited(self) -> list[str]:
        """The programs that were seen, but have not sent their entry yet."""
        return [key for key, each in self._programs.items() if each.entry is None]

    def announce(self, entry: bytes) -> None:
        """Show this program's entry to all others, also later ones."""
        if self._events is not None:
            self._announcer.publish(bytes_message.pack(entry))

    def send(self, address: str, datagram: bytes) -> None:
        """Send a datagram; it waits until DDS has connected the two programs."""
        if self._events is None:
            return
        key = address.removeprefix(_ADDRESS)
        program = self._programs.get(key)
        if program is not None:
            program.send(datagram)
        elif key == self._id:
            self._handoff.put(self._deliver, datagram)
        elif _ID.fullmatch(key):
            self._early.append((key, datagram))

    def look(self, nodes: Iterable[str]) -> None:
        """Compare the known programs with the names of all nodes in ROS's graph."""
        present = {found for each in nodes if (found := id_of_node(each))}
        present.discard(self._id)
        for gone in self._programs.keys() - present:
            program = self._programs.pop(gone)
            program.close()
            if program.is_reported:
                self._report_gone(gone)
        for new in present - self._programs.keys():
            self._programs[new] = program = _Program(self, new)
            for datagram in [each for key, each in self._early if key == new]:
                program.send(datagram)
        waiting = [each for each in self._early if each[0] not in present]
        self._early = deque(waiting, maxlen=_MOST_EARLY)

    # For _Program

    def create_sender(self, program: str, on_matched: Any) -> Any:
        """Create the publisher for a program's inbox."""
        return self._node.create_publisher(
            self._class,
            f"/_taskrpc/inbox_{program}",
            qualities.lossless_profile(self._ros),
            event_callbacks=self._ros.event_handler.PublisherEventCallbacks(
                matched=lambda _: self._handoff.put(on_matched)
            ),
        )

    def create_watch(self, program: str, on_entry: Any, on_alive: Any) -> Any:
        """Create the subscription of a program's entry."""
        return self._node.create_subscription(
            self._class,
            f"/_taskrpc/program_{program}",
            lambda body: self._handoff.put(on_entry, body),
            qualities.presence_profile(self._ros, LEASE),
            raw=True,
            event_callbacks=self._ros.event_handler.SubscriptionEventCallbacks(
                liveliness=lambda status: self._handoff.put(on_alive, status.alive_count > 0)
            ),
        )

    def destroy(self, sender: Any, watch: Any) -> None:
        """Destroy what was created for a program."""
        self._node.destroy_subscription(watch)
        if sender is not None:
            self._node.destroy_publisher(sender)

    def report(self, program: _Program) -> None:
        """Report that a program is there, with its entry, or that it is gone."""
        if self._events is None:
            return
        if program.is_alive and program.entry is not None:
            program.is_reported = True
            self._events.program_seen(address_of(program.id), program.entry)
        elif program.is_reported:
            program.is_reported = False
            self._report_gone(program.id)

    def _report_gone(self, program: str) -> None:
        if self._events is not None:
            self._events.program_gone(address_of(program))

    def _received(self, body: bytes) -> None:
        datagram = bytes_message.unpack(body)
        # The tunnel ignores and reports garbage; so b"" stands for a message of another kind.
        self._deliver(datagram or b"")

    def _deliver(self, datagram: bytes) -> None:
        if self._events is not None:
            self._events.received(datagram)


class _Program:
    """Another taskrpc program."""

    def __init__(self, links: ProgramLinks, program: str) -> None:
        self.id = program
        self.entry: bytes | None = None
        self.is_alive = True
        self.is_reported = False
        self._links = links
        self._watch = links.create_watch(program, self._announced, self._alive)
        self.sender: Any = None
        """The publisher for its inbox; None until something is sent."""
        self._waiting: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._is_matched = False
        self._is_closed = False

    def send(self, datagram: bytes) -> None:
        """Send a datagram."""
        if self._is_matched:
            self._publish(datagram)
            return
        self._waiting.append(datagram)
        if self.sender is None:
            self.sender = self._links.create_sender(self.id, self._matched)
        self._matched()

    def close(self) -> None:
        """Forget the program."""
        self._is_closed = True
        self._links.destroy(self.sender, self._watch)

    def _matched(self) -> None:
        if self._is_closed:
            return
        self._is_matched = self.sender.get_subscription_count() > 0
        while self._is_matched and self._waiting:
            self._publish(self._waiting.popleft())

    def _publish(self, datagram: bytes) -> None:
        try:
            self.sender.publish(bytes_message.pack(datagram))
        except Exception as error:  # The queue is full. The tunnel notices the missing datagram.
            log.warning("cannot send to the program %s: %s", self.id, error)

    def _announced(self, body: bytes) -> None:
        entry = bytes_message.unpack(body)
        if not self._is_closed and entry is not None:
            self.entry = entry
            self._links.report(self)

    def _alive(self, is_alive: bool) -> None:
        if not self._is_closed:
            self.is_alive = is_alive
            self._links.report(self)
