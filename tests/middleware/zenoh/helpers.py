"""A foreign program: it speaks rmw_zenoh's format with Zenoh's own library, without taskrpc."""

from __future__ import annotations

import json

import zenoh

from taskrpc.middleware.zenoh import attachment, keys
from taskrpc.middleware.zenoh.configuration import router_configuration
from taskrpc.middleware.zenoh.session import open_session
from taskrpc.middleware.zenoh.tokens import SERVICE_QOS, Kind, Qos, Token

GID = bytes(range(16))


class Foreign:
    """One session; `place` is the address of its router."""

    def __init__(self, place):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)
        self.declared = []

    def token(self, kind, name, interface, type_hash="", qos=SERVICE_QOS):
        return Token(
            kind=kind,
            domain=0,
            session=str(self.session.zid()),
            node_id=0,
            endpoint_id=len(self.declared) + 1,
            node="/foreign",
            name=name,
            type_name=interface._TYPE,
            type_hash=type_hash or interface._HASH,
            qos=qos,
        )

    def serve(self, name, srv_type, answer, type_hash=""):
        """Offer a service; `answer(query)` gets each request in a thread of Zenoh."""
        token = self.token(Kind.SERVER, name, srv_type, type_hash)
        key = keys.data_key(0, name, srv_type._TYPE, token.type_hash)
        self.declared += [
            self.session.declare_queryable(key, answer, complete=True),
            self.session.liveliness().declare_token(token.key()),
        ]
        return key

    def ask(self, name, srv_type, data, about=None):
        """Call a service; returns what arrived: samples, or bytes of an error."""
        about = attachment.pack(7, 1, GID) if about is None else about
        key = keys.data_key(0, name, srv_type._TYPE, srv_type._HASH)
        target = zenoh.QueryTarget.ALL_COMPLETE
        replies = self.session.get(key, payload=data, attachment=about, target=target, timeout=5.0)
        return [each.ok if each.ok is not None else each.err.payload.to_bytes() for each in replies]

    def show_topic(self, kind, name, msg_type, **qos):
        token = self.token(kind, name, msg_type, qos=Qos(**qos))
        self.declared.append(self.session.liveliness().declare_token(token.key()))
        return keys.data_key(0, name, msg_type._TYPE, msg_type._HASH)

    def close(self):
        self.session.close()


def open_router(place):
    """Open a router at an address."""
    return open_session(router_configuration(place))
