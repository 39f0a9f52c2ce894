"""ROS's rules for names, with rclpy's exceptions for names that break a rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from taskrpc.errors import InvalidName

from ...exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NameValidationException,
)

T = TypeVar("T")
_EXCEPTIONS: dict[str, Callable[[str, str, int], NameValidationException]] = {
    "namespace": InvalidNamespaceException,
    "node name": InvalidNodeNameException,
    "service name": InvalidServiceNameException,
    "topic name": InvalidTopicNameException,
}


def kind_of(is_service: bool) -> str:
    """How error messages call a name."""
    return "service name" if is_service else "topic name"


def checked(kind: str, name: str, check: Callable[[str], T]) -> T:
    """The value that `check` returns for a name.

    Raises TypeError for a name that is not a str, and rclpy's exception for one that breaks a rule.
    """
    if not isinstance(name, str):
        raise TypeError(f"expected a {kind} (str), got {name!r}")
    try:
        return check(name)
    except InvalidName as error:
        raise _EXCEPTIONS[error.kind](error.name, ros_problem(error), error.index) from None


def ros_problem(error: InvalidName) -> str:
    """The rule in the words of ROS, which call a service name "topic name", too."""
    return error.problem.replace("service name", "topic name", 1)
