"""The publishers, subscriptions, clients and servers of all visible processes.

The registry has some policies of a publisher or subscription. For those of this process, this
module remembers the whole profile.
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

from taskrpc.spi import RegistryEntry, gid_of

from ...endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from ...qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_services_default
from ...type_hash import type_hash_of
from ..diagnostics.explain import profiles_differ
from .qos_policies import incompatibilities

ENDPOINTS: dict[EndpointTypeEnum, Callable[[RegistryEntry], Sequence[Any]]] = {
    EndpointTypeEnum.PUBLISHER: lambda entry: entry.publishers,
    EndpointTypeEnum.SUBSCRIPTION: lambda entry: entry.subscriptions,
    EndpointTypeEnum.CLIENT: lambda entry: entry.clients,
    EndpointTypeEnum.SERVER: lambda entry: entry.services,
}
"""For each kind of endpoint: its endpoints in the registry entry of a process."""

_Known: TypeAlias = tuple[EndpointTypeEnum, str, str, QoSProfile]
"""The kind, the node, the topic and the profile of a publisher or subscription."""

_profiles: weakref.WeakKeyDictionary[Any, _Known] = weakref.WeakKeyDictionary()
"""The whole profiles of the publishers and subscriptions of this process."""

_service_ends: weakref.WeakValueDictionary[tuple[str, bool], Any] = weakref.WeakValueDictionary()
"""This program's newest client (False) and newest server (True) of each service."""


def check_service_profiles(end: Any, *, is_server: bool) -> None:
    """Warn if a service's client and server in this program have profiles that do not match.

    Requests go one way and responses the other, so the profiles must match in both directions.
    """
    name = end.service_name
    _service_ends[name, is_server] = end
    other = _service_ends.get((name, not is_server))
    if other is None or not other.handle.valid:
        return
    client, server = (other, end) if is_server else (end, other)
    requests = incompatibilities(client.qos_profile, server.qos_profile)
    responses = incompatibilities(server.qos_profile, client.qos_profile)
    if requests or responses:
        whose, problems = ("requests", requests) if requests else ("responses", responses)
        profiles_differ(name, f"for the {whose}: {problems[0]}")


def has_client_here(service: str) -> bool:
    """Whether a node of this program has created a client of the service."""
    client = _service_ends.get((service, False))
    return client is not None and bool(client.handle.valid)


def remember_profile(
    endpoint: Any, kind: EndpointTypeEnum, node: str, topic: str, profile: QoSProfile
) -> None:
    """Remember the whole profile of a publisher or subscription of this process."""
    _profiles[endpoint] = kind, node, topic, profile


def forget_profile(endpoint: Any) -> None:
    """Forget the profile of a publisher or subscription that was destroyed."""
    _profiles.pop(endpoint, None)


def topic_endpoints(
    entries: Iterable[RegistryEntry], kind: EndpointTypeEnum, topic: str
) -> list[TopicEndpointInfo]:
    """The publishers or the subscriptions of a topic, with their policies."""
    return [_topic_info(*found, kind) for found in _named(entries, kind, topic)]


def service_endpoints(
    entries: Iterable[RegistryEntry], kind: EndpointTypeEnum, service: str
) -> list[ServiceEndpointInfo]:
    """The servers or the clients of a service."""
    return [_service_info(*found, kind) for found in _named(entries, kind, service)]


def _named(
    entries: Iterable[RegistryEntry], kind: EndpointTypeEnum, name: str
) -> list[tuple[RegistryEntry, Any]]:
    """The endpoints of a kind and a name, each with the registry entry of its process."""
    endpoints = ENDPOINTS[kind]
    return [(entry, one) for entry in entries for one in endpoints(entry) if one.name == name]


def split_node_name(node: str) -> tuple[str, str]:
    """The name and the namespace of a fully qualified name."""
    namespace, _, name = node.rpartition("/")
    return name, namespace or "/"


def _topic_info(entry: RegistryEntry, one: Any, kind: EndpointTypeEnum) -> TopicEndpointInfo:
    name, namespace = split_node_name(one.node)
    return TopicEndpointInfo(
        node_name=name,
        node_namespace=namespace,
        topic_type=one.type_name,
        topic_type_hash=type_hash_of(one.type_hash),
        endpoint_type=kind,
        endpoint_gid=gid_of(entry.pid, one.node, one.name, kind),
        qos_profile=_whole_profile(entry, one, kind) or _profile(one),
    )


def _service_info(entry: RegistryEntry, one: Any, kind: EndpointTypeEnum) -> ServiceEndpointInfo:
    name, namespace = split_node_name(one.node)
    return ServiceEndpointInfo(
        node_name=name,
        node_namespace=namespace,
        service_type=one.type_name,
        service_type_hash=type_hash_of(one.type_hash),
        qos_profiles=[qos_profile_services_default],
        endpoint_gids=[gid_of(entry.pid, one.node, one.name, kind)],
        endpoint_type=kind,
        endpoint_count=1,
    )


def _whole_profile(entry: RegistryEntry, one: Any, kind: EndpointTypeEnum) -> QoSProfile | None:
    """The remembered profile; None for an endpoint of another process."""
    if entry.pid != os.getpid():
        return None
    for *known, profile in list(_profiles.values()):
        if known == [kind, one.node, one.name]:
            return profile
    return None


def _profile(one: Any) -> QoSProfile:
    """The policies that the registry has."""
    reliable, best_effort = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
    latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=one.depth,
        reliability=reliable if one.reliable else best_effort,
        durability=latched if one.latched else volatile,
    )
