"""The ROS arguments of a command line, from `--ros-args` to `--`, and the remapping of names."""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from taskrpc.errors import InvalidName
from taskrpc.spi import names, read_text

from ..exceptions import RCLInvalidROSArgsError, UnknownROSArgsError

if TYPE_CHECKING:
    from .parameters.yaml_parameters import Parameters, Value

ROS_ARGS = "--ros-args"
END_OF_ROS_ARGS = "--"

_TOKEN = r"[A-Za-z_]\w*"
_NAME = rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*"
_PREFIX = re.compile(rf"({_TOKEN}):(?!=|//)")
_NODE_RULE = re.compile(rf"__(?:node|name):=({_TOKEN})")
_NAMESPACE_RULE = re.compile(rf"__ns:=(/(?:{_TOKEN}(?:/{_TOKEN})*)?)/?")
_NAME_RULE = re.compile(rf"(rostopic://|rosservice://)?({_NAME}):=({_NAME})")
_PARAMETER = re.compile(r"([^\s:]+):=(.*)", re.DOTALL)
_LOG_RULE = re.compile(r"([^\s:]+):=(\w+)")
_ENCLAVE = re.compile(r"/|(?:/\w+)+")
_SEVERITIES = {"UNSET": 0, "DEBUG": 10, "INFO": 20, "WARN": 30, "ERROR": 40, "FATAL": 50}
_SWITCHES = {
    f"--{verb}-{what}": (what, verb == "enable")
    for what in ("rosout-logs", "stdout-logs", "external-lib-logs")
    for verb in ("enable", "disable")
}


class RemapKind(enum.Enum):
    """The kinds of names that a rule replaces."""

    NODE = "__node"
    NAMESPACE = "__ns"
    TOPIC = "rostopic://"
    SERVICE = "rosservice://"
    TOPIC_OR_SERVICE = ""


@dataclass(frozen=True)
class RemapRule:
    """One `-r [node:]from:=to`."""

    kind: RemapKind
    match: str
    """The name to replace, before expansion; empty for nodes and namespaces."""
    replacement: str
    node_name: str | None = None
    """The only node to which the rule applies; None means all nodes."""


@dataclass
class Arguments:
    """The parts of a command line."""

    rest: list[str] = field(default_factory=list)
    """The arguments that do not belong to ROS, in their order."""
    remaps: list[RemapRule] = field(default_factory=list)
    """The rules in their order: the first one that applies is used."""
    parameters: Parameters = field(default_factory=dict)
    """The values of `-p` and `--params-file`; later values replace earlier ones."""
    log_level: int | None = None
    """The lowest severity that loggers log by default."""
    log_levels: dict[str, int] = field(default_factory=dict)
    """The lowest severity that a logger logs, by the name of the logger."""
    rosout_logs: bool | None = None
    stdout_logs: bool | None = None
    external_lib_logs: bool | None = None
    unknown: list[str] = field(default_factory=list)
    """Options after `--ros-args` that ROS does not have."""
    warnings: list[str] = field(default_factory=list)
    """Warnings of ROS about these arguments, for the logger `rcl`."""


def parse(
    args: Sequence[str], failed: str = "Failed to parse ROS arguments", strict: bool = True
) -> Arguments:
    """Read a command line, with or without the program's name, and its parameter files.

    Args:
        args: the arguments after the interpreter.
        failed: how the message of an error begins.
        strict: whether unknown ROS arguments are an error.

    Raises:
        RCLInvalidROSArgsError: a rule or a file cannot be read.
        UnknownROSArgsError: ROS does not have an option.
    """
    found = Arguments()
    reader = _Reader(found, iter(args))
    try:
        reader.read()
    except ValueError as error:
        raise RCLInvalidROSArgsError(f"{failed}: {error}") from None
    if found.unknown and strict:
        raise UnknownROSArgsError(f"Found unknown ROS arguments: {found.unknown}")
    return found


def overrides_of(parameters: Sequence[Parameters], fully_qualified_name: str) -> dict[str, Value]:
    """The values of one or more command lines that apply to a node, by name or by wildcards.

    Later command lines take precedence over earlier ones, and so do later node names of one line.
    """
    found: dict[str, Value] = {}
    for one in parameters:
        for name, values in one.items():
            if fits(name, fully_qualified_name):
                found.update(values)
    return found


def fits(name: str, fully_qualified_name: str) -> bool:
    """Whether a name selects a node; `*` stands for one part, `**` for any number of parts."""
    rooted = name if name.startswith("/") else f"/{name}"
    pattern = re.escape(rooted).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"(/\w+)")
    return re.fullmatch(pattern, fully_qualified_name) is not None


class _Reader:
    """Reads one command line. Raises ValueError with the text of ROS."""

    def __init__(self, found: Arguments, args: Iterator[str]) -> None:
        self._found = found
        self._args = args

    def read(self) -> None:
        is_ros = False
        for argument in self._args:
            if argument == ROS_ARGS:
                is_ros = True
            elif is_ros and argument == END_OF_ROS_ARGS:
                is_ros = False
            elif is_ros:
                self._option(argument)
            else:
                self._plain(argument)

    def _plain(self, argument: str) -> None:
        """Read one argument outside of `--ros-args`; ROS still accepts old remap rules there."""
        try:
            self._found.remaps.append(remap_rule(argument))
        except ValueError:
            self._found.rest.append(argument)
            return
        self._found.warnings.append(
            f"Found remap rule '{argument}'. This syntax is deprecated."
            f" Use '{ROS_ARGS} --remap {argument}' instead."
        )

    def _option(self, flag: str) -> None:
        if flag in _SWITCHES:
            what, on = _SWITCHES[flag]
            setattr(self._found, what.replace("-", "_"), on)
        elif flag in _OPTIONS:
            option = _OPTIONS[flag]
            value = next(self._args, None)
            if value is None:
                raise ValueError(f"Couldn't parse trailing {flag} flag. {option.missing}")
            try:
                option.take(self._found, value)
            except ValueError as error:
                problem = f"Couldn't parse {option.name}: '{flag} {value}'. Error: {error}"
                raise ValueError(problem) from None
        else:
            self._found.unknown.append(flag)


def remap_rule(text: str) -> RemapRule:
    """Read `[node:]from:=to`. Raises ValueError with the text of ROS."""
    if ":=" not in text:
        raise ValueError("Expected a rule of the form 'from:=to'")
    node_name, rule = None, text
    if prefix := _PREFIX.match(text):
        node_name, rule = prefix[1], text[prefix.end() :]
    if match := _NODE_RULE.fullmatch(rule):
        return RemapRule(RemapKind.NODE, "", match[1], node_name)
    if match := _NAMESPACE_RULE.fullmatch(rule):
        return RemapRule(RemapKind.NAMESPACE, "", match[1], node_name)
    if rule.startswith("__ns:="):
        raise ValueError(f"Namespace not remapped to a fully qualified name (found: {rule[6:]})")
    if match := _NAME_RULE.fullmatch(rule):
        return RemapRule(RemapKind(match[1] or ""), match[2], match[3], node_name)
    for wildcard in ("**", "*"):
        if wildcard in rule.partition(":=")[0]:
            raise ValueError(f"Wildcard '{wildcard}' is not implemented")
    raise ValueError("Expecting token or wildcard")


def _take_remap(found: Arguments, text: str) -> None:
    found.remaps.append(remap_rule(text))


def _take_parameter(found: Arguments, text: str) -> None:
    from .parameters.yaml_parameters import ANY_NODE, read_value  # few programs need YAML

    node, rule = ANY_NODE, text
    if prefix := _PREFIX.match(text):
        node, rule = prefix[1], text[prefix.end() :]
    match = _PARAMETER.fullmatch(rule)
    if match is None:
        raise ValueError("Expected a rule of the form 'name:=value'")
    found.parameters.setdefault(node, {})[match[1]] = read_value(match[2])


def _take_file(found: Arguments, path: str) -> None:
    from .parameters.yaml_parameters import read_file

    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError):
        raise ValueError("Error opening YAML file") from None
    for node, values in read_file(text).items():
        found.parameters.setdefault(node, {}).update(values)


def _take_log_level(found: Arguments, text: str) -> None:
    match = _LOG_RULE.fullmatch(text)
    name, word = (match[1], match[2]) if match else ("", text)
    level = _SEVERITIES.get(word.upper())
    if level is None:
        raise ValueError("Argument does not use a valid severity level")
    if name:
        found.log_levels[name] = level
    else:
        found.log_level = level


def _check_enclave(found: Arguments, text: str) -> None:
    if _ENCLAVE.fullmatch(text) is None:
        raise ValueError("Expected an absolute name such as '/enclave'")


def _ignore(found: Arguments, text: str) -> None:
    """Accept a value that has no effect here."""


@dataclass(frozen=True)
class _Option:
    """An option with a value."""

    name: str
    """What errors call it."""
    missing: str
    """The end of the error if the value is missing."""
    take: Callable[[Arguments, str], None]


_REMAP = _Option("remap rule", "No remap rule found.", _take_remap)
_PARAM = _Option("parameter override rule", "No parameter override rule found.", _take_parameter)
_ENCLAVE_OPTION = _Option("enclave name", "No enclave path found.", _check_enclave)
_OPTIONS: Mapping[str, _Option] = {
    "-r": _REMAP,
    "--remap": _REMAP,
    "-p": _PARAM,
    "--param": _PARAM,
    "--params-file": _Option("params file", "No file path provided.", _take_file),
    "--log-level": _Option("log level rule", "No log level rule found.", _take_log_level),
    "--log-config-file": _Option("log config file", "No file path provided.", _ignore),
    "--log-file-name": _Option("log file name", "No string provided.", _ignore),
    "-e": _ENCLAVE_OPTION,
    "--enclave": _ENCLAVE_OPTION,
}


class Remapping:
    """The rules that apply to one node: its own come first, then those of the program."""

    def __init__(self, rules: Iterable[RemapRule] = ()) -> None:
        self._rules = list(rules)

    def node_name(self, name: str) -> str:
        """The name of the node that replaces `name`."""
        return self._first(RemapKind.NODE, name, name)

    def namespace(self, namespace: str, node: str) -> str:
        """The namespace of this node that replaces `namespace`."""
        return self._first(RemapKind.NAMESPACE, node, namespace)

    def topic(self, name: str, namespace: str, node: str) -> str:
        """The name that replaces an expanded topic name."""
        return self._name(RemapKind.TOPIC, name, namespace, node)

    def service(self, name: str, namespace: str, node: str) -> str:
        """The name that replaces an expanded service name."""
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
            is_of_kind = rule.kind in (kind, RemapKind.TOPIC_OR_SERVICE)
            if (
                is_of_kind
                and rule.node_name in (None, node)
                and _expanded_or_empty(expanded, rule.match) == name
            ):
                return expanded(rule.replacement)
        return name


def _expanded_or_empty(expanded: Callable[[str], str], text: str) -> str:
    try:
        return expanded(text)
    except InvalidName:  # the rule is for another kind of name
        return ""
