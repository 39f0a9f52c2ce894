"""The exceptions of rclpy."""

from __future__ import annotations

from typing import Any

from taskrpc.errors import TaskRpcError


class NotInitializedException(Exception):
    """An operation needs a context for which `rclpy.init()` was not called."""

    def __init__(self, message: str | None = None) -> None:
        more = "" if message is None else f" msg:{message}"
        super().__init__(f"rclpy.init() has not been called.{more}")


class NoTypeSupportImportedException(Exception):
    """A class that is not a message type was used as one."""

    def __init__(self, *args: Any) -> None:
        super().__init__("no type_support imported", *args)


class RCLError(RuntimeError):
    """An operation that ROS refuses."""


class InvalidHandle(RuntimeError):
    """A node, client, timer or other entity is used after it was destroyed."""


class TimerCancelledError(RCLError):
    """A cancelled timer is called."""


class NodeNameNonExistentError(RCLError):
    """The graph has no node of this name."""


class RCLInvalidROSArgsError(RCLError, TaskRpcError):
    """An argument after `--ros-args` is invalid; a program that does not catch it prints one line.

    So does UnknownROSArgsError: the user made the mistake, not the program.
    """


class UnknownROSArgsError(RuntimeError, TaskRpcError):
    """An option after `--ros-args` is unknown to ROS."""


class RMWError(RuntimeError):
    """A middleware operation fails, such as the decoding of a message."""


class UnsupportedEventTypeError(RCLError):
    """taskrpc never reports this event."""


for _shown in (
    RCLError,
    InvalidHandle,
    TimerCancelledError,
    NodeNameNonExistentError,
    RCLInvalidROSArgsError,
    RMWError,
    UnknownROSArgsError,
    UnsupportedEventTypeError,
):
    _shown.__module__ = "rclpy._rclpy_pybind11"  # so tracebacks show them as ROS does


class NameValidationException(ValueError):
    """A name breaks ROS's rules; the message shows where, by a caret under the name."""

    def __init__(
        self, name_type: str, name: str, error_msg: str, invalid_index: int, *args: Any
    ) -> None:
        caret = " " * invalid_index + "^"
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {caret}", *args)


class InvalidNamespaceException(NameValidationException):
    """A namespace breaks ROS's rules."""

    def __init__(self, name: str, error_msg: str, invalid_index: int, *args: Any) -> None:
        super().__init__("namespace", name, error_msg, invalid_index, *args)


class InvalidNodeNameException(NameValidationException):
    """A node's name breaks ROS's rules."""

    def __init__(self, name: str, error_msg: str, invalid_index: int, *args: Any) -> None:
        super().__init__("node name", name, error_msg, invalid_index, *args)


class InvalidTopicNameException(NameValidationException):
    """A topic's name breaks ROS's rules."""

    def __init__(self, name: str, error_msg: str, invalid_index: int, *args: Any) -> None:
        super().__init__("topic name", name, error_msg, invalid_index, *args)


class InvalidServiceNameException(NameValidationException):
    """A service's name breaks ROS's rules."""

    def __init__(self, name: str, error_msg: str, invalid_index: int, *args: Any) -> None:
        super().__init__("service name", name, error_msg, invalid_index, *args)


class ParameterException(Exception):
    """The base class of errors about parameters; the message ends with their names."""

    def __init__(self, error_msg: str, parameters: str | list[str], *args: Any) -> None:
        super().__init__(f"{error_msg}: {parameters}", *args)


class ParameterNotDeclaredException(ParameterException):
    """An undeclared parameter is used."""

    def __init__(self, parameters: str | list[str], *args: Any) -> None:
        super().__init__("Invalid access to undeclared parameter(s)", parameters, *args)


class ParameterAlreadyDeclaredException(ParameterException):
    """A parameter is declared for the second time."""

    def __init__(self, parameters: str | list[str], *args: Any) -> None:
        super().__init__("Parameter(s) already declared", parameters, *args)


class InvalidParameterException(ParameterException):
    """A parameter is declared with a name that ROS refuses."""

    def __init__(self, parameter_name: str, *args: Any) -> None:
        super().__init__("Invalid parameter name", parameter_name, *args)


class InvalidParameterTypeException(ParameterException):
    """A parameter is set to a value that does not have its declared type."""

    def __init__(self, desired_parameter: Any, expected_type: Any, *args: Any) -> None:
        name, value = desired_parameter.name, desired_parameter.value
        got = type(desired_parameter).Type.from_parameter_value(value).name
        super().__init__(
            f"Trying to set parameter '{name}' to '{value}'"
            f" of type '{got}', expecting type '{expected_type}'",
            name,
            *args,
        )


class InvalidParameterValueException(ParameterException):
    """The range of a descriptor or a callback of the program rejects a value."""

    def __init__(self, parameter: str, value: Any, reason: str, *args: Any) -> None:
        super().__init__(
            f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter, *args
        )


class ParameterImmutableException(ParameterException):
    """The program tries to change a read-only parameter."""

    def __init__(self, parameter_name: str, *args: Any) -> None:
        super().__init__("Attempted to modify read-only parameter", parameter_name, *args)


class ParameterUninitializedException(ParameterException):
    """A parameter that was declared without a value is read."""

    def __init__(self, parameter_name: str, *args: Any) -> None:
        text = f"The parameter '{parameter_name}' is not initialized"
        super().__init__(text, parameter_name, *args)


class ROSInterruptException(Exception):
    """A wait ends because the context was shut down."""

    def __init__(self, *args: Any) -> None:
        super().__init__("rclpy.shutdown() has been called", *args)


class TimeSourceChangedError(Exception):
    """Simulated time was switched on or off while a coroutine slept on the clock."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args or ("simulated time was switched on or off during the sleep",))
