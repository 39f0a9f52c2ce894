"""The event stream of the live page: `GET /live`, one bounded buffer for each open page (tab).

The bytes of an event are made once for all tabs. A tab that reads gets them at once. For a tab that
does not read, its buffer keeps only the newest state of each event and the newest calls; it costs
no further work, and after `MAX_UNREAD_SECONDS` its connection is closed. No aiohttp here: the
server gives each tab a connection to write to.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import msgspec

log = logging.getLogger("taskrpc.web")

MAX_TABS = 128
"""Most open tabs; a further one is refused."""
MAX_CALLS = 100
"""Most calls in one event, and in the buffer of one tab."""
MAX_UNREAD_SECONDS = 30.0
"""Seconds after which a tab that does not read is closed."""
SIGN_OF_LIFE = 10.0
"""Seconds between two comment lines, by which a tab recognises a lost connection."""
UNREAD_BYTES = 65_536
"""Unread bytes of a tab from which on its events wait in its buffer."""


class Event(msgspec.Struct, frozen=True, eq=False):
    """The newest state of one thing: a later event of the same name replaces it."""

    name: str
    json: bytes

    @property
    def text(self) -> bytes:
        """The event as a stream of server-sent events contains it."""
        return framed(self.name, self.json)


class CallsEvent(msgspec.Struct, frozen=True, eq=False):
    """Calls since the last event; a later event does not replace it."""

    calls: Sequence[bytes]
    """Each call as JSON, oldest first."""
    skipped: int
    """How many older calls are missing."""
    stats: bytes
    """The statistics as JSON."""

    @property
    def text(self) -> bytes:
        """The event as a stream of server-sent events contains it."""
        calls = b",".join(self.calls)
        skipped = b"%d" % self.skipped
        json = b'{"calls":[%s],"skipped":%s,"stats":%s}' % (calls, skipped, self.stats)
        return framed("calls", json)


def framed(name: str, json: bytes) -> bytes:
    """Return an event as server-sent events are written; `json` must not contain line breaks."""
    return b"event: %s\ndata: %s\n\n" % (name.encode(), json)


class TabBuffer:
    """The events that a tab has not received: the newest state of each name, the newest calls."""

    def __init__(self) -> None:
        self._states: dict[str, Event] = {}
        self._calls: deque[bytes] = deque(maxlen=MAX_CALLS)
        self._skipped = 0
        self._stats = b""

    def put(self, event: Event | CallsEvent) -> None:
        """Add an event."""
        if isinstance(event, Event):
            self._states.pop(event.name, None)  # the order of events is the order of their changes
            self._states[event.name] = event
            return
        surplus = len(self._calls) + len(event.calls) - MAX_CALLS
        self._skipped += event.skipped + max(0, surplus)
        self._calls.extend(event.calls)
        self._stats = event.stats

    def take(self) -> bytes:
        """Return everything in the buffer as text and empty it; b"" if there is nothing."""
        texts = [event.text for event in self._states.values()]
        if self._stats:
            texts.append(CallsEvent(tuple(self._calls), self._skipped, self._stats).text)
        self._states.clear()
        self._calls.clear()
        self._skipped, self._stats = 0, b""
        return b"".join(texts)


class TabConnection(Protocol):
    """The part of a tab's HTTP connection that its stream needs."""

    def write(self, data: bytes) -> None:
        """Send bytes as a part of the response."""

    def abort(self) -> None:
        """Close the connection at once."""


class Tab:
    """One open page. Its connection calls `pause` and `resume`, and `close` at its end."""

    def __init__(self, connection: TabConnection, now: Callable[[], float]) -> None:
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Resolved when the stream or the connection has ended."""
        self.paused_at: float | None = None
        """When the tab stopped reading, on the loop's clock; None while it reads."""
        self.buffer = TabBuffer()
        """The events since then."""
        self._connection = connection
        self._now = now

    def send(self, data: bytes) -> None:
        """Write bytes that all reading tabs share; the tab must not be paused."""
        self._connection.write(data)

    def pause(self) -> None:
        """Collect events instead of sending them: too many bytes are unread."""
        if self.paused_at is None:
            self.paused_at = self._now()

    def resume(self) -> None:
        """Send the collected events, and later ones at once."""
        self.paused_at = None
        if data := self.buffer.take():
            self._connection.write(chunk(data))

    def abort(self) -> None:
        """Close the connection of a tab that does not read."""
        self._connection.abort()

    def close(self) -> None:
        """Note that the stream or the connection has ended."""
        if not self.closed.done():
            self.closed.set_result(None)


class Source(Protocol):
    """What publishes the events; it works only while tabs are open."""

    def begin(self) -> None:
        """The first tab opens: publish all states now, and their changes from now on."""

    def end(self) -> None:
        """The last tab has closed."""


class TooManyTabs(Exception):
    """`MAX_TABS` pages are open."""


class LiveStream:
    """Sends the events of a source to all open tabs."""

    def __init__(self) -> None:
        self.source: Source | None = None
        """Set it before the first tab opens."""
        self._tabs: dict[Tab, None] = {}
        self._states: dict[str, Event | CallsEvent] = {}
        """The newest event of each name, for new tabs; of calls only the statistics."""
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._tabs)

    def publish(self, events: Iterable[Event | CallsEvent]) -> None:
        """Send events to all tabs; tabs that do not read get the newest ones later."""
        found = list(events)
        if not found:
            return
        for event in found:
            if isinstance(event, Event):
                self._states[event.name] = event
            else:
                self._states["calls"] = CallsEvent((), 0, event.stats)
        data = b""
        for tab in self._tabs:
            if tab.paused_at is not None:
                for event in found:
                    tab.buffer.put(event)
                continue
            data = data or chunk(b"".join(event.text for event in found))
            tab.send(data)

    def open(self, connection: TabConnection) -> tuple[Tab, bytes]:
        """Add a tab; returns it with the text of all states, which it must get first.

        Raises TooManyTabs.
        """
        if len(self._tabs) >= MAX_TABS:
            raise TooManyTabs
        loop = asyncio.get_running_loop()
        if not self._tabs:
            self._states.clear()
            if self.source is not None:
                self.source.begin()
            self._timer = loop.call_later(SIGN_OF_LIFE, self._live_on)
        tab = Tab(connection, loop.time)
        self._tabs[tab] = None
        tab.closed.add_done_callback(lambda _: self._remove(tab))
        return tab, b"".join(event.text for event in self._states.values())

    def close(self, reason: str) -> None:
        """Send `ending` and end all streams."""
        self.publish([Event("ending", msgspec.json.encode({"reason": reason}))])
        for tab in list(self._tabs):
            tab.close()

    def _remove(self, tab: Tab) -> None:
        self._tabs.pop(tab, None)
        if not self._tabs and self._timer is not None:
            self._timer.cancel()
            self._timer = None
            if self.source is not None:
                self.source.end()

    def _live_on(self) -> None:
        """Send a comment line to all tabs, and close the tabs that do not read."""
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(SIGN_OF_LIFE, self._live_on)
        comment = chunk(b":\n\n")
        for tab in list(self._tabs):
            if tab.paused_at is None:
                tab.send(comment)
            elif loop.time() - tab.paused_at >= MAX_UNREAD_SECONDS:
                log.debug("closed a live page that did not read for %.0f s", MAX_UNREAD_SECONDS)
                tab.abort()


def chunk(data: bytes) -> bytes:
    """Return data as one chunk of an HTTP/1.1 response of unknown length."""
    return b"%x\r\n%s\r\n" % (len(data), data)
