"""Lifecycle nodes: steps on request, what callbacks return leads on, publishers that wait."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy._impl.diagnostics import explain
from taskrpc.ros.packages.rclpy._impl.lifecycle_states import STATES, TRANSITIONS
from taskrpc.ros.packages.rclpy.exceptions import RCLError
from taskrpc.ros.packages.rclpy.impl.implementation_singleton import rclpy_implementation
from taskrpc.ros.packages.rclpy.lifecycle import (
    LifecycleNode,
    LifecycleState,
    Node,
    SimpleManagedEntity,
    State,
    TransitionCallbackReturn,
)
from taskrpc.ros.packages.rclpy.publisher import Publisher
from tests.ros.packages.rclpy.living import context_of, living

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
ERROR = TransitionCallbackReturn.ERROR
String = srvgen.load("std_msgs/msg/String")
ChangeState = srvgen.load("lifecycle_msgs/srv/ChangeState")
GetState = srvgen.load("lifecycle_msgs/srv/GetState")
GetAvailableStates = srvgen.load("lifecycle_msgs/srv/GetAvailableStates")
GetAvailableTransitions = srvgen.load("lifecycle_msgs/srv/GetAvailableTransitions")
TransitionEvent = srvgen.load("lifecycle_msgs/msg/TransitionEvent")
Transition = srvgen.load("lifecycle_msgs/msg/Transition")
StateMessage = srvgen.load("lifecycle_msgs/msg/State")


@pytest.fixture
def quiet():
    with context_of() as context:
        yield lambda cls=LifecycleNode, **settings: cls(
            "robot", context=context, enable_communication_interface=False, **settings
        )


def stands(node):
    return node._state_machine.current_state[1]


# --- callbacks ------------------------------------------------------------------------------------


def test_a_node_goes_through_its_life(quiet):
    node = quiet()
    for _ in range(3):
        assert node.trigger_configure() is SUCCESS
        assert stands(node) == "inactive"
        assert node.trigger_activate() is SUCCESS
        assert stands(node) == "active"
        assert node.trigger_deactivate() is SUCCESS
        assert node.trigger_cleanup() is SUCCESS
        assert stands(node) == "unconfigured"
    for wrong in (node.trigger_activate, node.trigger_deactivate, node.trigger_cleanup):
        with pytest.raises(RCLError):
            wrong()
    assert node.trigger_shutdown() is SUCCESS
    assert stands(node) == "finalized"
    with pytest.raises(RCLError):
        node.trigger_shutdown()


@pytest.mark.parametrize("before", [[], ["configure"], ["configure", "activate"]])
def test_a_node_can_be_shut_down_from_every_state_where_it_rests(quiet, before):
    node = quiet()
    for step in before:
        getattr(node, f"trigger_{step}")()
    assert node.trigger_shutdown() is SUCCESS
    assert stands(node) == "finalized"


@pytest.mark.parametrize(
    ("step", "on_error", "ends"),
    [
        (FAILURE, SUCCESS, "unconfigured"),
        (ERROR, SUCCESS, "unconfigured"),
        (ERROR, FAILURE, "finalized"),
        (ERROR, ERROR, "finalized"),
    ],
)
def test_the_result_of_a_callback_decides_the_next_state(quiet, step, on_error, ends):
    seen = []

    class Robot(LifecycleNode):
        def on_configure(self, state):
            seen.append(state)
            return step

        def on_error(self, state):
            seen.append(state)
            return on_error

    node = quiet(Robot)
    assert node.trigger_configure() is step
    assert stands(node) == ends
    assert set(seen) == {LifecycleState(label="unconfigured", state_id=1)}
    assert len(seen) == (2 if step is ERROR else 1)


def test_a_callback_that_raises_counts_as_an_error_and_is_reported(quiet, capsys, monkeypatch):
    class Robot(LifecycleNode):
        def on_configure(self):
            return SUCCESS

    monkeypatch.setattr(explain, "_reported", set())
    assert quiet(Robot).trigger_configure() is ERROR
    said = capsys.readouterr().err
    assert said.startswith(
        "[taskrpc] ROS 2 would print nothing here: on_configure of /robot raised T"
    )


def test_a_callback_that_returns_nothing_is_named(quiet):
    class Robot(LifecycleNode):
        def on_configure(self, state):
            pass

    with pytest.raises(AttributeError, match="on_configure returned None"):
        quiet(Robot).trigger_configure()


# --- what is managed ------------------------------------------------------------------------------


def test_a_lifecycle_publisher_is_silent_until_its_node_is_active(quiet, monkeypatch):
    published = []
    node = quiet()
    monkeypatch.setattr(Publisher, "publish", lambda self, message: published.append(message))
    publisher = node.create_lifecycle_publisher(String, "talk", 10)
    publisher.publish(String(data="asleep"))
    node.trigger_configure()
    node.trigger_activate()
    assert publisher.is_activated
    publisher.publish(String(data="awake"))
    node.trigger_deactivate()
    publisher.publish(String(data="asleep again"))
    assert [message.data for message in published] == ["awake"]
    assert node.destroy_lifecycle_publisher(publisher)
    with pytest.raises(TypeError, match="publisher_class"):
        node.create_lifecycle_publisher(String, "talk", 10, publisher_class=Publisher)


def test_managed_entities_observe_transitions_and_may_refuse(quiet):
    class Arm(SimpleManagedEntity):
        asleep = 0

        def on_configure(self, state):
            return FAILURE

        @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: setattr(Arm, "asleep", 1))
        def move(self):
            raise AssertionError("it is not active")

    node, arm = quiet(), Arm()
    node.add_managed_entity(arm)
    assert node.trigger_configure() is FAILURE
    assert stands(node) == "unconfigured"
    arm.move()
    assert arm.asleep
    with pytest.raises(TypeError, match="ManagedEntity"):
        node.add_managed_entity("arm")


def test_managed_entities_must_return_a_result(quiet, capsys):
    class Arm(SimpleManagedEntity):
        def on_configure(self, state):
            return True

    node = quiet()
    node.add_managed_entity(Arm())
    assert node.trigger_configure() is ERROR
    assert "on_configure() return value of class" in capsys.readouterr().err


# --- on the network -------------------------------------------------------------------------------


@pytest.mark.real_time
def test_other_programs_request_transitions_and_observe_them():
    events = []
    with living() as world:
        node = Node("robot", context=world.context)
        world.executor.add_node(node)
        other = world.node("operator")
        other.create_subscription(
            TransitionEvent,
            "robot/transition_event",
            lambda event: events.append((event.start_state.label, event.goal_state.label)),
            10,
        )

        def ask(srv_type, name, **fields):
            client = other.create_client(srv_type, f"/robot/{name}")
            assert client.wait_for_service(60)
            return world.answer(client.call_async(srv_type.Request(**fields)))

        assert ask(GetState, "get_state").current_state.label == "unconfigured"
        assert ask(ChangeState, "change_state", transition=Transition(id=1)).success
        assert ask(ChangeState, "change_state", transition=Transition(label="activate")).success
        assert not ask(ChangeState, "change_state", transition=Transition(label="fly")).success
        assert ask(GetState, "get_state").current_state == StateMessage(id=3, label="active")
        states = ask(GetAvailableStates, "get_available_states").available_states
        assert [(one.id, one.label) for one in states] == list(STATES)
        possible = ask(GetAvailableTransitions, "get_available_transitions").available_transitions
        assert [one.transition.label for one in possible] == ["deactivate", "shutdown"]
        graph = ask(GetAvailableTransitions, "get_transition_graph").available_transitions
        assert [one.transition.id for one in graph] == [one.id for one in TRANSITIONS]
        world.spin_until(lambda: len(events) == 4)
    assert events == [
        ("unconfigured", "configuring"),
        ("configuring", "inactive"),
        ("inactive", "activating"),
        ("activating", "active"),
    ]


@pytest.mark.real_time
def test_a_step_that_is_not_possible_is_refused_and_the_node_goes_on(capsys, monkeypatch):
    monkeypatch.setattr(explain, "_reported", set())
    with living() as world:
        node = Node("robot", context=world.context)
        world.executor.add_node(node)
        client = node.create_client(ChangeState, "~/change_state")
        request = ChangeState.Request(transition=Transition(id=3))
        assert not world.answer(client.call_async(request)).success
        assert stands(node) == "unconfigured"
        monkeypatch.setattr(explain, "like_ros", lambda: True)
        with pytest.raises(RCLError, match="Transition is not registered"):
            world.answer(client.call_async(request))
    assert "[taskrpc] ROS 2 would end the spin of /robot here" in capsys.readouterr().err


def test_without_an_interface_there_is_no_service(quiet):
    node = quiet()
    assert not hasattr(node, "_service_change_state")
    assert not [one for one in node.services if "state" in one.service_name]
    with pytest.raises(TypeError, match="expected True or False, got 'no'"):
        LifecycleNode("robot", context=node.context, enable_communication_interface="no")


def test_programs_find_the_names_where_ros_has_them():
    assert State is LifecycleState
    assert rclpy_implementation.TransitionCallbackReturnType is TransitionCallbackReturn
    assert repr(SUCCESS) == "<TransitionCallbackReturnType.SUCCESS: 97>"
