"""The liveliness tokens with which rmw_zenoh shows nodes, services, clients and topics. Pure.

    @ros2_lv/DOMAIN/SESSION/NODE_ID/NODE_ID/NN/ENCLAVE/NAMESPACE/NODE
    @ros2_lv/DOMAIN/SESSION/NODE_ID/ID/KIND/ENCLAVE/NAMESPACE/NODE/NAME/TYPE/HASH/QOS

A slash inside a part is a `%`; an empty enclave or namespace is a single `%`. Newer versions of
rmw_zenoh may add parts at the end, which are ignored here.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

from taskrpc.middleware.zenoh.keys import dds_type, demangle, mangle, ros_type

DEFAULT_DEPTH = 42
"""The history depth of rmw_zenoh if the program does not give one."""
MAX_DEPTH = 1_000_000
"""Larger depths in a token are reduced to this one."""
UNKNOWN_HASH = "TypeHashNotSupported"
"""What ROS 2 Humble sends in place of a type hash."""
_ADMIN = "@ros2_lv"
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13
_RELIABLE, _BEST_EFFORT = "1", "2"
_TRANSIENT_LOCAL = "1"
_KEEP_ALL = "2"


class Kind(StrEnum):
    """What a token shows."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


class Qos(msgspec.Struct, frozen=True):
    """The part of a QoS profile that a taskrpc program uses."""

    reliable: bool = True
    latched: bool = False
    """Whether the durability is transient_local."""
    depth: int = DEFAULT_DEPTH


SERVICE_QOS = Qos(depth=10)
"""The profile of services and clients."""


class Token(msgspec.Struct, frozen=True):
    """What one token shows."""

    kind: Kind
    domain: int
    session: str
    """The id of the program's session."""
    node_id: int
    endpoint_id: int
    """Equal to `node_id` for a node."""
    node: str
    """The fully qualified name of the node."""
    name: str = ""
    """The absolute name of the service or topic; "" for a node."""
    type_name: str = ""
    type_hash: str = ""
    """As in the key: it can be `UNKNOWN_HASH`."""
    qos: Qos = Qos()
    enclave: str = ""

    def key(self) -> str:
        """Return the key of the token."""
        namespace, _, name = self.node.rpartition("/")
        parts = [
            *(_ADMIN, str(self.domain), self.session, str(self.node_id), str(self.endpoint_id)),
            *(self.kind.value, mangle(self.enclave), mangle(namespace), name),
        ]
        if self.kind is not Kind.NODE:
            parts += [
                mangle(self.name),
                dds_type(self.type_name),
                self.type_hash,
                text_of(self.qos),
            ]
        return "/".join(parts)


def all_tokens(domain: int) -> str:
    """Return the key expression of all tokens of a domain."""
    return f"{_ADMIN}/{domain}/**"


def parse(key: str) -> Token | None:
    """Return what a token shows; None for garbage and for unknown kinds."""
    parts = key.split("/")
    if len(parts) < _NODE_PARTS or parts[0] != _ADMIN or not (all(parts) and key.isprintable()):
        return None
    _, domain, session, node_id, endpoint_id, kind, enclave, namespace, node = parts[:_NODE_PARTS]
    numbers = domain, node_id, endpoint_id
    if kind not in _KINDS or not all(_is_number(each) for each in numbers):
        return None
    within = demangle(namespace).strip("/")
    token = Token(
        kind=Kind(kind),
        domain=int(domain),
        session=session,
        node_id=int(node_id),
        endpoint_id=int(endpoint_id),
        node=f"/{within}/{node}" if within else f"/{node}",
        enclave="" if enclave == "%" else demangle(enclave),
    )
    return token if token.kind is Kind.NODE else _endpoint(token, parts)


def _endpoint(token: Token, parts: list[str]) -> Token | None:
    if len(parts) < _ENDPOINT_PARTS:
        return None
    name, type_name, type_hash, profile = parts[_NODE_PARTS:_ENDPOINT_PARTS]
    qos = qos_of(profile)
    if qos is None:
        return None
    return msgspec.structs.replace(
        token,
        name="/" + demangle(name).strip("/"),
        type_name=ros_type(type_name),
        type_hash=type_hash,
        qos=qos,
    )


def text_of(qos: Qos) -> str:
    """Return a profile as tokens have it: values that are rmw_zenoh's default are left out."""
    reliability = "" if qos.reliable else _BEST_EFFORT
    durability = _TRANSIENT_LOCAL if qos.latched else ""
    depth = "" if qos.depth == DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def qos_of(text: str) -> Qos | None:
    """Return the profile in a token; None for garbage. Deadlines and lifespans are ignored."""
    parts = text.split(":")
    if len(parts) < 3:
        return None
    history, _, depth = parts[2].partition(",")
    if not all(_is_number(each or "0") for each in (parts[0], parts[1], history, depth)):
        return None
    has_depth = depth and history != _KEEP_ALL and int(depth) > 0
    return Qos(
        reliable=parts[0] != _BEST_EFFORT,
        latched=parts[1] == _TRANSIENT_LOCAL,
        depth=min(int(depth), MAX_DEPTH) if has_depth else DEFAULT_DEPTH,
    )


_KINDS = frozenset(kind.value for kind in Kind)


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= 19
