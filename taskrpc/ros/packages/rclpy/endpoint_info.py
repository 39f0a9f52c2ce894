"""Descriptions of publishers, subscriptions, clients and servers, as `Node` returns them."""

from __future__ import annotations

import dataclasses
from enum import IntEnum
from typing import Any

from .qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from .type_hash import TypeHash


class EndpointTypeEnum(IntEnum):
    """The kind of an endpoint."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2
    CLIENT = 3
    SERVER = 4


class _EndpointInfo:
    """Checks each field when it is set; converts dicts and numbers to the field's class."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name.endswith("_type_hash"):
            value = TypeHash(**value) if isinstance(value, dict) else value
            assert isinstance(value, TypeHash)
        elif name == "endpoint_type":
            value = EndpointTypeEnum(value)
        elif name == "qos_profile":
            value = _profile(value)
        elif name == "qos_profiles":
            value = [_profile(one) for one in value]
        elif name == "endpoint_count":
            assert isinstance(value, int)
        elif name.startswith("endpoint_gid"):
            assert isinstance(value, list)
        else:
            assert isinstance(value, str)
        object.__setattr__(self, name, value)


def _profile(value: Any) -> QoSProfile:
    value = QoSProfile(**value) if isinstance(value, dict) else value
    assert isinstance(value, QoSProfile)
    return value


def _unknown() -> QoSProfile:
    profile: QoSProfile = QoSPresetProfiles.UNKNOWN.value
    return profile


@dataclasses.dataclass
class TopicEndpointInfo(_EndpointInfo):
    """A publisher or a subscription."""

    node_name: str = ""
    node_namespace: str = ""
    topic_type: str = ""
    topic_type_hash: Any = dataclasses.field(default_factory=TypeHash)
    endpoint_type: Any = EndpointTypeEnum.INVALID
    endpoint_gid: list[int] = dataclasses.field(default_factory=list)
    qos_profile: Any = dataclasses.field(default_factory=_unknown)

    def __str__(self) -> str:
        lines = [
            f"Node name: {self.node_name}",
            f"Node namespace: {self.node_namespace}",
            f"Topic type: {self.topic_type}",
            f"Topic type hash: {self.topic_type_hash}",
            f"Endpoint type: {self.endpoint_type.name}",
            f"GID: {_gid(self.endpoint_gid)}",
            "QoS profile:",
        ]
        return "\n".join(lines + _policies(self.qos_profile, "  "))


@dataclasses.dataclass
class ServiceEndpointInfo(_EndpointInfo):
    """A server or a client of a service."""

    node_name: str = ""
    node_namespace: str = ""
    service_type: str = ""
    service_type_hash: Any = dataclasses.field(default_factory=TypeHash)
    qos_profiles: Any = dataclasses.field(default_factory=list)
    endpoint_gids: list[list[int]] = dataclasses.field(default_factory=list)
    endpoint_type: Any = EndpointTypeEnum.INVALID
    endpoint_count: int = 0

    def __str__(self) -> str:
        lines = [
            f"Node name: {self.node_name}",
            f"Node namespace: {self.node_namespace}",
            f"Service type: {self.service_type}",
            f"Service type hash: {self.service_type_hash}",
            f"Endpoint type: {self.endpoint_type.name}",
            f"Endpoint count: {self.endpoint_count}",
        ]
        for gid, profile in zip(self.endpoint_gids, self.qos_profiles, strict=False):
            lines += [f"GID: {_gid(gid)}", "QoS profile:", *_policies(profile, "  ")]
        return "\n".join(lines)


def _gid(gid: list[int]) -> str:
    return ".".join(f"{one:02x}" for one in gid)


def _policies(profile: QoSProfile, indent: str) -> list[str]:
    history = profile.history.name
    if profile.history is QoSHistoryPolicy.KEEP_LAST:
        history = f"{history} ({profile.depth})"
    return [
        f"{indent}Reliability: {profile.reliability.name}",
        f"{indent}History (Depth): {history}",
        f"{indent}Durability: {profile.durability.name}",
        f"{indent}Lifespan: {profile.lifespan}",
        f"{indent}Deadline: {profile.deadline}",
        f"{indent}Liveliness: {profile.liveliness.name}",
        f"{indent}Liveliness lease duration: {profile.liveliness_lease_duration}",
    ]
