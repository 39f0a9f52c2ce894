"""Names of nodes, namespaces, services and topics by ROS 2's rules: checked and expanded."""

from __future__ import annotations

import re
import string

from taskrpc.errors import InvalidName

_MAX_NODE, _MAX_NAMESPACE, _MAX_TOPIC = 255, 245, 247
_DIGITS = frozenset(string.digits)
_WORD = frozenset(f"{string.ascii_letters}{string.digits}_")
_PATH = _WORD | {"/"}
# Python compiles these patterns when a name first needs them: most names have no `~` and no `{`.
_WELL_FORMED = r"(?:\A~|[A-Za-z0-9_/]|\{(?:[A-Za-z_][A-Za-z0-9_]*)?\})*"
_OPEN_SUBSTITUTION = r"\{[A-Za-z0-9_]*"
_SUBSTITUTION = r"\{([^{}]*)\}"
_DIGIT_PROBLEM = "topic name token must not start with a number"
_OTHER_CHARACTER = (
    "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'"
)
_OTHER_THAN_PATH = "topic name must not contain characters other than alphanumerics, '_', or '/'"
"""The rule for names after expansion."""
_CHARACTER_PROBLEMS = {
    "}": "topic name must not have unmatched (unbalanced) curly braces '{}'",
    "~": "topic name must not have tilde '~' unless it is the first character",
}

_OF_EVERY_NODE = frozenset(
    (
        "describe_parameters",
        "get_logger_levels",
        "get_parameter_types",
        "get_parameters",
        "get_type_description",
        "list_parameters",
        "set_logger_levels",
        "set_parameters",
        "set_parameters_atomically",
    )
)


def check_node_name(name: str) -> str:
    """Return a node's name, or raise `InvalidName` with the offending character."""
    kind = "node name"
    _refuse_if(not name, name, 0, kind, "node name must not be empty")
    problem = "node name must not contain characters other than alphanumerics or '_'"
    _refuse_others(name, _WORD, kind, problem)
    _refuse_if(name[0].isdigit(), name, 0, kind, "node name must not start with a number")
    _check_length(name, _MAX_NODE, kind)
    return name


def check_namespace(namespace: str) -> str:
    """Return an absolute namespace (`""` becomes `/`, `robot1` becomes `/robot1`), or raise."""
    kind = "namespace"
    name = namespace if namespace.startswith("/") else f"/{namespace}"
    problem = "namespace must not contain characters other than alphanumerics, '_', or '/'"
    _refuse_others(name, _PATH, kind, problem)
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
    check_unexpanded(name, kind)
    nowhere = not node and name.startswith("~")
    _refuse_if(nowhere, name, 0, kind, "'~' stands for a node, and there is none here")
    expanded = _substituted(name, namespace, node, kind)
    if expanded.startswith("~"):
        expanded = fully_qualified(namespace, node) + expanded[1:]
    elif not expanded.startswith("/"):
        expanded = fully_qualified(namespace, expanded)
    # A namespace brings slashes of its own: `/{ns}/x` in `/a` means `/a/x`, not `//a/x`.
    expanded = f"/{expanded}"
    while "//" in expanded:
        expanded = expanded.replace("//", "/")
    _check_whole(expanded, kind)
    return expanded


def relative(name: str, *, namespace: str) -> str:
    """Return an absolute name relative to a namespace; unchanged outside of it, and in `/`."""
    own = f"{namespace}/"
    return name.removeprefix(own) if namespace != "/" else name


def check_unexpanded(
    name: str, kind: str = "service name", *, repeated_slashes: bool = False
) -> None:
    """Raise `InvalidName` for what no node can have, whatever `~` and `{}` mean to it.

    With `repeated_slashes`, allow `a//b`, which ROS rejects only after the expansion.
    """
    _refuse_if(not name, name, 0, kind, "topic name must not be empty string")
    _check_end(name, kind, "forward slash")
    _refuse_if(name[0] in "0123456789", name, 0, kind, _DIGIT_PROBLEM)
    index = len(name) if _PATH.issuperset(name) else _end_of(_WELL_FORMED, name, 0)
    if index < len(name):
        index, problem = _broken_at(name, index)
        raise _invalid(name, index, kind, problem)
    alone = name.startswith("~") and name[1:2] not in ("", "/")
    problem = "topic name must not have a tilde '~' that is not followed by a forward slash '/'"
    _refuse_if(alone, name, 1, kind, problem)
    _check_tokens(name, kind, _DIGIT_PROBLEM, repeated_slashes=repeated_slashes)


def check_absolute(name: str, kind: str = "service name") -> None:
    """Raise `InvalidName` if a name is not absolute and fully expanded."""
    _refuse_if(not name, name, 0, kind, "topic name must not be empty string")
    problem = "topic name must be absolute, it must lead with a '/'"
    _refuse_if(not name.startswith("/"), name, 0, kind, problem)
    _check_whole(name, kind)


def is_hidden(name: str) -> bool:
    """Return whether a token of the name starts with `_`, so that lists omit the name."""
    return "/_" in name or name.startswith("_")


def is_hidden_node(name: str) -> bool:
    """Return whether lists of nodes omit a node: only its own name decides, not its namespace."""
    return name.rpartition("/")[2].startswith("_")


def is_of_every_node(service: str) -> bool:
    """Return whether every node of ROS has a service of this last name.

    With some of these services a caller can change any node.
    """
    return service.rpartition("/")[2] in _OF_EVERY_NODE


def fully_qualified(namespace: str, node: str) -> str:
    """Return `/robot1/server` for the namespace `/robot1` and the node's name `server`."""
    return f"{namespace.rstrip('/')}/{node}"


def _broken_at(name: str, index: int) -> tuple[int, str]:
    """Return the position at or after `index` where the name breaks a rule, and the rule."""
    if name[index] != "{":
        return index, _CHARACTER_PROBLEMS.get(name[index], _OTHER_CHARACTER)
    end = _end_of(_OPEN_SUBSTITUTION, name, index)
    if name[index + 1 : index + 2].isdigit():
        return index + 1, "substitution name must not start with a number"
    if end == len(name):
        return index, _CHARACTER_PROBLEMS["}"]
    if name[end] == "~":
        return end, _CHARACTER_PROBLEMS["~"]
    return end, "substitution name must not contain characters other than alphanumerics or '_'"


def _substituted(name: str, namespace: str, node: str, kind: str) -> str:
    if "{" not in name:
        return name
    values = {"node": node, "ns": namespace, "namespace": namespace}
    for found in re.finditer(_SUBSTITUTION, name):
        problem = f"unknown substitution '{found[0]}', expected {{node}} or {{ns}}"
        _refuse_if(found[1] not in values, name, found.start() + 1, kind, problem)
        nowhere = not values[found[1]]
        problem = f"'{found[0]}' stands for a {found[1]}, and there is none here"
        _refuse_if(nowhere, name, found.start() + 1, kind, problem)
    return re.sub(_SUBSTITUTION, lambda found: values[found[1]], name)


def _check_whole(name: str, kind: str) -> None:
    _check_end(name, kind, "'/'")
    _refuse_others(name, _PATH, kind, _OTHER_THAN_PATH)
    _check_tokens(name, kind, _DIGIT_PROBLEM)
    _check_length(name, _MAX_TOPIC, kind)


def _check_end(name: str, kind: str, slash: str) -> None:
    problem = f"topic name must not end with a {slash}"
    _refuse_if(name.endswith("/"), name, len(name) - 1, kind, problem)


def _end_of(pattern: str, name: str, start: int) -> int:
    found = re.compile(pattern).match(name, start)
    return found.end() if found else start


def _check_tokens(
    name: str, kind: str, digit_problem: str, *, repeated_slashes: bool = False
) -> None:
    repeated = -1 if repeated_slashes else name.find("//")
    subject = kind if kind == "namespace" else "topic name"
    problem = f"{subject} must not contain repeated '/'"
    _refuse_if(repeated >= 0, name, repeated + 1, kind, problem)
    index = 0
    for token in name.split("/"):
        _refuse_if(token[:1] in _DIGITS, name, index, kind, digit_problem)
        index += len(token) + 1


def _check_length(name: str, limit: int, kind: str) -> None:
    problem = f"{kind} must not be longer than {limit} characters"
    _refuse_if(len(name) > limit, name, limit, kind, problem)


def _refuse_others(name: str, allowed: frozenset[str], kind: str, problem: str) -> None:
    """Raise `InvalidName` at the first character that is not allowed."""
    if not allowed.issuperset(name):
        index = next(at for at, character in enumerate(name) if character not in allowed)
        raise _invalid(name, index, kind, problem)


def _refuse_if(wrong: bool, name: str, index: int, kind: str, problem: str) -> None:
    if wrong:
        raise _invalid(name, index, kind, problem)


def _invalid(name: str, index: int, kind: str, problem: str) -> InvalidName:
    # The rules are the same for topics and services, but their texts say "topic name".
    return InvalidName(name, index, kind=kind, problem=problem.replace("topic name", kind, 1))
