"""Remapping: names of the command line (`-r from:=to`) instead of the program's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from taskrpc import names
from taskrpc.errors import InvalidName

from .arguments import RemapKind, RemapRule

_BOTH = RemapKind.TOPIC_OR_SERVICE


class Remapping:
    """The rules that hold for one node: its own first, then the program's."""

    def __init__(self, rules: Iterable[RemapRule] = ()) -> None:
        self._rules = list(rules)

    def node_name(self, name: str) -> str:
        """The name of a node that the program calls `name`."""
        return self._first(RemapKind.NODE, name, name)

    def namespace(self, namespace: str, node: str) -> str:
        """The namespace of this node, where the program says `namespace`."""
        return self._first(RemapKind.NAMESPACE, node, namespace)

    def topic(self, name: str, namespace: str, node: str) -> str:
        """The topic that an expanded name stands for."""
        return self._name(RemapKind.TOPIC, name, namespace, node)

    def service(self, name: str, namespace: str, node: str) -> str:
        """The service that an expanded name stands for."""
        return self._name(RemapKind.SERVICE, name, namespace, node)

    def _first(self, kind: RemapKind, node: str, otherwise: str) -> str:
        for rule in self._rules:
            if rule.kind is kind and rule.node_name in (None, node):
                return rule.replacement
        return otherwise

    def _name(self, kind: RemapKind, name: str, namespace: str, node: str) -> str:
        def expanded(text: str) -> str:
            return names.expand(text, namespace=namespace, node=node)

        for rule in self._rules:
            fits = rule.kind in (kind, _BOTH) and rule.node_name in (None, node)
            if fits and _or_nothing(expanded, rule.match) == name:
                return expanded(rule.replacement)
        return name


def _or_nothing(expanded: Callable[[str], str], text: str) -> str:
    try:
        return expanded(text)
    except InvalidName:  # a rule for something else
        return ""
