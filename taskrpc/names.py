"""Names of nodes, namespaces, services and topics by ROS 2's rules: checked and expanded."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taskrpc.errors import InvalidName

_MAX_NODE, _MAX_NAMESPACE, _MAX_TOPIC = 255, 245, 247
_NOT_WORD = re.compile(r"[^A-Za-z0-9_]")
_NOT_PATH = re.compile(r"[^A-Za-z0-9_/]")
_NOT_TOPIC = re.compile(r"[^A-Za-z0-9_/~{}]")
_DIGIT_TOKEN = re.compile(r"(?:^|/)(?=[0-9])")
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")


def check_node_name(name: str) -> str:
    """Return a node's name, or raise `InvalidName` with the offending character."""
    kind = "node name"
    _refuse_if(not name, name, 0, kind, "node name must not be empty")
    if found := _NOT_WORD.search(name):
        problem = "node name must not contain characters other than alphanumerics or '_'"
        raise InvalidName(name, found.start(), kind=kind, problem=problem)
    _refuse_if(name[0].isdigit(), name, 0, kind, "node name must not start with a number")
    _check_length(name, _MAX_NODE, kind)
    return name


def check_namespace(namespace: str) -> str:
    """Return an absolute namespace (`""` becomes `/`, `robot1` becomes `/robot1`), or raise."""
    kind = "namespace"
    name = namespace if namespace.startswith("/") else f"/{namespace}"
    if found := _NOT_PATH.search(name):
        problem = "namespace must not contain characters other than alphanumerics, '_', or '/'"
        raise InvalidName(name, found.start(), kind=kind, problem=problem)
    ends = len(name) > 1 and name.endswith("/")
    _refuse_if(
        ends, name, len(name) - 1, kind, "namespace must not end with a '/', unless only a '/'"
    )
    _check_tokens(name, kind, "namespace must not have a token that starts with a number")
    _check_length(name, _MAX_NAMESPACE, kind)
    return name


def expand(name: str, *, namespace: str = "/", node: str = "", kind: str = "service name") -> str:
    """Return the absolute name that a service or topic name means for a node.

    `/x` is absolute, `x` lies in the node's namespace, `~/x` under the node itself; `{node}` and
    `{ns}` are replaced. Raises `InvalidName`.
    """
    _check_raw(name, kind)
    names = {"node": node, "ns": namespace, "namespace": namespace}
    expanded = "".join(_substituted(name, names, kind))
    own = f"{namespace.rstrip('/')}/{node}"
    if expanded.startswith("~"):
        expanded = own + expanded[1:]
    elif not expanded.startswith("/"):
        expanded = f"{namespace.rstrip('/')}/{expanded}"
    _check_tokens(expanded, kind, "topic name token must not start with a number")
    _check_length(expanded, _MAX_TOPIC, kind)
    return expanded


def is_hidden(name: str) -> bool:
    """Whether a token of the name starts with `_`, so that listings leave it out."""
    return "/_" in name or name.startswith("_")


def fully_qualified(namespace: str, node: str) -> str:
    """`/robot1/server` from a namespace and a node's name."""
    return f"{namespace.rstrip('/')}/{node}"


def _check_raw(name: str, kind: str) -> None:
    _refuse_if(not name, name, 0, kind, "topic name must not be empty string")
    ends = name.endswith("/")
    _refuse_if(ends, name, len(name) - 1, kind, "topic name must not end with a forward slash")
    if found := _NOT_TOPIC.search(name):
        problem = (
            "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'"
        )
        raise InvalidName(name, found.start(), kind=kind, problem=problem)
    _check_tilde(name, kind)
    _check_braces(name, kind)
    _check_tokens(name, kind, "topic name token must not start with a number")


def _check_tilde(name: str, kind: str) -> None:
    later = name.find("~", 1)
    problem = "topic name must not have tilde '~' unless it is the first character"
    _refuse_if(later > 0, name, later, kind, problem)
    alone = name.startswith("~") and len(name) > 1 and name[1] != "/"
    problem = "topic name must not have a tilde '~' that is not followed by a forward slash '/'"
    _refuse_if(alone, name, 1, kind, problem)


def _check_braces(name: str, kind: str) -> None:
    rest = _SUBSTITUTION.sub(lambda found: "_" * len(found[0]), name)
    stray = min((rest.find(brace) for brace in "{}" if brace in rest), default=-1)
    problem = "topic name must not have unmatched (unbalanced) curly braces '{}'"
    _refuse_if(stray >= 0, name, stray, kind, problem)


def _substituted(name: str, names: dict[str, str], kind: str) -> Iterator[str]:
    end = 0
    for found in _SUBSTITUTION.finditer(name):
        problem = f"unknown substitution '{found[0]}', expected {{node}} or {{ns}}"
        _refuse_if(found[1] not in names, name, found.start() + 1, kind, problem)
        yield name[end : found.start()]
        value = names[found[1]]
        # `/{ns}/x` with ns `/a` means `/a/x`, not `//a/x`.
        yield value.lstrip("/") if name[: found.start()].endswith("/") else value
        end = found.end()
    yield name[end:]


def _check_tokens(name: str, kind: str, digit_problem: str) -> None:
    repeated = name.find("//")
    subject = kind if kind == "namespace" else "topic name"
    problem = f"{subject} must not contain repeated '/'"
    _refuse_if(repeated >= 0, name, repeated + 1, kind, problem)
    if found := _DIGIT_TOKEN.search(name):
        raise InvalidName(name, found.end(), kind=kind, problem=digit_problem)


def _check_length(name: str, limit: int, kind: str) -> None:
    problem = f"{kind} must not be longer than {limit} characters"
    _refuse_if(len(name) > limit, name, limit, kind, problem)


def _refuse_if(wrong: bool, name: str, index: int, kind: str, problem: str) -> None:
    if wrong:
        raise InvalidName(name, index, kind=kind, problem=problem)
