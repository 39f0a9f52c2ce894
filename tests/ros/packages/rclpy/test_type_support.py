"""Only interface classes are accepted as types."""

import importlib

import pytest

import srvgen
from taskrpc.ros.packages.rclpy import type_support
from taskrpc.ros.packages.rclpy.exceptions import NoTypeSupportImportedException

String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")
Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


class Unsupported(type):
    _TYPE_SUPPORT = None


class Mistaken(metaclass=Unsupported):
    """A class that looks like an interface of ROS but is not."""


def test_only_interface_classes_are_accepted_as_types():
    type_support.check_is_valid_msg_type(String)
    type_support.check_is_valid_srv_type(Trigger)
    with pytest.raises(AttributeError):
        type_support.check_for_type_support(object())
    with pytest.raises(NoTypeSupportImportedException):
        type_support.check_for_type_support(Mistaken)
    with pytest.raises(RuntimeError):
        type_support.check_is_valid_msg_type(Trigger)
    with pytest.raises(RuntimeError):
        type_support.check_is_valid_srv_type(String)
    type_support.check_is_valid_action_type(Fibonacci)
    for check, wrong, got in (
        (type_support.check_is_valid_msg_type, Fibonacci, "the action Fibonacci"),
        (type_support.check_is_valid_srv_type, Fibonacci, "the action Fibonacci"),
        (type_support.check_is_valid_action_type, Trigger, "the service Trigger"),
        (type_support.check_is_valid_action_type, Fibonacci.Goal, "the message Fibonacci_Goal"),
    ):
        with pytest.raises(RuntimeError, match=got):
            check(wrong)
    with pytest.raises(AttributeError, match="got 'fibonacci'"):
        type_support.check_is_valid_action_type("fibonacci")


def test_annotations_of_typed_programs_are_evaluated():
    t = type_support
    assert t.Srv[t.SrvRequestT, t.SrvResponseT]
    assert t.Action[t.GoalT, t.ResultT, t.FeedbackT]
    assert list[t.Msg]


@pytest.mark.parametrize(
    ("module", "names"),
    [
        ("action.client", "SendGoalKWargs"),
        ("clock", "TimeJumpDictionary"),
        ("impl.rcutils_logger", "LoggingArgs LoggingFilterArgs LoggingFilterParams"),
        ("impl.rcutils_logger", "OnceContext RcutilsLoggerContext SkipFirstContext"),
        ("impl.rcutils_logger", "ThrottleContext"),
        ("lifecycle.node", "CreateLifecyclePublisherArgs LifecycleNodeArgs"),
        ("type_support", "EventMessage FeedbackMessage PyCapsule SendGoalService"),
        ("type_support", "GetResultService GetResultServiceRequest GetResultServiceResponse"),
        ("type_support", "SendGoalServiceRequest SendGoalServiceResponse"),
    ],
)
def test_programs_can_import_the_names_for_annotations(module, names):
    imported = importlib.import_module(f"taskrpc.ros.packages.rclpy.{module}")
    assert all(hasattr(imported, name) for name in names.split())
