"""The nodes, services and topics that liveliness tokens show. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from taskrpc.middleware.zenoh import tokens
from taskrpc.middleware.zenoh.tokens import Kind, Token
from taskrpc.spi import RegistryEntry, ServiceEndpoint, TopicEndpoint


class Graph:
    """All valid tokens, by what they show."""

    def __init__(self) -> None:
        self._tokens: dict[str, Token] = {}
        """By key."""
        self._named: dict[tuple[Kind, str], dict[str, Token]] = {}
        """By kind and name, then by key."""

    def add(self, key: str) -> Token | None:
        """Add a token; return it if it is valid and new."""
        if key in self._tokens or (token := tokens.parse(key)) is None:
            return None
        self._tokens[key] = token
        self._named.setdefault((token.kind, token.name), {})[key] = token
        return token

    def remove(self, key: str) -> Token | None:
        """Remove a token; return it if it was there."""
        token = self._tokens.pop(key, None)
        if token is not None:
            named = token.kind, token.name
            del self._named[named][key]
            if not self._named[named]:
                del self._named[named]
        return token

    def clear(self) -> None:
        """Remove all tokens."""
        self._tokens.clear()
        self._named.clear()

    def named(self, kind: Kind, name: str) -> Iterable[Token]:
        """The servers, clients, publishers or subscriptions of a name."""
        return self._named.get((kind, name), {}).values()

    def entries(self, without: Collection[str]) -> list[RegistryEntry]:
        """Return one entry for each session, except for the sessions `without`."""
        sessions: dict[str, list[Token]] = {}
        for token in self._tokens.values():
            if token.session not in without:
                sessions.setdefault(token.session, []).append(token)
        return [_entry(session, shown) for session, shown in sessions.items()]


def _entry(session: str, shown: list[Token]) -> RegistryEntry:
    def services(kind: Kind) -> tuple[ServiceEndpoint, ...]:
        return tuple(
            ServiceEndpoint(each.name, each.type_name, each.type_hash, each.node)
            for each in shown
            if each.kind is kind
        )

    def topics(kind: Kind) -> tuple[TopicEndpoint, ...]:
        return tuple(
            TopicEndpoint(
                each.name,
                each.type_name,
                each.type_hash,
                each.node,
                each.qos.depth,
                each.qos.reliable,
                each.qos.latched,
            )
            for each in shown
            if each.kind is kind
        )

    return RegistryEntry(
        pid=0,
        script=f"the Zenoh session {session}",
        folder="",
        since=0.0,
        nodes=tuple(each.node for each in shown if each.kind is Kind.NODE),
        services=services(Kind.SERVER),
        clients=services(Kind.CLIENT),
        publishers=topics(Kind.PUBLISHER),
        subscriptions=topics(Kind.SUBSCRIPTION),
    )
