"""Prints a launch description as a tree."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .actions.control import EmitEvent, Log, RegisterEventHandler
from .actions.execute_process import ExecuteProcess
from .launch_description import LaunchDescription
from .launch_description_entity import LaunchDescriptionEntity, entities_of
from .substitution import normalize_to_list_of_substitutions


def format_substitutions(substitutions: Any) -> str:
    """Describe substitutions whose texts are joined."""
    return " + ".join(each.describe() for each in normalize_to_list_of_substitutions(substitutions))


def format_action(action: LaunchDescriptionEntity) -> str:
    """Describe one action in one line."""
    if isinstance(action, Log):
        return f"{type(action).__name__}({format_substitutions(action.msg)})"
    if isinstance(action, EmitEvent):
        return f"EmitEvent(event='{action.event.name}')"
    if isinstance(action, ExecuteProcess):
        return _format_process(action)
    if isinstance(action, RegisterEventHandler):
        return f"RegisterEventHandler('{action.event_handler.describe()[0]}'):"
    if isinstance(action, LaunchDescription):
        return type(action).__name__
    description = action.describe()
    is_plain = description == repr(action)
    return f"Action('{type(action).__name__}')" if is_plain else f"Action('{description}')"


def _format_process(action: ExecuteProcess) -> str:
    cmd = ", ".join(format_substitutions(each) for each in action.cmd)
    cwd = None if action.cwd is None else f"'{format_substitutions(action.cwd)}'"
    env = None
    if action.env is not None:
        pairs = (
            f"{format_substitutions(name)}: {format_substitutions(str(value))}"
            for name, value in action.env.items()
        )
        env = f"{{{', '.join(pairs)}}}"
    return f"ExecuteProcess(cmd=[{cmd}], cwd={cwd}, env={env}, shell={action.shell})"


def _lines(entities: Iterable[LaunchDescriptionEntity], front: str) -> list[str]:
    found: list[str] = []
    each = list(entities)
    for index, entity in enumerate(each):
        is_last = index == len(each) - 1
        found.append(f"{front}{'└── ' if is_last else '├── '}{format_action(entity)}")
        found += _lines(_inner(entity), f"{front}{'    ' if is_last else '│   '}")
    return found


def _inner(entity: LaunchDescriptionEntity) -> list[LaunchDescriptionEntity]:
    found = entities_of(entity.describe_sub_entities())
    for _, some in entity.describe_conditional_sub_entities():
        found += some
    return found


class LaunchIntrospector:
    """Prints launch descriptions."""

    def format_launch_description(self, launch_description: LaunchDescription) -> str:
        """Return a launch description as a tree of its actions."""
        return "\n".join(["LaunchDescription", *_lines(launch_description.entities, "")])
