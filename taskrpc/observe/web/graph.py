"""The nodes of the network for the live page, and the calls between other programs.

Nodes come from the registry and from the callers of the last minute. Calls between other programs
come from the topics `SERVICE/_service_event`, of services whose introspection is on. Frames come
from the topics of transforms.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Any

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.observe.web.calls import Caller, CallLog, ShownCall, live_callers
from taskrpc.observe.web.transforms import TransformWatch
from taskrpc.qos import QoS
from taskrpc.spi import SUFFIX, RegistryEntry, gid_of, names
from taskrpc.topic import Subscription

MAX_EVENT_TOPICS = 20
"""Most services of other programs whose calls are shown."""
MAX_ITEMS = 50
"""Most services, clients, publishers or subscriptions of one node."""
MAX_OPEN = 256
"""Most calls between other programs that have begun and not ended."""

_RECEIVED, _SENT = 1, 2  # ServiceEventInfo's REQUEST_RECEIVED and RESPONSE_SENT
_DEPTH = 100


class NodeGraph:
    """Lists the nodes that a node can see, and watches the calls between them.

    Args:
        node: the node of the server.
        calls: gets the calls between other programs, and knows the callers.
        is_own: returns whether an entry is that of the server, whose calls are known already.
    """

    def __init__(
        self,
        node: Node,
        calls: CallLog,
        is_own: Callable[[RegistryEntry], bool] = lambda entry: entry.pid == os.getpid(),
    ) -> None:
        self._node = node
        self._calls = calls
        self._is_own = is_own
        self._subscriptions: dict[str, Subscription[Any]] = {}
        """By topic."""
        self._unusable: set[str] = set()
        """Topics whose type is not known here."""
        self._clients: dict[bytes, str] = {}
        """The names of nodes, by the id that events contain."""
        self._open: OrderedDict[tuple[str, bytes, int], ShownCall] = OrderedDict()
        """Calls that have begun, by service, client and number."""
        self._next_id = -1
        self._transforms = TransformWatch(node)

    async def look(self) -> list[dict[str, Any]]:
        """Return all nodes as JSON values, and subscribe to new topics of events."""
        entries = await self._node.graph()
        nodes = nodes_json(entries, live_callers(self._calls))
        self._clients = {bytes(gid_of(each["name"])): each["name"] for each in nodes}
        self._watch(entries)
        self._transforms.watch(entries)
        return nodes

    def frames(self) -> list[dict[str, Any]]:
        """Return the frames of `/tf` and `/tf_static` as JSON values."""
        return self._transforms.frames()

    def close(self) -> None:
        """Stop watching the calls and the transforms of other programs."""
        for subscription in self._subscriptions.values():
            subscription.destroy()
        self._subscriptions.clear()
        self._open.clear()
        self._transforms.close()

    def _watch(self, entries: Iterable[RegistryEntry]) -> None:
        types = {
            topic.name: topic.type_name
            for entry in entries
            if not self._is_own(entry)
            for topic in entry.publishers
            if topic.name.endswith(SUFFIX)
        }
        for gone in self._subscriptions.keys() - types.keys():
            self._subscriptions.pop(gone).destroy()
        for topic, type_name in types.items():
            is_new = topic not in self._subscriptions and topic not in self._unusable
            if is_new and len(self._subscriptions) < MAX_EVENT_TOPICS:
                self._subscribe(topic, type_name)

    def _subscribe(self, topic: str, type_name: str) -> None:
        service = topic.removesuffix(SUFFIX)
        try:
            event = srvgen.load(type_name.removesuffix("_Event")).Event
            self._subscriptions[topic] = self._node.create_subscription(
                event, topic, lambda message: self._happened(service, message), QoS(_DEPTH)
            )
        except (srvgen.DefinitionError, TaskRpcError, AttributeError):
            if len(self._unusable) < 10 * MAX_EVENT_TOPICS:
                self._unusable.add(topic)

    def _happened(self, service: str, event: Any) -> None:
        info = event.info
        client, stamp = bytes(info.client_gid), info.stamp.sec + info.stamp.nanosec / 1e9
        key = service, client, info.sequence_number
        if info.event_type == _RECEIVED:
            name = self._clients.get(client, "")
            self._open[key] = ShownCall(self._next_id, name, "", service, stamp)
            self._next_id -= 1
            if len(self._open) > MAX_OPEN:
                self._open.popitem(last=False)
        elif info.event_type == _SENT and (shown := self._open.pop(key, None)) is not None:
            shown.ms = round(max(0.0, stamp - shown.begin) * 1000, 3)
            shown.state = "ok"
            self._calls.add(shown)


def nodes_json(entries: Iterable[RegistryEntry], callers: Iterable[Caller]) -> list[dict[str, Any]]:
    """Return the nodes of all processes, and callers that are in no registry, as JSON values."""
    nodes: dict[str, dict[str, Any]] = {}
    for entry in entries:
        host = "" if entry.pid else entry.script
        for name in entry.nodes:
            if not names.is_hidden(name):
                nodes.setdefault(name, _node(name, entry.script, host))
        for key, endpoints in (
            ("services", entry.services),
            ("clients", entry.clients),
            ("publishers", entry.publishers),
            ("subscriptions", entry.subscriptions),
        ):
            for endpoint in endpoints:
                if endpoint.node in nodes and not names.is_hidden(endpoint.name):
                    _add(nodes[endpoint.node][key], endpoint.name)
    for caller in callers:
        name = caller.account or caller.name
        if name in nodes and not caller.machine:
            node = nodes[name]
        elif names.is_hidden(name):
            continue
        else:
            node = nodes.setdefault(f"{name} {caller.machine}", _node(name, caller.name, ""))
            node["host"] = caller.machine
        for service in caller.services:
            _add(node["clients"], service)
    return sorted(nodes.values(), key=lambda node: (node["host"], node["name"]))


def _node(name: str, program: str, host: str) -> dict[str, Any]:
    lists: dict[str, list[str]] = {
        key: [] for key in ("services", "clients", "publishers", "subscriptions")
    }
    return {"name": name, "program": program, "host": host, **lists}


def _add(items: list[str], name: str) -> None:
    if len(items) < MAX_ITEMS and name not in items:
        items.append(name)
