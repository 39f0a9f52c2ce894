"""The states and transitions of a lifecycle node; the state machine knows no node."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy._impl.lifecycle_states import (
    STATES,
    TRANSITIONS,
    LifecycleStateMachine,
)
from taskrpc.ros.packages.rclpy.exceptions import RCLError
from taskrpc.ros.packages.rclpy.lifecycle import (
    TransitionCallbackReturn,
)

ERROR = TransitionCallbackReturn.ERROR
Transition = srvgen.load("lifecycle_msgs/msg/Transition")
StateMessage = srvgen.load("lifecycle_msgs/msg/State")


def machine():
    told, refused = [], []
    return LifecycleStateMachine(told.append, refused.append), told, refused


def test_numbers_and_names_are_those_of_the_messages():
    numbers = {f"{one.id}" for one in TRANSITIONS}
    assert len(numbers) == len(TRANSITIONS)
    for state in STATES:
        kind = "TRANSITION_STATE" if state.id >= 10 else "PRIMARY_STATE"
        assert getattr(StateMessage, f"{kind}_{state.label.upper()}") == state.id
    for one in TRANSITIONS:
        name = one.label.upper()
        if one.label == "shutdown":
            name = f"{one.start.label.upper()}_SHUTDOWN"
        elif one.label.startswith("transition_"):
            steps = {
                "CLEANINGUP": "CLEANUP",
                "SHUTTINGDOWN": "SHUTDOWN",
                "ERRORPROCESSING": "ERROR",
            }
            at = one.start.label.upper()
            at = steps.get(at) or at.removesuffix("ING") + "E"
            name = f"ON_{at}_{name.removeprefix('TRANSITION_')}"
        assert getattr(Transition, f"TRANSITION_{name}") == one.id
    for what in TransitionCallbackReturn:
        assert getattr(Transition, f"TRANSITION_CALLBACK_{what.name}") == int(what)


def test_only_steps_from_where_it_stands_are_possible():
    steps, told, refused = machine()
    assert steps.initialized
    assert [one.label for one in steps.available_transitions] == ["configure", "shutdown"]
    with pytest.raises(RCLError, match="Transition is not registered"):
        steps.trigger_transition_by_id(3, True)
    assert refused == ["No transition matching 3 found for current state unconfigured"]
    assert steps.get_transition_by_label("shutdown") == 5
    with pytest.raises(RCLError, match="label 'fly'"):
        steps.get_transition_by_label("fly")
    steps.trigger_transition_by_label("configure", False)
    assert told == []
    steps.trigger_transition_by_label("transition_success", True)
    assert steps.current_state == (2, "inactive")
    assert [one.goal.label for one in told] == ["inactive"]
