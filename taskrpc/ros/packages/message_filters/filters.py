"""The filters: each passes messages on to callbacks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.time import Time

from . import matching


class SimpleFilter:
    """Passes messages to callbacks; the base of all filters."""

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., Any], *args: Any) -> int:
        """Call `cb` with each output of this filter and then `args`; return a number for it."""
        connection = max(self.callbacks, default=-1) + 1
        self.callbacks[connection] = (cb, args)
        return connection

    def unregisterCallback(self, conn: int) -> None:
        """Remove a callback by its number, if it is registered."""
        self.callbacks.pop(conn, None)

    def signalMessage(self, *msg: Any) -> None:
        """Call all callbacks."""
        for callback, args in list(self.callbacks.values()):
            callback(*msg, *args)


class Subscriber(SimpleFilter):
    """Passes on the messages of a topic.

    Args:
        args: the node, the type and the topic.
        kwargs: further arguments of `create_subscription`; the default of `qos_profile` is 10.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__()
        if len(args) < 3 or not hasattr(args[0], "create_subscription"):
            given = ", ".join(type(each).__name__ for each in args)
            raise TypeError(f"expected Subscriber(node, type, topic), got Subscriber({given})")
        self.node, _, self.topic = args[:3]
        kwargs.setdefault("qos_profile", 10)
        self.sub = self.node.create_subscription(*args[1:], self.callback, **kwargs)

    def callback(self, msg: Any) -> None:
        """Pass on a message."""
        self.signalMessage(msg)

    def getTopic(self) -> str:
        """The topic, as given."""
        return str(self.topic)

    def __getattr__(self, name: str) -> Any:
        if name == "sub":  # it does not exist before `create_subscription` returns
            raise AttributeError(name)
        return getattr(self.sub, name)


class Cache(SimpleFilter):
    """Keeps the last messages of a filter, and passes each on.

    Args:
        f: the filter.
        cache_size: how many messages are kept.
        allow_headerless: whether a message without a header gets the time of its arrival;
            otherwise it is ignored with a warning.
    """

    def __init__(self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False):
        super().__init__()
        self.cache_size = cache_size
        self.cache_msgs: list[Any] = []
        self.cache_times: list[Time] = []
        self.allow_headerless = allow_headerless
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:
        """Keep the messages of another filter too."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Keep a message and pass it on."""
        stamp = _stamp(msg, self.allow_headerless)
        if stamp is None:
            return
        self.cache_times.append(stamp)
        self.cache_msgs.append(msg)
        if len(self.cache_msgs) > self.cache_size:
            del self.cache_msgs[0], self.cache_times[0]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:
        """The messages between two times, which are included."""
        assert from_stamp <= to_stamp
        return self._with(lambda time: from_stamp <= time <= to_stamp)

    def getElemAfterTime(self, stamp: Time) -> Any:
        """The first message at a time or after it, or None."""
        return next(iter(self._with(lambda time: time >= stamp)), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """The last message at a time or before it, or None."""
        return next(reversed(self._with(lambda time: time <= stamp)), None)

    def getLastestTime(self) -> Time | None:
        """The time of the last message, or None; the name is ROS's own."""
        return self.cache_times[-1] if self.cache_times else None

    def getOldestTime(self) -> Time | None:
        """The time of the first message, or None."""
        return self.cache_times[0] if self.cache_times else None

    def getLast(self) -> Any:
        """The last message, or None."""
        last = self.getLastestTime()
        return None if last is None else self.getElemAfterTime(last)

    def _with(self, wanted: Callable[[Time], bool]) -> list[Any]:
        pairs = zip(self.cache_msgs, self.cache_times, strict=True)
        return [message for message, time in pairs if wanted(time)]


class Chain(SimpleFilter):
    """Filters in a row: each gets the output of the one before."""

    def __init__(self, message_filter: SimpleFilter | None = None) -> None:
        super().__init__()
        self.incoming_connection: int | None = None
        self._filters: list[tuple[Any, int]] = []
        if message_filter is not None:
            self.connectInput(message_filter)

    def connectInput(self, message_filter: SimpleFilter) -> None:
        """Take the messages of a filter; possible only once."""
        if self.incoming_connection is not None:
            raise RuntimeError("Already connected")
        self.incoming_connection = message_filter.registerCallback(self.add)

    def add(self, message: Any) -> None:
        """Pass a message through all filters."""
        if self._filters:
            self._filters[0][0].add(message)
        else:
            self.signalMessage(message)

    def addFilter(self, message_filter: Any) -> None:
        """Add a filter at the end; it has a method `add`."""
        if self._filters:
            last, connection = self._filters[-1]
            del last.callbacks[connection]
            self._filters[-1] = (last, last.registerCallback(message_filter.add))
        connection = message_filter.registerCallback(self.signalMessage)
        self._filters.append((message_filter, connection))

    def getFilter(self, index: int) -> Any:
        """The filter at a place, from 0."""
        return self._filters[index][0]


class TimeSynchronizer(SimpleFilter):
    """Passes on one message of each filter, all with the same time in their headers.

    Args:
        fs: the filters.
        queue_size: how many messages of each filter may wait.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.lock = threading.Lock()
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:
        """Take the messages of these filters instead."""
        self.queues: list[matching.Queue] = [{} for _ in fs]
        self.input_connections = [
            one.registerCallback(self.add, self.queues[index], index)
            for index, one in enumerate(fs)
        ]

    def add(self, msg: Any, my_queue: matching.Queue, my_queue_index: int | None = None) -> None:
        """Take a message of one filter."""
        with self.lock:
            time = Time.from_msg(msg.header.stamp).nanoseconds
            matching.put(my_queue, time, msg, self.queue_size)
            found = list(matching.take_equal(self.queues))
        for messages in found:  # without the lock: a callback may pass a message to this filter
            self.signalMessage(*messages)


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Passes on one message of each filter, with nearly the same time in their headers.

    Args:
        fs: the filters.
        queue_size: how many messages of each filter may wait.
        slop: the times of a set differ by less than so many seconds.
        allow_headerless: as in `Cache`.
    """

    def __init__(
        self,
        fs: Sequence[SimpleFilter],
        queue_size: int,
        slop: float,
        allow_headerless: bool = False,
    ) -> None:
        self.slop = Duration(seconds=slop)
        self.allow_headerless = allow_headerless
        super().__init__(fs, queue_size)

    def add(self, msg: Any, my_queue: matching.Queue, my_queue_index: int | None = None) -> None:
        """Take a message of one filter."""
        stamp = _stamp(msg, self.allow_headerless)
        if stamp is None:
            return
        if my_queue_index is None:
            my_queue_index = next(n for n, each in enumerate(self.queues) if each is my_queue)
        time, slop = stamp.nanoseconds, self.slop.nanoseconds
        with self.lock:
            matching.put(my_queue, time, msg, self.queue_size)
            is_kept = time in my_queue  # not if it is older than all that fit into the queue
            found = matching.take_near(self.queues, time, my_queue_index, slop) if is_kept else ()
        if found:
            self.signalMessage(*found)


def _stamp(message: Any, allow_headerless: bool) -> Time | None:
    """Return the time in a message's header; None, after a warning, if there is no header."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None:
        return stamp if hasattr(stamp, "nanoseconds") else Time.from_msg(stamp)
    if allow_headerless:
        return ROSClock().now()
    get_logger("message_filters").warning(
        f"ignored a {type(message).__name__}, because it has no header with a time;"
        " allow_headerless=True gives it the time of its arrival"
    )
    return None
