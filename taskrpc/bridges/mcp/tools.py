"""The services and actions of the network as tools: what an agent sees of each."""

from __future__ import annotations

import asyncio
import logging
from typing import Literal, TypeAlias

import msgspec

from srvgen.definitions.model import MessageDef
from srvgen.definitions.names import did_you_mean
from taskrpc.bridges.mcp.arguments import DRY_RUN, REQUEST_ID
from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.results import EXPLAINED, UnknownTool
from taskrpc.bridges.mcp.schemas import (
    Definitions,
    Schema,
    description,
    input_schema,
    output_schema,
)
from taskrpc.bridges.mcp.tool_names import action_tool_name, is_valid, tool_name
from taskrpc.bridges.rosbridge.graph import Graph, graph_of
from taskrpc.bridges.rosbridge.services import ServiceClients
from taskrpc.bridges.rosbridge.types import action_class
from taskrpc.errors import TypeMismatch
from taskrpc.node import Node

log = logging.getLogger("taskrpc.mcp")

Kind: TypeAlias = Literal["service", "action"]

DESCRIBING = 5.0
"""Seconds that the server of a tool has to report its definition."""
MOST_TOOLS = 512
"""Tools in a list; a model can use far fewer."""
_ASKED_AT_ONCE = 16
"""Services whose definitions are fetched at a time."""
_SEND_GOAL = "/_action/send_goal"
_SEND_GOAL_TYPE = "_SendGoal"
_READ_ONLY = frozenset(
    (
        "taskrpc_interfaces/srv/EstimateTask",
        "taskrpc_interfaces/srv/ListTasks",
        "taskrpc_interfaces/srv/ShowTask",
        "taskrpc_interfaces/srv/WatchTasks",
        "rcl_interfaces/srv/DescribeParameters",
        "rcl_interfaces/srv/GetParameterTypes",
        "rcl_interfaces/srv/GetParameters",
        "rcl_interfaces/srv/ListParameters",
        "lifecycle_msgs/srv/GetAvailableStates",
        "lifecycle_msgs/srv/GetAvailableTransitions",
        "lifecycle_msgs/srv/GetState",
        "nav_msgs/srv/GetMap",
    )
)
"""Types whose services change nothing. A definition does not say this, and a wrong guess would let
clients call a service without asking their user."""


class Target(msgspec.Struct, frozen=True):
    """A service or an action of the network."""

    kind: Kind
    name: str
    """The absolute name."""
    type_name: str

    @property
    def tool(self) -> str:
        """The name of its tool."""
        return tool_name(self.name) if self.kind == "service" else action_tool_name(self.name)


class Tool(msgspec.Struct, frozen=True):
    """What an agent sees of a service or an action."""

    name: str
    title: str
    """The name of the service or action."""
    description: str
    input_schema: Schema
    output_schema: Schema
    is_read_only: bool
    is_idempotent: bool
    """Whether repeating a call with the same arguments changes nothing more."""


class Tools:
    """Finds the tools of the network that an agent may see."""

    def __init__(self, node: Node, clients: ServiceClients, permissions: Permissions) -> None:
        self._node = node
        self._clients = clients
        self._permissions = permissions
        self._targets: dict[str, Target] = {}
        """The targets that were seen last, by the name of their tool."""
        self._listed: dict[str, object] = {}
        """The service or action class of each listed tool: agents know only its schema."""

    async def all(self) -> list[Tool]:
        """Return the tools, sorted by name; a server that cannot be asked has none.

        Raises DeadlineExceeded if the programs of the network cannot be listed.
        """
        targets = await self._look()
        self._listed.clear()
        turn = asyncio.Semaphore(_ASKED_AT_ONCE)
        found = await asyncio.gather(*(self._described(each, turn) for each in targets))
        return [tool for tool in found if tool is not None]

    async def target(self, name: str) -> Target:
        """Return the service or the action of a tool. Raises UnknownTool, DeadlineExceeded."""
        if name not in self._targets:
            await self._look()
        target = self._targets.get(name)
        if target is None or not self._permissions.shows("call", target.name):
            hint = did_you_mean(name, self._targets)
            problem = f"there is no tool {name[:100]!r}"
            raise UnknownTool(f"{problem}; {hint}" if hint else problem)
        return target

    def refuse_changed(self, target: Target, cls: object) -> None:
        """Refuse a call of a tool whose definition has changed since the tools were listed.

        Otherwise the call would run, and the client would take its response for an invalid one.
        Raises TypeMismatch.
        """
        if self._listed.get(target.tool, cls) is not cls:
            raise TypeMismatch(f"the definition of {target.name} has changed")

    async def _look(self) -> list[Target]:
        graph = await graph_of(self._node)
        shown = (each for each in targets_of(graph) if self._permissions.shows("call", each.name))
        self._targets = {each.tool: each for each in shown}
        names = sorted(self._targets)
        if len(names) > MOST_TOOLS:
            log.warning("only %d of %d tools are listed", MOST_TOOLS, len(names))
        return [self._targets[name] for name in names[:MOST_TOOLS]]

    async def _described(self, target: Target, turn: asyncio.Semaphore) -> Tool | None:
        describe = self._service if target.kind == "service" else self._action
        try:
            async with turn, asyncio.timeout(DESCRIBING):
                return await describe(target)
        except TimeoutError:
            log.warning("%s is no tool: its server did not report its definition", target.name)
        except EXPLAINED as error:
            log.warning("%s is no tool: %s", target.name, error)
        return None

    async def _service(self, target: Target) -> Tool:
        deadline = asyncio.get_running_loop().time() + DESCRIBING
        client = await self._clients.client(target.name, deadline)
        await client.channel.connect(deadline)
        cls, mode = client.srv_type, client.channel.mode
        self._listed[target.tool] = cls
        texts = Definitions(cls._TYPE, cls._DEFINITION)
        request, response = texts.sections
        is_read_only = target.type_name in _READ_ONLY
        options = [REQUEST_ID] if client.channel.store_id else []
        options += [] if is_read_only else [DRY_RUN]
        return Tool(
            target.tool,
            target.name,
            _described(request, f"Calls the service {target.name} ({target.type_name})."),
            input_schema(cls.Request, request, texts, options),
            output_schema(cls.Response, response, texts),
            is_read_only,
            is_read_only or mode.name == "IDEMPOTENT",
        )

    async def _action(self, target: Target) -> Tool:
        cls = action_class(target.type_name)
        self._listed[target.tool] = cls
        texts = Definitions(cls._TYPE, cls._DEFINITION)
        goal, result, _ = texts.sections
        does = (
            f"Sends a goal to the action {target.name} ({target.type_name}), and waits for its end."
        )
        return Tool(
            target.tool,
            target.name,
            _described(goal, f"{does} Cancelling the call cancels the goal."),
            input_schema(cls.Goal, goal, texts, [DRY_RUN]),
            output_schema(cls.Result, result, texts),
            is_read_only=False,
            is_idempotent=False,
        )


def targets_of(graph: Graph) -> list[Target]:
    """Return the visible services and actions of the network, without those of invalid names."""
    services = [Target("service", *each) for each in graph.service_types.items()]
    actions = {
        each.name.removesuffix(_SEND_GOAL): each.type_name.removesuffix(_SEND_GOAL_TYPE)
        for each in graph.services
        if each.name.endswith(_SEND_GOAL)
    }
    found = services + [Target("action", *each) for each in sorted(actions.items())]
    return [each for each in found if is_valid(each.name, each.type_name)]


def estimator_of(target: Target) -> str | None:
    """Return the service of a task server that estimates the tasks which a target queues."""
    if target.type_name == "my_robot_interfaces/srv/RobotTask":
        return f"{target.name}/estimate"
    if target.type_name == "my_robot_interfaces/action/ExecuteTask":
        return f"{target.name.rpartition('/')[0]}/estimate"
    return None


def _described(section: MessageDef, does: str) -> str:
    comment = description(section)
    return f"{comment}\n\n{does}" if comment else does
