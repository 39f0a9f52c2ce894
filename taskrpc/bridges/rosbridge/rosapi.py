"""The services of rosapi: what runs on the network, definitions of types, parameters, the time.

Only clients of the gateway can call them. They are not offered on the network, so that several
gateways can run at the same time.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
from collections.abc import Awaitable, Callable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import srvgen
from srvgen.classes.loader import search
from taskrpc.bridges.rosbridge.graph import graph_of
from taskrpc.bridges.rosbridge.services import ServiceClients
from taskrpc.bridges.rosbridge.types import (
    message_class,
    message_type_name,
    service_class,
    service_type_name,
)
from taskrpc.bridges.rosbridge.values import request_from_json, to_json
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.spi import time_of_day_ns

if TYPE_CHECKING:
    from srvgen.stubs.rosapi_msgs import srv

_Fields: TypeAlias = dict[str, Any]
_Answer: TypeAlias = Callable[[Any], Awaitable[_Fields]]

_LIST_AGE = 1.0
"""Seconds for which the list of interfaces is kept: finding their files blocks for 8 to 40 ms."""
_PARAMETER_TIMEOUT = 2.0
"""Seconds for one call of a node's parameter services."""
_LIST_PARAMETERS = "/list_parameters"
_MAX_NODES = 200
"""Most nodes whose parameters are listed in one response."""
_ARRAY = re.compile(r"(?P<base>[^\[<]+)(?:<=\d+)?(?:\[(?P<bound><=)?(?P<size>\d*)\])?")
_NOT_SET, _BOOL, _INTEGER, _DOUBLE, _STRING = range(5)
_FIELDS = {
    _BOOL: "bool_value",
    _INTEGER: "integer_value",
    _DOUBLE: "double_value",
    _STRING: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""The field of `rcl_interfaces/msg/ParameterValue` for each type of a parameter."""
_ARRAY_OF = {_BOOL: 6, _INTEGER: 7, _DOUBLE: 8, _STRING: 9}
_TYPES = {bool: _BOOL, int: _INTEGER, float: _DOUBLE, str: _STRING}


class _Verb(NamedTuple):
    """One service of rosapi."""

    type_name: str
    answer: _Answer


class Rosapi:
    """Answers the calls of clients to `/rosapi/…`."""

    def __init__(self, node: Node, clients: ServiceClients) -> None:
        self._node = node
        self._clients = clients
        self._verbs = {
            name: _Verb(f"rosapi_msgs/srv/{type_name}", answer)
            for name, (type_name, answer) in self._answers().items()
        }
        self._listed: tuple[float, list[str]] = (-math.inf, [])
        """When the interfaces were listed, in the time of the event loop, and their names."""

    def _answers(self) -> dict[str, tuple[str, _Answer]]:
        return {
            "topics": ("Topics", self._topics),
            "topics_for_type": ("TopicsForType", self._topics_for_type),
            "topics_and_raw_types": ("TopicsAndRawTypes", self._topics_and_raw_types),
            "topic_type": ("TopicType", self._topic_type),
            "publishers": ("Publishers", self._publishers),
            "subscribers": ("Subscribers", self._subscribers),
            "services": ("Services", self._services),
            "services_for_type": ("ServicesForType", self._services_for_type),
            "service_type": ("ServiceType", self._service_type),
            "service_node": ("ServiceNode", self._service_node),
            "service_providers": ("ServiceProviders", self._service_providers),
            "nodes": ("Nodes", self._nodes),
            "node_details": ("NodeDetails", self._node_details),
            "action_servers": ("GetActionServers", self._action_servers),
            "interfaces": ("Interfaces", self._interfaces),
            "message_details": ("MessageDetails", self._message_details),
            "service_request_details": ("ServiceRequestDetails", self._request_details),
            "service_response_details": ("ServiceResponseDetails", self._response_details),
            "get_param": ("GetParam", self._get_param),
            "set_param": ("SetParam", self._set_param),
            "has_param": ("HasParam", self._has_param),
            "delete_param": ("DeleteParam", self._delete_param),
            "get_param_names": ("GetParamNames", self._get_param_names),
            "get_time": ("GetTime", self._get_time),
            "get_ros_version": ("GetROSVersion", self._get_ros_version),
        }

    def verb_of(self, service: str) -> str | None:
        """Return the verb of a service of rosapi, None for any other service."""
        name = service.removeprefix("/")
        verb = name.removeprefix("rosapi/")
        return verb if verb != name and verb in self._verbs else None

    async def call(self, verb: str, args: object) -> dict[str, Any]:
        """Return the response of a service of rosapi as JSON.

        Raises TaskRpcError, FieldError, DefinitionError.
        """
        type_name, answer = self._verbs[verb]
        cls = _bundled(type_name)
        request = request_from_json(cls.Request, args)
        response = to_json(cls.Response(**await answer(request)))
        if verb == "get_time":  # roslibpy reads the names that ROS 1 had
            stamp = response["time"]
            stamp |= {"secs": stamp["sec"], "nsecs": stamp["nanosec"]}
        return response

    # Topics

    async def _topics(self, _: Any) -> _Fields:
        topics = (await graph_of(self._node)).topics
        return {"topics": list(topics), "types": list(topics.values())}

    async def _topics_for_type(self, request: srv.TopicsForType.Request) -> _Fields:
        wanted = message_type_name(request.type)
        topics = (await graph_of(self._node)).topics
        return {"topics": [name for name, type_name in topics.items() if type_name == wanted]}

    async def _topics_and_raw_types(self, _: Any) -> _Fields:
        topics = (await graph_of(self._node)).topics
        texts = [_full_text(each) for each in topics.values()]
        found = {"topics": list(topics), "types": list(topics.values())}
        return {**found, "typedefs_full_text": texts}

    async def _topic_type(self, request: srv.TopicType.Request) -> _Fields:
        topic = self._node.resolve_topic_name(request.topic)
        return {"type": (await graph_of(self._node)).type_of(topic)}

    async def _publishers(self, request: srv.Publishers.Request) -> _Fields:
        topic = self._node.resolve_topic_name(request.topic)
        found = (await graph_of(self._node)).publishers_of(topic)
        return {"publishers": sorted({each.node for each in found})}

    async def _subscribers(self, request: srv.Subscribers.Request) -> _Fields:
        topic = self._node.resolve_topic_name(request.topic)
        found = (await graph_of(self._node)).subscriptions_of(topic)
        return {"subscribers": sorted({each.node for each in found})}

    # Services, nodes, actions

    async def _service_types(self) -> dict[str, str]:
        """Return all services with their types, also those of this object."""
        own = {f"/rosapi/{name}": verb.type_name for name, verb in self._verbs.items()}
        return own | (await graph_of(self._node)).service_types

    async def _services(self, _: Any) -> _Fields:
        return {"services": sorted(await self._service_types())}

    async def _services_for_type(self, request: srv.ServicesForType.Request) -> _Fields:
        wanted = service_type_name(request.type)
        types = await self._service_types()
        return {"services": sorted(name for name in types if types[name] == wanted)}

    async def _service_type(self, request: srv.ServiceType.Request) -> _Fields:
        service = self._node.resolve_service_name(request.service)
        return {"type": (await self._service_types()).get(service, "")}

    async def _service_node(self, request: srv.ServiceNode.Request) -> _Fields:
        return {"node": next(iter(await self._providers(request.service)), "")}

    async def _service_providers(self, request: srv.ServiceProviders.Request) -> _Fields:
        return {"providers": await self._providers(request.service)}

    async def _providers(self, name: str) -> list[str]:
        service = self._node.resolve_service_name(name)
        if self.verb_of(service) is not None:
            return [self._node.get_fully_qualified_name()]
        services = (await graph_of(self._node)).services
        return sorted({each.node for each in services if each.name == service})

    async def _nodes(self, _: Any) -> _Fields:
        return {"nodes": sorted((await graph_of(self._node)).nodes)}

    async def _node_details(self, request: srv.NodeDetails.Request) -> _Fields:
        node = f"/{request.node.removeprefix('/')}"
        graph = await graph_of(self._node)
        endpoints: dict[str, list[Any]] = {
            "subscribing": graph.subscriptions,
            "publishing": graph.publishers,
            "services": graph.services,
        }
        return {
            name: sorted({each.name for each in found if each.node == node})
            for name, found in endpoints.items()
        }

    async def _action_servers(self, _: Any) -> _Fields:
        return {"action_servers": (await graph_of(self._node)).actions}

    # Definitions

    async def _interfaces(self, _: Any) -> _Fields:
        now = asyncio.get_running_loop().time()
        if now - self._listed[0] >= _LIST_AGE:
            found = search()
            with found.cached_lookups():
                names = [name for package in found.packages() for name in found.interfaces(package)]
            self._listed = now, names
        return {"interfaces": self._listed[1]}

    async def _message_details(self, request: srv.MessageDetails.Request) -> _Fields:
        return {"typedefs": list(_type_definitions(message_class(request.type)))}

    async def _request_details(self, request: srv.ServiceRequestDetails.Request) -> _Fields:
        return {"typedefs": list(_type_definitions((await self._service(request.type)).Request))}

    async def _response_details(self, request: srv.ServiceResponseDetails.Request) -> _Fields:
        return {"typedefs": list(_type_definitions((await self._service(request.type)).Response))}

    async def _service(self, text: str) -> Any:
        """Return the class of a service type, from its server if this machine has no file."""
        type_name = service_type_name(text)
        try:
            return service_class(text)
        except srvgen.DefinitionError:
            types = (await graph_of(self._node)).service_types
            service = next((name for name, each in types.items() if each == type_name), None)
            if service is None:
                raise
        return srvgen.define(*await self._node.definition(service))

    # Parameters

    async def _get_param(self, request: srv.GetParam.Request) -> _Fields:
        try:
            value = await self._parameter(request.name)
        except (TaskRpcError, srvgen.FieldError) as error:
            return {"value": request.default_value, "successful": False, "reason": str(error)}
        if value["type"] == _NOT_SET:
            problem = f"there is no parameter {request.name}"
            return {"value": request.default_value, "successful": False, "reason": problem}
        return {"value": json.dumps(value[_FIELDS[value["type"]]]), "successful": True}

    async def _has_param(self, request: srv.HasParam.Request) -> _Fields:
        try:
            value = await self._parameter(request.name)
        except (TaskRpcError, srvgen.FieldError):
            return {"exists": False}
        return {"exists": value["type"] != _NOT_SET}

    async def _set_param(self, request: srv.SetParam.Request) -> _Fields:
        try:
            value = json.loads(request.value)
        except (ValueError, RecursionError):
            value = request.value  # a text without quotation marks
        try:
            present = (await self._parameter(request.name))["type"]
            return await self._set(request.name, _parameter_value(value, present))
        except (TaskRpcError, srvgen.FieldError) as error:
            return {"successful": False, "reason": str(error)}

    async def _delete_param(self, request: srv.DeleteParam.Request) -> _Fields:
        try:
            return await self._set(request.name, {"type": _NOT_SET})
        except (TaskRpcError, srvgen.FieldError) as error:
            return {"successful": False, "reason": str(error)}

    async def _get_param_names(self, _: Any) -> _Fields:
        services = (await graph_of(self._node)).service_types
        owners = [
            name.removesuffix(_LIST_PARAMETERS)
            for name in services
            if name.endswith(_LIST_PARAMETERS)
        ]
        found = await asyncio.gather(*map(self._parameter_names, owners[:_MAX_NODES]))
        return {"names": sorted(name for names in found for name in names)}

    async def _parameter_names(self, owner: str) -> list[str]:
        try:
            response = await self._ask(owner, "list_parameters")
        except TaskRpcError:  # the node has ended, or does not spin
            return []
        return [f"{owner}:{name}" for name in response["result"]["names"]]

    async def _parameter(self, name: str) -> dict[str, Any]:
        owner, parameter = _split_parameter(name)
        values = (await self._ask(owner, "get_parameters", names=[parameter]))["values"]
        return values[0] if values else {"type": _NOT_SET}

    async def _set(self, name: str, value: dict[str, Any]) -> _Fields:
        owner, parameter = _split_parameter(name)
        one = {"name": parameter, "value": value}
        response = await self._ask(owner, "set_parameters", parameters=[one])
        result = response["results"][0]
        return {"successful": result["successful"], "reason": result["reason"]}

    async def _ask(self, owner: str, verb: str, **args: Any) -> dict[str, Any]:
        return await self._clients.call(f"{owner}/{verb}", args, _PARAMETER_TIMEOUT)

    # The time and the version

    async def _get_time(self, _: Any) -> _Fields:
        seconds, nanoseconds = divmod(time_of_day_ns(), 10**9)
        stamp = _bundled("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
        return {"time": stamp}

    async def _get_ros_version(self, _: Any) -> _Fields:
        return {"version": 2, "distro": os.environ.get("ROS_DISTRO", "")}


@cache
def _bundled(type_name: str) -> Any:
    """Return a class that comes with srvgen; loading it each time would look at its files."""
    return srvgen.load(type_name)


def _full_text(type_name: str) -> str:
    try:
        return search().full_text(type_name)
    except srvgen.DefinitionError as error:
        return f"# {error}"


def _type_definitions(cls: Any) -> Iterator[Any]:
    """Yield a `TypeDef` for a message class, then for each class inside it, each once."""
    typedef = _bundled("rosapi_msgs/msg/TypeDef")
    waiting, seen = [cls], {cls._TYPE}
    while waiting:
        present = waiting.pop(0)
        yield typedef(**_type_definition(present))
        for nested in present._NESTED.values():
            if nested._TYPE not in seen:
                seen.add(nested._TYPE)
                waiting.append(nested)


def _type_definition(cls: Any) -> _Fields:
    example = to_json(cls())
    definition: _Fields = {"type": _short(cls._TYPE)}
    lists: dict[str, list[Any]] = {"fieldtypes": [], "fieldarraylen": [], "examples": []}
    for name, type_ in cls._FIELDS:
        found = _ARRAY.fullmatch(type_)
        is_array = "[" in type_
        fixed = is_array and found is not None and found["size"] and not found["bound"]
        length = int(found["size"]) if fixed and found else 0
        lists["fieldtypes"].append(type_ if found is None else found["base"])
        lists["fieldarraylen"].append(length if is_array else -1)
        plain = "{}" if name in cls._NESTED else str(example[name])
        lists["examples"].append("[]" if is_array else plain)
    constants = _constants(cls)
    return {
        **definition,
        "fieldnames": [name for name, _ in cls._FIELDS],
        **lists,
        "constnames": list(constants),
        "constvalues": [str(each) for each in constants.values()],
    }


def _short(type_name: str) -> str:
    """Return `pkg/Name`, as rosapi writes types in definitions."""
    package, _, name = type_name.split("/")
    return f"{package}/{name}"


def _constants(cls: Any) -> dict[str, Any]:
    return {
        name: value
        for name, value in vars(cls).items()
        if name[0].isalpha() and name.isupper() and isinstance(value, bool | int | float | str)
    }


def _split_parameter(name: str) -> tuple[str, str]:
    node, colon, parameter = name.partition(":")
    if not (node and colon and parameter):
        raise TaskRpcError(f"expected NODE:PARAMETER such as /turtlesim:background_r, got {name!r}")
    return f"/{node.removeprefix('/')}", parameter


def _parameter_value(value: object, present: int) -> dict[str, Any]:
    """Return a ParameterValue; a number gets the type that the parameter has at present."""
    if present == _STRING and not isinstance(value, str):
        value = json.dumps(value)
    elif present == _DOUBLE and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    elif present == _ARRAY_OF[_DOUBLE] and isinstance(value, list):
        value = [float(each) if type(each) is int else each for each in value]
    items: list[Any] = value if isinstance(value, list) else [value]
    if not items and present in _ARRAY_OF.values():
        return {"type": present}
    kinds = {type(each) for each in items}
    if len(kinds) != 1 or (kind := _TYPES.get(kinds.pop())) is None:
        problem = "expected a boolean, a number, a string, or a list of one of these"
        raise TaskRpcError(f"{problem}, got {json.dumps(value)[:80]}")
    type_ = _ARRAY_OF[kind] if isinstance(value, list) else kind
    return {"type": type_, _FIELDS[type_]: value}
