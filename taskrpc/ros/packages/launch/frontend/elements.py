"""The elements and substitutions of XML and YAML launch files, apart from those of ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from taskrpc.ros.command_line import split_words

from .. import substitutions as s
from ..action import Action
from ..actions import arguments as a
from ..actions import control as c
from ..actions.execute_process import ExecuteProcess
from ..actions.include_launch_description import IncludeLaunchDescription
from ..launch_description_sources import AnyLaunchDescriptionSource
from ..substitution import Substitution, TextSubstitution
from .entity import Entity
from .expose import action_parsers, substitution_parsers

Entities = list[Entity]


@cache
def register() -> None:
    """Add the elements and substitutions to the tables."""
    for name, build in _ELEMENTS.items():
        action_parsers.setdefault(name, build)
    for name, make in _SUBSTITUTIONS.items():
        substitution_parsers.setdefault(name, make)


def base(entity: Entity, parser: Any) -> dict[str, Any]:
    """The arguments that every action has: its condition."""
    return Action.parse(entity, parser)[1]


def text(entity: Entity, parser: Any, name: str) -> Any:
    """The substitutions of an attribute, None if it is missing."""
    value = entity.get_attr(name, optional=True)
    return None if value is None else parser.parse_substitution(value)


def given(**values: Any) -> dict[str, Any]:
    """The values that are not None."""
    return {name: value for name, value in values.items() if value is not None}


def _arg(entity: Entity, parser: Any) -> Any:
    choices = entity.get_attr("choice", data_type=Entities, optional=True)
    values = None if choices is None else [each.get_attr("value") for each in choices]
    return a.DeclareLaunchArgument(
        entity.get_attr("name"),
        default_value=text(entity, parser, "default"),
        description=entity.get_attr("description", optional=True),
        choices=values,
        **base(entity, parser),
    )


def _pair(action: Callable[..., Any]) -> Callable[[Entity, Any], Any]:
    """An element with `name` and `value`."""

    def build(entity: Entity, parser: Any) -> Any:
        name, value = entity.get_attr("name"), entity.get_attr("value")
        parse = parser.parse_substitution
        return action(parse(name), parse(value), **base(entity, parser))

    return build


def _name_only(action: Callable[..., Any]) -> Callable[[Entity, Any], Any]:
    """An element with `name`."""

    def build(entity: Entity, parser: Any) -> Any:
        name = parser.parse_substitution(entity.get_attr("name"))
        return action(name, **base(entity, parser))

    return build


def _plain(action: Callable[..., Any]) -> Callable[[Entity, Any], Any]:
    """An element without attributes of its own."""
    return lambda entity, parser: action(**base(entity, parser))


def _append_env(entity: Entity, parser: Any) -> Any:
    return a.AppendEnvironmentVariable(
        parser.parse_substitution(entity.get_attr("name")),
        parser.parse_substitution(entity.get_attr("value")),
        **given(
            prepend=text(entity, parser, "prepend"), separator=text(entity, parser, "separator")
        ),
        **base(entity, parser),
    )


def _group(entity: Entity, parser: Any) -> Any:
    keep = entity.get_attr("keep", data_type=Entities, optional=True)
    kept = {
        each.get_attr("name"): parser.parse_substitution(each.get_attr("value"))
        for each in keep or ()
    }
    return c.GroupAction(
        [parser.parse_action(each) for each in entity.children if each.type_name != "keep"],
        launch_configurations=kept,
        **given(
            scoped=entity.get_attr("scoped", data_type=bool, optional=True, can_be_str=False),
            forwarding=entity.get_attr(
                "forwarding", data_type=bool, optional=True, can_be_str=False
            ),
        ),
        **base(entity, parser),
    )


def _include(entity: Entity, parser: Any) -> Any:
    pairs = [
        (parser.parse_substitution(each.get_attr("name")), parser.parse_substitution(value))
        for tag in ("arg", "let")
        for each in entity.get_attr(tag, data_type=Entities, optional=True) or ()
        if (value := each.get_attr("value")) is not None
    ]
    source = AnyLaunchDescriptionSource(parser.parse_substitution(entity.get_attr("file")))
    return IncludeLaunchDescription(source, launch_arguments=pairs, **base(entity, parser))


def _timer(entity: Entity, parser: Any) -> Any:
    return c.TimerAction(
        period=parser.parse_substitution(entity.get_attr("period")),
        actions=[parser.parse_action(each) for each in entity.children],
        **base(entity, parser),
    )


def _log(entity: Entity, parser: Any) -> Any:
    message = parser.parse_substitution(entity.get_attr("message"))
    level = text(entity, parser, "level")
    return c.Log(msg=message, **given(level=level), **base(entity, parser))


def _log_of(action: Callable[..., Any]) -> Callable[[Entity, Any], Any]:
    def build(entity: Entity, parser: Any) -> Any:
        message = parser.parse_substitution(entity.get_attr("message"))
        return action(msg=message, **base(entity, parser))

    return build


def _shutdown(entity: Entity, parser: Any) -> Any:
    reason = entity.get_attr("reason", optional=True)
    return c.Shutdown(**given(reason=reason), **base(entity, parser))


def process_arguments(entity: Entity, parser: Any) -> dict[str, Any]:
    """The arguments that all actions with a program have."""
    env = entity.get_attr("env", data_type=Entities, optional=True)
    variables = None
    if env is not None:
        variables = {
            each.get_attr("name"): parser.parse_substitution(each.get_attr("value")) for each in env
        }
    on_exit = entity.get_attr("on_exit", optional=True)
    if on_exit not in (None, "shutdown"):
        raise ValueError(f"expected shutdown as on_exit, got '{on_exit}'")
    delay = entity.get_attr("respawn_delay", data_type=float, optional=True, can_be_str=False)
    return {
        **base(entity, parser),
        **given(
            additional_env=variables,
            on_exit=None if on_exit is None else [c.Shutdown()],
            cwd=text(entity, parser, "cwd"),
            prefix=text(entity, parser, "launch-prefix"),
            output=text(entity, parser, "output"),
            respawn=text(entity, parser, "respawn"),
            respawn_delay=delay,
            respawn_max_retries=entity.get_attr(
                "respawn_max_retries", data_type=int, optional=True, can_be_str=False
            ),
            emulate_tty=text(entity, parser, "emulate_tty"),
            sigterm_timeout=text(entity, parser, "sigterm_timeout"),
            sigkill_timeout=text(entity, parser, "sigkill_timeout"),
        ),
    }


def _executable(entity: Entity, parser: Any) -> Any:
    shell = entity.get_attr("shell", data_type=bool, optional=True, can_be_str=False)
    return ExecuteProcess(
        cmd=split(parser.parse_substitution(entity.get_attr("cmd"))),
        **given(shell=shell, name=text(entity, parser, "name")),
        **process_arguments(entity, parser),
    )


def split(parts: Iterable[Substitution]) -> list[list[Substitution]]:
    """Split a command line into its words: spaces separate them only in plain texts."""
    words: list[list[Substitution]] = [[]]
    for part in parts:
        if not isinstance(part, TextSubstitution):
            words[-1].append(part)
            continue
        pieces = _pieces(part.text)
        for index, piece in enumerate(pieces):
            if index:
                words.append([])
            if piece:
                words[-1].append(TextSubstitution(text=piece))
    return [each for each in words if each]


def _pieces(value: str) -> list[str]:
    """The words of a plain text; "" at its start or end means that it begins or ends a word."""
    try:
        found = split_words(value)
    except ValueError:
        found = value.split()
    front = [""] if value[:1].isspace() else []
    back = [""] if value[-1:].isspace() and found else []
    return [*front, *found, *back] or [""]


_ELEMENTS: dict[str, Callable[[Entity, Any], Any]] = {
    "arg": _arg,
    "let": _pair(a.SetLaunchConfiguration),
    "set_launch_configuration": _pair(a.SetLaunchConfiguration),
    "unset_launch_configuration": _name_only(a.UnsetLaunchConfiguration),
    "set_env": _pair(a.SetEnvironmentVariable),
    "unset_env": _name_only(a.UnsetEnvironmentVariable),
    "append_env": _append_env,
    "push_env": _plain(a.PushEnvironment),
    "pop_env": _plain(a.PopEnvironment),
    "reset_env": _plain(a.ResetEnvironment),
    "push_launch_configurations": _plain(a.PushLaunchConfigurations),
    "pop_launch_configurations": _plain(a.PopLaunchConfigurations),
    "group": _group,
    "include": _include,
    "timer": _timer,
    "log": _log,
    "log_info": _log_of(c.LogInfo),
    "log_debug": _log_of(c.LogDebug),
    "log_warning": _log_of(c.LogWarning),
    "log_error": _log_of(c.LogError),
    "shutdown": _shutdown,
    "executable": _executable,
}


def _var(name: Any, default: Any = None) -> Substitution:
    return s.LaunchConfiguration(name, default=default)


def _env(name: Any, default_value: Any = None) -> Substitution:
    return s.EnvironmentVariable(name, default_value=default_value)


def _eval(expression: Any, modules: Any = None) -> Substitution:
    if modules is None:
        return s.PythonExpression(expression)
    names = "".join(each.perform(None) for each in modules)
    return s.PythonExpression(expression, [each.strip() for each in names.split(",")])


def _command(command: Any, on_stderr: Any = "fail") -> Substitution:
    return s.Command(command, on_stderr=on_stderr)


_SUBSTITUTIONS: dict[str, Callable[..., Substitution]] = {
    "var": _var,
    "env": _env,
    "eval": _eval,
    "command": _command,
    "dirname": s.ThisLaunchFileDir,
    "filename": s.ThisLaunchFile,
    "launch_log_dir": s.LaunchLogDir,
    "log_dir": s.LaunchLogDir,
    "find-exec": lambda name: s.FindExecutable(name=name),
    "file-content": s.FileContent,
    "anon": s.AnonName,
    "not": s.NotSubstitution,
    "and": s.AndSubstitution,
    "or": s.OrSubstitution,
    "any": s.AnySubstitution,
    "all": s.AllSubstitution,
    "equals": s.EqualsSubstitution,
    "not-equals": s.NotEqualsSubstitution,
    "if": s.IfElseSubstitution,
    "path-join": lambda *parts: s.PathJoinSubstitution(parts),
    "string-join": lambda delimiter, *parts: s.StringJoinSubstitution(parts, delimiter),
}


def action_of(name: str) -> Callable[[Entity, Any], Any]:
    """The function that turns an element of this name into an action."""
    return _ELEMENTS[name]
