"""Checks once a second for work that waits for ever.

Only a view of all nodes shows such work; no client, service or executor could notice it alone.
"""

from __future__ import annotations

import asyncio
import atexit
import linecache
import sys
import sysconfig
import threading
import time
import weakref
from collections.abc import Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any

from ...callback_groups import MutuallyExclusiveCallbackGroup
from ..execution.entity import (
    Callback,
    callback_name,
    is_busy,
    node_name,
    running,
)
from ..node_interface import NodeInterface
from . import explain
from .deadlocks import callers, clients_of, obstacle, services_of

_PERIOD = 1.0
"""Seconds between two checks."""
_SOON = 2.0
"""Seconds after which a wait that can hardly end is reported."""
_LATE = 5.0
"""Seconds after which a wait that may only be late is reported."""
_STUCK = 15.0
"""Seconds after which a callback that has not returned is reported."""
_LIBRARIES = (str(Path(__file__).parents[5]), sysconfig.get_path("stdlib"))
"""Folders whose code is not the program's own: taskrpc and the standard library."""

_Wait = tuple[tuple[object, ...], float, Any]
"""A wait that is reported if it lasts: its identity, the seconds until then, and the function that
reports it."""

_nodes: weakref.WeakKeyDictionary[NodeInterface, None] = weakref.WeakKeyDictionary()
_never_spun: dict[str, list[str]] = {}
"""The nodes that ended with callbacks that could not run, and the services of each."""
_lock = threading.Lock()
_is_running = False
"""Whether the check repeats on the background loop."""


def watch(node: NodeInterface) -> None:
    """Check a node until it is destroyed."""
    global _is_running
    if explain.like_ros():
        return
    with _lock:
        _nodes[node] = None
        begin, _is_running = not _is_running, True
    if begin:
        node.handle.bridge.soon(_Check().again)


def ends(node: NodeInterface) -> None:
    """Report the pending calls of a node that no thread spins; at the end of the node.

    A node with callbacks that no thread has ever spun is reported at the end of the program.
    """
    pending = sorted({client.service_name for client in clients_of(node) if _is_observed(client)})
    if pending and node.executor is None and not node.context.was_interrupted:
        _report_unspun(node, f"complete the future of a call of {', '.join(pending)}")
    elif _was_never_spun(node) and (_offered(node) or _has_other_callbacks(node)):
        _never_spun[node.get_name()] = _offered(node)


def _was_never_spun(node: NodeInterface) -> bool:
    """Whether no thread has spun a node that ends, and neither a signal nor an error ended it."""
    is_forced = node.context.was_interrupted or sys.exc_info()[1] is not None
    return not (node.handle.was_spun or is_forced)


def _offered(node: NodeInterface) -> list[str]:
    """The services that the program has created; every node has some more."""
    return [
        each.service_name
        for each in services_of(node)
        if not (each.is_of_every_node or each.srv_type._TYPE.startswith("lifecycle_msgs/"))
    ]


def _has_other_callbacks(node: Any) -> bool:
    heard = [one for one in node.subscriptions if one.topic_name != "/clock"]  # of simulated time
    return bool(heard or list(node.timers))


class _Check:
    """The repeated check, on the thread of the background loop."""

    def __init__(self) -> None:
        self._seen: dict[tuple[object, ...], float] = {}
        """When each present wait was first seen, on the clock of `time.monotonic()`."""

    def again(self) -> None:
        """Check, and check again after a while, as long as there are nodes."""
        global _is_running
        with _lock:
            nodes = [node for node in list(_nodes) if node.handle.valid]
            _is_running = bool(nodes)
        if nodes:
            self._look(nodes)
            asyncio.get_running_loop().call_later(_PERIOD, self.again)

    def _look(self, nodes: list[NodeInterface]) -> None:
        """Report what has waited long enough, and forget what has ended."""
        now = time.monotonic()
        for thread, callback in list(running.items()):
            if now - callback.since >= _STUCK and _delays_others(callback):
                _report_stuck(thread, callback)
        waits = chain(_full_pools(), chain.from_iterable(map(_waits, nodes)))
        found = {what: (patience, report) for what, patience, report in waits}
        self._seen = {what: self._seen.get(what, now) for what in found}
        for what, (patience, report) in found.items():
            if now - self._seen[what] >= patience:
                report()


def _waits(node: NodeInterface) -> Iterator[_Wait]:
    """The waits at the clients and services of a node."""
    busy = is_busy(node.executor)
    for client in clients_of(node):
        if busy:
            yield from _polling_deadlock(client)
        elif client.has_work():
            yield from _untaken_response(client)
        if client.waits_for_server:
            what: tuple[object, ...] = ("unoffered", client)
            yield what, _SOON, lambda client=client: _report_unoffered(client)
    for service in services_of(node):
        if service.has_work() and not busy:
            yield from _untaken_request(service)


def _full_pools() -> Iterator[_Wait]:
    """Executors whose threads all wait for responses that one of these threads must take."""
    for executor, calls in callers().items():
        if 1 < executor.thread_count <= len(calls):
            named = [(client.service_name, callback_name(callback)) for client, callback in calls]
            report = partial(explain.pool_exhausted, named)
            yield ("pool", executor, *(id(callback) for _, callback in calls)), _SOON, report


def _delays_others(callback: Callback) -> bool:
    """Whether something waits that would run if this callback returned."""
    executor, own = callback.executor, callback.entity
    group = None if own is None else own.callback_group
    if not executor.runs_one_at_a_time and not isinstance(group, MutuallyExclusiveCallbackGroup):
        return False
    return any(
        entity.has_work() and not (entity is own and entity.is_timer)
        for node in executor.get_nodes()
        for entity, _ in executor.entities_of(node)
        if executor.runs_one_at_a_time or entity.callback_group is group
    )


def _polling_deadlock(client: Any) -> Iterator[_Wait]:
    """Futures that a callback polls while the callback itself prevents their completion."""
    for future in client.pending_futures:
        callback, last = future.last_poll
        if callback is None or time.monotonic() - last > _PERIOD:
            continue
        if not any(each is callback for each in list(running.values())):
            continue
        if why := obstacle(client, callback):
            report = partial(
                explain.polling_deadlock, client.service_name, callback_name(callback), why
            )
            yield ("polled", client, id(callback)), _SOON, report


def _untaken_response(client: Any) -> Iterator[_Wait]:
    try:
        number, future = client.oldest_response()
    except LookupError:  # another thread took it
        return
    what = ("untaken", client, number)
    thing = f"the future of a call of {client.service_name}"
    holder = _group_holder(client)
    if holder is None:
        if future.is_observed:
            asked = time.monotonic() - future.last_poll[1] <= _PERIOD
            patience = _LATE if asked else _patience(client.parent_node)
            yield what, patience, lambda: _report_unspun(client.parent_node, f"complete {thing}")
    elif future.awaited_by is not None and future.awaited_by.entity is holder:
        yield what, _SOON, lambda: _report_held(client, holder, thing)


def _untaken_request(service: Any) -> Iterator[_Wait]:
    try:
        what = ("untaken", service, service.oldest_request_id())
    except IndexError:
        return
    thing = f"a request for {service.service_name}"
    holder = _group_holder(service)
    if holder is None:
        patience = _patience(service.parent_node)
        yield what, patience, lambda: _report_unspun(service.parent_node, f"answer {thing}")
    elif _awaits(service.parent_node, holder, service.service_name):
        yield what, _SOON, lambda: _report_held(service, holder, thing)


def _patience(node: NodeInterface) -> float:
    """Seconds that a node may stay unspun: a node that was spun before may be spun again."""
    return _STUCK if node.handle.was_spun and not node.handle.taken_by else _LATE


def _group_holder(entity: Any) -> Any:
    """The entity whose coroutine holds the group of this entity; None if the group is free."""
    return getattr(entity.callback_group, "active_entity", None)


def _awaits(node: Any, holder: Any, service: str) -> bool:
    """Whether the callback of `holder` awaits a response of the service."""
    futures = [
        future
        for client in clients_of(node)
        if client.service_name == service
        for future in client.pending_futures
    ]
    tasks = [future.awaited_by for future in futures]
    return any(task is not None and task.entity is holder for task in tasks)


def _is_observed(client: Any) -> bool:
    """Whether the program ever looked at a future of the client; else it ignores the results."""
    return any(future.is_observed for future in client.pending_futures)


def _report_held(entity: Any, holder: Any, thing: str) -> None:
    name = getattr(getattr(holder, "callback", None), "__qualname__", type(holder).__name__)
    explain.report(
        ("held", entity.service_name, name),
        f"wait here for ever: {thing} of {node_name(entity.parent_node)} needs the callback group"
        f" that {name}() holds while it awaits something; give the client or that callback a"
        " ReentrantCallbackGroup",
    )


def _report_unspun(node: NodeInterface, what: str) -> None:
    if node.handle.taken_by:
        why = (
            f"{node.handle.taken_by} spun {node_name(node)} with a function of rclpy, which removed"
            " the node from its executor; make the callback `async def` and `await` the future, or"
            " call node.executor.spin_until_future_complete(future) there"
        )
    else:
        why = (
            f"no thread spins {node_name(node)}; spin it with"
            " rclpy.spin_until_future_complete(node, future) or rclpy.spin(node)"
        )
    explain.report(("unspun", node_name(node)), f"never {what}: {why}")


def _report_unoffered(client: Any) -> None:
    explain.report(
        ("unoffered", client.service_name),
        f"lose this request and never answer it: no node offers {client.service_name}; call"
        " client.wait_for_service() first, and see `taskrpc service list` (taskrpc sends the"
        " request as soon as a node offers the service)",
    )


def _report_stuck(thread: int, callback: Callback) -> None:
    where = _where(sys._current_frames().get(thread))
    whom = f"of {node_name(callback.entity.parent_node)} " if callback.entity is not None else ""
    fix = "a timer, or a MultiThreadedExecutor"
    if not callback.executor.runs_one_at_a_time:
        whom += "in its callback group "
        fix = "a timer, or a callback group of its own"
    explain.report(
        ("stuck", callback_name(callback)),
        f"run no other callback {whom}meanwhile: {callback_name(callback)} has not returned for"
        f" {_STUCK:g} s{where}; let callbacks return soon: use {fix}",
    )


def _where(frame: FrameType | None) -> str:
    """The line of the program that a thread executes; empty if the thread has ended."""
    while frame is not None and frame.f_code.co_filename.startswith((*_LIBRARIES, "<")):
        frame = frame.f_back
    if frame is None:
        return ""
    path = frame.f_code.co_filename
    line = linecache.getline(path, frame.f_lineno).strip()
    return f" ({Path(path).name}:{frame.f_lineno}: {line})"


def _at_exit() -> None:
    for node in list(_nodes):
        if node.handle.valid:
            ends(node)
    # After an error, that is the reason; a test may create nodes and not spin them.
    if getattr(sys, "last_value", None) is None and "pytest" not in sys.modules:
        for name, offered in _never_spun.items():
            explain.never_spun(name, offered)


atexit.register(_at_exit)
