"""Detects deadlocks before a callback waits for work that could only run after it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from taskrpc.errors import WouldDeadlock

from ...callback_groups import MutuallyExclusiveCallbackGroup
from ..execution.entity import (
    Callback,
    ExecutorInterface,
    GroupInterface,
    callback_name,
    current_callback,
    node_name,
)
from . import explain


class WaitingClient(Protocol):
    """The part of a client that the diagnostics read; `rclpy.client` has the class."""

    parent_node: Any

    @property
    def service_name(self) -> str:
        """The absolute name of the service."""

    @property
    def callback_group(self) -> GroupInterface | None:
        """The group in which the executor takes its responses."""

    @property
    def pending_futures(self) -> Sequence[Any]:
        """The futures of the calls that have no response yet."""


_calls: dict[int, tuple[WaitingClient, Callback]] = {}
"""Calls without a timeout that callbacks wait for, by the identity of the callback."""


def check_call(client: WaitingClient, timeout: float | None) -> Callback | None:
    """Raise WouldDeadlock when `Client.call` could never end; warn when only its timeout ends it.

    Returns the callback that waits, for `call_ended`.
    """
    callback = current_callback()
    if callback is None or explain.like_ros():
        return None
    why = obstacle(client, callback)
    if timeout is None or timeout < 0:
        _calls[id(callback)] = client, callback  # before the check: other threads check too
        if why := why or _circle(client, callback):
            call_ended(callback)
            raise WouldDeadlock(
                explain.call_deadlock(client.service_name, callback_name(callback), why)
            )
    elif why and timeout:
        explain.call_times_out(client.service_name, callback_name(callback), timeout)
    return callback


def call_ended(callback: Callback | None) -> None:
    """Record that a callback no longer waits for its call."""
    _calls.pop(id(callback), None)


def callers() -> dict[ExecutorInterface, list[tuple[WaitingClient, Callback]]]:
    """Callbacks that wait without a timeout for responses that their own executor must take."""
    found: dict[ExecutorInterface, list[tuple[WaitingClient, Callback]]] = {}
    for client, callback in list(_calls.values()):
        if callback.executor.has_node(client.parent_node):
            found.setdefault(callback.executor, []).append((client, callback))
    return found


def check_spin(executor: ExecutorInterface, future: Any, timeout: float | None) -> None:
    """Raise WouldDeadlock when a spin in a callback waits for a group that the callback holds."""
    callback = current_callback()
    if callback is None or explain.like_ros() or not (timeout is None or timeout < 0):
        return
    for node in executor.get_nodes():
        for client in clients_of(node):
            if future in client.pending_futures:
                if why := _held_group(client.callback_group, callback, "the client"):
                    raise WouldDeadlock(
                        explain.spin_deadlock(client.service_name, callback_name(callback), why)
                    )
                return


def check_rate(node: Any) -> None:
    """Raise WouldDeadlock where `Rate.sleep` blocks the only thread that could run its timer."""
    callback = current_callback()
    if callback is None or explain.like_ros():
        return
    if callback.executor.runs_one_at_a_time and callback.executor.has_node(node):
        raise WouldDeadlock(explain.rate_deadlock(callback_name(callback)))


def check_nested_spin(executor: ExecutorInterface, node: Any) -> None:
    """Warn about a spin in a callback that removes its node from the outer spin."""
    callback = current_callback()
    if callback is not None and callback.executor is executor and executor.has_node(node):
        explain.removed_from_spin(node_name(node), callback_name(callback))


def clients_of(node: Any) -> list[Any]:
    """The clients of a node, with those that its action clients consist of."""
    return [*node.clients, *_parts_of(node, "clients")]


def services_of(node: Any) -> list[Any]:
    """The services of a node, with those that its action servers consist of."""
    return [*node.services, *_parts_of(node, "services")]


def _parts_of(node: Any, kind: str) -> list[Any]:
    return [part for one in list(node.waitables) for part in getattr(one, kind, ())]


def obstacle(client: WaitingClient, callback: Callback) -> str:
    """What prevents the response from being taken while the callback runs; "" if nothing does."""
    if not callback.executor.has_node(client.parent_node):
        return ""
    if callback.executor.runs_one_at_a_time:
        return f"the only thread that spins {node_name(client.parent_node)}"
    held = _held_group(client.callback_group, callback, "the client")
    return held or _server_obstacle(client.service_name, callback)


def _server_obstacle(name: str, callback: Callback) -> str:
    """What prevents a request of this service from being taken while the callback runs."""
    for node in callback.executor.get_nodes():
        for service in services_of(node):
            if service.service_name == name:
                if callback.executor.runs_one_at_a_time:
                    return f"the only thread that spins {node_name(node)}"
                return _held_group(service.callback_group, callback, "the server")
    return ""


def _circle(client: WaitingClient, callback: Callback) -> str:
    """The chain of calls from a call back to its callback; "" if there is none."""
    name, way = client.service_name, list[str]()
    for _ in range(len(_calls)):
        if way and _server_obstacle(name, callback):
            return " -> ".join(way)
        waits = [each for each in list(_calls.values()) if _server_obstacle(name, each[1])]
        if not waits:
            return ""
        next_client, next_callback = waits[0]
        name = next_client.service_name
        way += [callback_name(next_callback), name]
    return ""


def _held_group(group: GroupInterface | None, callback: Callback, owner: str) -> str:
    """The group of the client or server, if the callback holds it; "" otherwise."""
    entity = callback.entity
    exclusive = isinstance(group, MutuallyExclusiveCallbackGroup)
    if not exclusive or entity is None or entity.callback_group is not group:
        return ""
    return f"the mutually exclusive callback group of {owner}"
