"""The entries of `Node.get_publishers_info_by_topic` and its like, made of what processes say."""

from __future__ import annotations

import os
import weakref
from collections.abc import Iterable
from typing import Any, TypeAlias

from taskrpc.introspection import gid_of
from taskrpc.transport.discovery.entries import RegistryEntry

from ...endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from ...qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_services_default
from ...type_hash import type_hash_of
from ..diagnostics.explain import profiles_differ
from .qos_policies import incompatibilities

_Known: TypeAlias = tuple[EndpointTypeEnum, str, str, QoSProfile]

_ours: weakref.WeakKeyDictionary[Any, _Known] = weakref.WeakKeyDictionary()
"""This program's publishers and subscriptions, of which all policies are known."""


_service_ends: weakref.WeakValueDictionary[tuple[str, bool], Any] = weakref.WeakValueDictionary()
"""This program's newest client (False) and newest server (True) of each service."""


def meet(end: Any, *, is_server: bool) -> None:
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


def remember(
    thing: Any, kind: EndpointTypeEnum, node: str, topic: str, profile: QoSProfile
) -> None:
    """Know the whole profile of a node's publisher or subscription, until `forget`."""
    _ours[thing] = kind, node, topic, profile


def forget(thing: Any) -> None:
    """Know nothing more of a publisher or subscription that was destroyed."""
    _ours.pop(thing, None)


def publishers_of(entries: Iterable[RegistryEntry], topic: str) -> list[TopicEndpointInfo]:
    """The publishers of a topic."""
    kind = EndpointTypeEnum.PUBLISHER
    return [
        _topic(entry, one, kind)
        for entry in entries
        for one in entry.publishers
        if one.name == topic
    ]


def subscriptions_of(entries: Iterable[RegistryEntry], topic: str) -> list[TopicEndpointInfo]:
    """The subscriptions of a topic."""
    kind = EndpointTypeEnum.SUBSCRIPTION
    return [
        _topic(entry, one, kind)
        for entry in entries
        for one in entry.subscriptions
        if one.name == topic
    ]


def servers_of(entries: Iterable[RegistryEntry], service: str) -> list[ServiceEndpointInfo]:
    """The servers of a service."""
    kind = EndpointTypeEnum.SERVER
    return [
        _service(entry, one, kind)
        for entry in entries
        for one in entry.services
        if one.name == service
    ]


def clients_of(entries: Iterable[RegistryEntry], service: str) -> list[ServiceEndpointInfo]:
    """The clients of a service."""
    kind = EndpointTypeEnum.CLIENT
    return [
        _service(entry, one, kind)
        for entry in entries
        for one in entry.clients
        if one.name == service
    ]


def split(node: str) -> tuple[str, str]:
    """A fully qualified name's name and namespace."""
    namespace, _, name = node.rpartition("/")
    return name, namespace or "/"


def _topic(entry: RegistryEntry, one: Any, kind: EndpointTypeEnum) -> TopicEndpointInfo:
    name, namespace = split(one.node)
    return TopicEndpointInfo(
        node_name=name,
        node_namespace=namespace,
        topic_type=one.type_name,
        topic_type_hash=type_hash_of(one.type_hash),
        endpoint_type=kind,
        endpoint_gid=gid_of(entry.pid, one.node, one.name, kind),
        qos_profile=_whole_profile(entry, one, kind) or _profile(one),
    )


def _service(entry: RegistryEntry, one: Any, kind: EndpointTypeEnum) -> ServiceEndpointInfo:
    name, namespace = split(one.node)
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
    if entry.pid != os.getpid():
        return None
    for *known, profile in list(_ours.values()):
        if known == [kind, one.node, one.name]:
            return profile
    return None


def _profile(one: Any) -> QoSProfile:
    reliable, best_effort = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
    latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=one.depth,
        reliability=reliable if one.reliable else best_effort,
        durability=latched if one.latched else volatile,
    )
