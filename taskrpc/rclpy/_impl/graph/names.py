"""Names by ROS's rules, with rclpy's own exceptions for those that break them."""

from __future__ import annotations

from collections.abc import Callable

from taskrpc.errors import InvalidName

from ...exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NameValidationException,
)

_EXCEPTIONS: dict[str, Callable[[str, str, int], NameValidationException]] = {
    "namespace": InvalidNamespaceException,
    "node name": InvalidNodeNameException,
    "service name": InvalidServiceNameException,
    "topic name": InvalidTopicNameException,
}


def kind_of(is_service: bool) -> str:
    """What a name is called in errors."""
    return "service name" if is_service else "topic name"


def translated(error: InvalidName) -> NameValidationException:
    """rclpy's exception for a name that breaks a rule."""
    return _EXCEPTIONS[error.kind](error.name, ros_problem(error), error.index)


def ros_problem(error: InvalidName) -> str:
    """The rule in ROS's words, which say "topic name" for services too."""
    return error.problem.replace("service name", "topic name", 1)


def refuse_other_than_text(name: object, kind: str) -> None:
    """Raise TypeError for a name that is no text."""
    if not isinstance(name, str):
        raise TypeError(f"expected a {kind} (str), got {name!r}")
