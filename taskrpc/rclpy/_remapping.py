"""Remapping: names of the command line (`-r from:=to`) instead of the program's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from taskrpc import names
from taskrpc.errors import InvalidName

_PREFIXES = {"rostopic://": "topic", "rosservice://": "service"}
_OF_THE_NODE = {"__node": "node", "__name": "node", "__ns": "namespace"}


class Rule(NamedTuple):
    """One `-r` argument."""

    node: str
    """The only node that it holds for, "" for all."""
    kind: str
    """`node`, `namespace`, `topic`, `service`, or `name` for topics and services."""
    before: str
    """As written; "" where a node's own name or namespace is meant."""
    after: str


def rule_of(text: str) -> Rule:
    """A rule as it is written: `from:=to`, `node:from:=to`, `__node:=to`, `__ns:=/to`.

    Raises ValueError for anything else.
    """
    left, sign, after = text.partition(":=")
    if not sign or not left or not after:
        raise ValueError(f"expected FROM:=TO, got {text!r}")
    node, left = _without_node(left)
    if left in _OF_THE_NODE:
        return Rule(node, _OF_THE_NODE[left], "", after)
    for prefix, kind in _PREFIXES.items():
        if left.startswith(prefix):
            return Rule(node, kind, left.removeprefix(prefix), after.removeprefix(prefix))
    return Rule(node, "name", left, after)


def _without_node(left: str) -> tuple[str, str]:
    node, colon, rest = left.partition(":")
    return (node, rest) if colon and not rest.startswith("//") else ("", left)


class Remapping:
    """The rules that hold for one node: its own first, then the program's."""

    def __init__(self, rules: Iterable[Rule] = ()) -> None:
        self._rules = list(rules)

    def node_name(self, name: str) -> str:
        """The name of a node that the program calls `name`."""
        return self._first("node", name, name)

    def namespace(self, namespace: str, node: str) -> str:
        """The namespace of this node; raises InvalidName for one that a rule has wrong."""
        return names.check_namespace(self._first("namespace", node, namespace))

    def topic(self, name: str, namespace: str, node: str) -> str:
        """The topic that an expanded name stands for."""
        return self._name("topic", name, namespace, node)

    def service(self, name: str, namespace: str, node: str) -> str:
        """The service that an expanded name stands for."""
        return self._name("service", name, namespace, node)

    def _first(self, kind: str, node: str, otherwise: str) -> str:
        for rule in self._rules:
            if rule.kind == kind and rule.node in ("", node):
                return rule.after
        return otherwise

    def _name(self, kind: str, name: str, namespace: str, node: str) -> str:
        def expanded(text: str) -> str:
            return names.expand(text, namespace=namespace, node=node, kind=f"{kind} name")

        for rule in self._rules:
            if rule.kind in (kind, "name") and rule.node in ("", node):
                if _or_nothing(expanded, rule.before) == name:
                    return expanded(rule.after)
        return name


def _or_nothing(expanded: Callable[[str], str], text: str) -> str:
    try:
        return expanded(text)
    except InvalidName:  # a rule for something else
        return ""
