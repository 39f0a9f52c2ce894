"""Finds, before a callback waits, that what it waits for could only be run after it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taskrpc.errors import WouldDeadlock

from ...callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from ..execution.running_callbacks import Callback, current_callback
from . import explain

if TYPE_CHECKING:
    from ...client import Client
    from ...executors import Executor
    from ...future import Future
    from ...timer import Timer


_calls: dict[int, tuple[Client[Any, Any], Callback]] = {}
"""Calls that callbacks wait for without end, by the callback's identity."""


def check_call(client: Client[Any, Any], timeout: float | None) -> Callback | None:
    """Raise WouldDeadlock where `Client.call` could never end, or tell that its timeout will.

    Returns the callback that waits, for `call_ended`.
    """
    callback = current_callback()
    if callback is None or explain.like_ros():
        return None
    why = obstacle(client, callback)
    if timeout is None or timeout < 0:
        _calls[id(callback)] = client, callback  # before looking: others may look at this moment
        if why := why or _circle(client, callback):
            call_ended(callback)
            raise WouldDeadlock(explain.would_hang(client, callback, why))
    elif why and timeout:
        explain.would_wait_in_vain(client, callback, timeout)
    return callback


def call_ended(callback: Callback | None) -> None:
    """Know that a callback waits for its call no longer."""
    _calls.pop(id(callback), None)


def callers() -> dict[Executor, list[tuple[Client[Any, Any], Callback]]]:
    """Callbacks that wait without end for answers that their own executor would have to take."""
    found: dict[Executor, list[tuple[Client[Any, Any], Callback]]] = {}
    for client, callback in list(_calls.values()):
        if client._node in callback.executor._nodes:
            found.setdefault(callback.executor, []).append((client, callback))
    return found


def check_spin(executor: Executor, future: Future[Any], timeout: float | None) -> None:
    """Raise WouldDeadlock where a spin in a callback waits for what the callback's group holds."""
    callback = current_callback()
    if callback is None or explain.like_ros() or not (timeout is None or timeout < 0):
        return
    for node in executor.get_nodes():
        for client in node.clients:
            if future in list(client._pending.values()):
                if why := _held_group(client.callback_group, callback, "the answer"):
                    raise WouldDeadlock(explain.spun_in_vain(client, callback, why))
                return


def check_rate(timer: Timer) -> None:
    """Raise WouldDeadlock where `Rate.sleep` keeps the only thread that could run its timer."""
    callback = current_callback()
    if callback is None or explain.like_ros():
        return
    if callback.executor._one_thread and timer._node in callback.executor._nodes:
        raise WouldDeadlock(explain.would_oversleep(callback))


def check_deaf(executor: Executor, node: Any) -> None:
    """Tell of a spin in a callback that takes its node away from the spin around it."""
    callback = current_callback()
    if callback is not None and callback.executor is executor and node in executor._nodes:
        explain.went_deaf(node, callback)


def obstacle(client: Client[Any, Any], callback: Callback) -> str:
    """What keeps the answer from being taken while the callback runs; "" if nothing does."""
    if client._node not in callback.executor._nodes:
        return ""
    if callback.executor._one_thread:
        return f"the only thread that spins {explain.shown(client._node)}"
    held = _held_group(client.callback_group, callback, "the answer")
    return held or _server_obstacle(client.service_name, callback)


def _server_obstacle(name: str, callback: Callback) -> str:
    """What keeps a request to this service from being taken while the callback runs."""
    for node in callback.executor.get_nodes():
        for service in node.services:
            if service.service_name == name:
                if callback.executor._one_thread:
                    return f"the only thread that spins {explain.shown(node)}"
                return _held_group(service.callback_group, callback, "the server")
    return ""


def _circle(client: Client[Any, Any], callback: Callback) -> str:
    """The way from a call over other callbacks' calls back to the callback; "" if there is none."""
    name, way = client.service_name, list[str]()
    for _ in range(len(_calls)):
        if way and _server_obstacle(name, callback):
            return " -> ".join(way)
        waits = [each for each in list(_calls.values()) if _server_obstacle(name, each[1])]
        if not waits:
            return ""
        further, other = waits[0]
        name = further.service_name
        way += [explain.name_of(other), name]
    return ""


def _held_group(group: CallbackGroup | None, callback: Callback, what: str) -> str:
    entity = callback.entity
    exclusive = isinstance(group, MutuallyExclusiveCallbackGroup)
    if not exclusive or entity is None or entity.callback_group is not group:
        return ""
    return f"the mutually exclusive callback group of {what}"
