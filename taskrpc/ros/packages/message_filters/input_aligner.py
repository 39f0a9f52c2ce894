"""InputAligner: passes the messages of several filters on in the order of their times."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .filters import SimpleFilter

if TYPE_CHECKING:
    from taskrpc.ros.packages.rclpy.duration import Duration
    from taskrpc.ros.packages.rclpy.time import Time
else:
    from rclpy.duration import Duration
    from rclpy.time import Time

_NEVER = 2**63 - 1


@dataclass
class QueueStatus:
    """The state of one input."""

    active: bool
    """Whether the other inputs wait for its next message."""
    queue_size: int
    msgs_processed: int
    msgs_dropped: int


@dataclass
class _Input:
    """The waiting messages of one filter; times are in nanoseconds."""

    output: SimpleFilter = field(default_factory=SimpleFilter)
    period: int = 0
    messages: list[tuple[int, int, Any]] = field(default_factory=list)
    """Time, number and message: a heap, in which messages of one time keep their order."""
    expected: int = _NEVER
    """When its next message is due, if none waits and it is active."""
    active: bool = False
    received: int = 0
    processed: int = 0
    dropped: int = 0

    def first(self) -> int:
        """Return the time of its first message, or the time when that is due."""
        if self.messages:
            first = self.messages[0][0]
            self.expected, self.active = first + self.period, True
            return first
        return self.expected if self.active else _NEVER


class InputAligner(SimpleFilter):
    """Waits for the messages of all inputs, and passes them on in the order of their headers.

    Args:
        timeout: an input whose next message is so late is not waited for.
        inputs: the filters; also with the name `filters`, as one list.
    """

    def __init__(
        self, timeout: Duration, *inputs: SimpleFilter, filters: Sequence[SimpleFilter] = ()
    ) -> None:
        super().__init__()
        self.timeout = timeout
        self.name = ""
        self.lock = threading.Lock()
        self.event_queues: list[_Input] = []
        self.input_connections: list[tuple[SimpleFilter, int]] = []
        self.dispatch_timer: Any = None
        self._newest = self._passed = 0
        if inputs or filters:
            self.connectInput(*inputs, filters=filters)

    def connectInput(self, *inputs: SimpleFilter, filters: Sequence[SimpleFilter] = ()) -> None:
        """Take the messages of these filters instead; earlier callbacks are forgotten."""
        self.disconnectAll()
        connected = [*inputs, *filters]
        with self.lock:
            self.event_queues = [_Input() for _ in connected]
        self.input_connections = [
            (each, each.registerCallback(self.add, index)) for index, each in enumerate(connected)
        ]

    def disconnectAll(self) -> None:
        """Take no more messages of the filters."""
        for each, connection in self.input_connections:
            each.unregisterCallback(connection)
        self.input_connections = []

    def registerCallback(self, index: int, callback: Callable[..., Any], *args: Any) -> int:  # type: ignore[override]
        """Call `callback` with each message of one input and then `args`."""
        return self.event_queues[index].output.registerCallback(callback, *args)

    def setName(self, name: str) -> None:
        """Set the name of this filter."""
        self.name = name

    def getName(self) -> str:
        """The name of this filter."""
        return self.name

    def add(self, msg: Any, queue_index: int) -> None:
        """Take a message of one input; it is dropped if a later one was passed on already."""
        time = Time.from_msg(msg.header.stamp).nanoseconds
        with self.lock:
            queue = self.event_queues[queue_index]
            if time < self._passed:
                queue.dropped += 1
                return
            self._newest = max(self._newest, time)
            heapq.heappush(queue.messages, (time, queue.received, msg))
            queue.received += 1

    def setInputPeriod(self, index: int, period: Duration) -> None:
        """Set the usual time between two messages of an input."""
        self.event_queues[index].period = period.nanoseconds

    def getQueueStatus(self, index: int) -> QueueStatus:
        """The state of an input."""
        queue = self.event_queues[index]
        return QueueStatus(queue.active, len(queue.messages), queue.processed, queue.dropped)

    def setupDispatchTimer(self, node: Any, update_rate: Duration) -> None:
        """Let a timer of the node call `dispatchMessages` again and again."""
        period = update_rate.nanoseconds / 1e9
        self.dispatch_timer = node.create_timer(period, self.dispatchMessages)

    def dispatchMessages(self) -> None:
        """Pass on all messages that need not wait for others."""
        while (found := self._take()) is not None:
            queue, message = found  # without the lock: a callback may add a message
            queue.output.signalMessage(message)

    def _take(self) -> tuple[_Input, Any] | None:
        with self.lock:
            if not any(queue.messages for queue in self.event_queues):
                return None
            while True:
                first = min(self.event_queues, key=_Input.first)
                if first.messages:
                    self._passed, _, message = heapq.heappop(first.messages)
                    first.processed += 1
                    return first, message
                if self._newest - first.first() < self.timeout.nanoseconds:
                    return None
                first.active = False
