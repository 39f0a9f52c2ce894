"""Finds lifecycle nodes and calls their lifecycle services, for commands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import srvgen
from taskrpc.cli.shared.command import NotFound, hinted
from taskrpc.message_types import RequestT, ResponseT, Srv
from taskrpc.node import Node
from taskrpc.spi import RegistryEntry, names

if TYPE_CHECKING:
    from srvgen.stubs.lifecycle_msgs.msg import State, Transition, TransitionDescription

_STATE = "/get_state"
_STATE_TYPE: Final = "lifecycle_msgs/srv/GetState"


class LifecycleServices:
    """Calls the lifecycle services of one node (its fully qualified name).

    Args:
        timeout: seconds for each call; None waits until the node responds.
    """

    def __init__(self, node: Node, owner: str, timeout: float | None) -> None:
        self._node = node
        self._owner = owner
        self._timeout = timeout

    async def state(self) -> State:
        """Return the current state, as a State message."""
        srv_type = srvgen.load(_STATE_TYPE)
        response = await self._call(srv_type, "get_state", srv_type.Request())
        return response.current_state

    async def transitions(self, *, possible_now: bool) -> list[TransitionDescription]:
        """Return the possible transitions, or all, as TransitionDescription messages."""
        verb = "get_available_transitions" if possible_now else "get_transition_graph"
        srv_type = srvgen.load("lifecycle_msgs/srv/GetAvailableTransitions")
        response = await self._call(srv_type, verb, srv_type.Request())
        return list(response.available_transitions)

    async def change(self, transition: Transition) -> bool:
        """Make a transition; returns whether its callback succeeded."""
        srv_type = srvgen.load("lifecycle_msgs/srv/ChangeState")
        request = srv_type.Request(transition=transition)
        return (await self._call(srv_type, "change_state", request)).success

    async def _call(
        self, srv_type: type[Srv[RequestT, ResponseT]], verb: str, request: RequestT
    ) -> ResponseT:
        client = self._node.create_client(srv_type, f"{self._owner}/{verb}", timeout=self._timeout)
        try:
            return await client.call(request)
        finally:
            client.destroy()


def lifecycle_nodes(entries: Iterable[RegistryEntry], *, hidden: bool) -> list[str]:
    """Return the names of the lifecycle nodes, sorted; hidden nodes only with `hidden`."""
    found = {
        service.name.removesuffix(_STATE)
        for entry in entries
        for service in entry.services
        if service.name.endswith(_STATE) and service.type_name == _STATE_TYPE
    }
    return sorted(name for name in found if hidden or not names.is_hidden(name))


def checked_node(name: str, entries: Iterable[RegistryEntry], *, hidden: bool) -> str:
    """Return the name of a running lifecycle node. Raises NotFound if there is none."""
    from srvgen.definitions.names import did_you_mean

    entries = list(entries)
    known = lifecycle_nodes(entries, hidden=hidden)
    if name in known:
        return name
    if name in lifecycle_nodes(entries, hidden=True):
        hint = f"{name} is hidden; add --include-hidden-nodes"
    elif any(name in entry.nodes for entry in entries):
        hint = f"{name} runs, but it is not a lifecycle node"
    else:
        hint = did_you_mean(name, known)
    raise hinted(NotFound("Node not found"), hint)
