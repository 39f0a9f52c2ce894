"""Exceptions have the same messages and names as in ROS."""

import pytest

from taskrpc.ros.packages.rclpy import exceptions
from taskrpc.ros.packages.rclpy.parameter import Parameter


def test_caret_stands_under_the_first_wrong_character_of_a_name():
    error = exceptions.InvalidTopicNameException("a/b c", "must not contain blanks", 3)
    assert isinstance(error, ValueError)
    first, name, caret = str(error).splitlines()
    assert first == "Invalid topic name: must not contain blanks:"
    assert name[caret.index("^")] == " "


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (exceptions.ParameterNotDeclaredException(["a", "b"]),
         "Invalid access to undeclared parameter(s): ['a', 'b']"),
        (exceptions.InvalidParameterTypeException(Parameter("a", value=1), "STRING"),
         "Trying to set parameter 'a' to '1' of type 'INTEGER', expecting type 'STRING': a"),
        (exceptions.InvalidParameterValueException("a", 7, "too large"),
         "Invalid parameter value (7) for parameter. Reason: too large: a"),
    ],
)  # fmt: skip
def test_message_of_a_parameter_error_ends_with_the_name(error, message):
    assert isinstance(error, exceptions.ParameterException)
    assert str(error) == message


def test_exceptions_of_ros_are_shown_with_the_module_name_of_ros():
    assert exceptions.RCLError.__module__ == "rclpy._rclpy_pybind11"
    assert not issubclass(exceptions.InvalidHandle, exceptions.RCLError)


def test_a_program_may_catch_an_invalid_handle_as_runtime_error():
    assert issubclass(exceptions.InvalidHandle, RuntimeError)


def test_arguments_of_parameter_exceptions_have_the_names_of_ros():
    wanted = Parameter("a", value=1)
    for error in (
        exceptions.InvalidParameterException(parameter_name="a"),
        exceptions.ParameterImmutableException(parameter_name="a"),
        exceptions.ParameterUninitializedException(parameter_name="a"),
        exceptions.InvalidParameterTypeException(desired_parameter=wanted, expected_type="STRING"),
    ):
        assert str(error).endswith(": a")
