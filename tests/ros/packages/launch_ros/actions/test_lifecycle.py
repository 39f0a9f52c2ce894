"""Launch files change the states of lifecycle nodes, and react to their changes."""

import asyncio
import importlib
from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.real_time


@pytest.fixture
def ros(launch):
    return importlib.import_module("launch_ros")


def change(ros, start, goal, name="/lidar"):
    """The event of a node that says how it has changed."""
    msg = SimpleNamespace(
        timestamp=0,
        transition=SimpleNamespace(label="transition_success"),
        start_state=SimpleNamespace(label=start),
        goal_state=SimpleNamespace(label=goal),
    )
    action = SimpleNamespace(node_name=name)
    return ros.events.lifecycle.StateTransition(action=action, msg=msg)


@pytest.fixture
def requested(launch, ros):
    """Play a LifecycleTransition against events; returns the requested transitions."""

    async def requested(transitions, *events):
        found = []

        def note(event):
            if isinstance(event, ros.events.lifecycle.ChangeState):
                found.append(event.transition_id)
            return False

        service = launch.LaunchService()
        note_all = launch.event_handler.BaseEventHandler(matcher=note)
        service.context.register_event_handler(note_all)
        action = ros.actions.LifecycleTransition(
            lifecycle_node_names=["lidar"], transition_ids=transitions
        )
        emitted = [launch.actions.EmitEvent(event=event) for event in events]
        service.include_launch_description(launch.LaunchDescription([action, *emitted]))
        assert await service.run_async() == 0
        return found

    return requested


async def test_next_transition_is_requested_when_the_one_before_has_ended(ros, requested):
    begun = change(ros, "unconfigured", "configuring")
    configured = change(ros, "configuring", "inactive")
    active = change(ros, "activating", "active")
    assert await requested([1, "3"]) == [1]
    assert await requested([1, "3"], begun) == [1]
    assert await requested([1, "3"], change(ros, "configuring", "inactive", "/other")) == [1]
    assert await requested([1, "3"], begun, configured) == [1, 3]
    assert await requested([1, "3", 4], begun, configured, active) == [1, 3, 4]


async def test_error_of_a_node_ends_its_transitions(ros, requested, capsys):
    failed = change(ros, "configuring", "errorprocessing")
    assert await requested([1, 3], failed, change(ros, "configuring", "inactive")) == [1]
    assert "Stopping transitions for lidar because" in capsys.readouterr().out


def test_wrong_transitions_and_names_are_refused(ros):
    transition = ros.actions.LifecycleTransition
    with pytest.raises(ValueError, match="No transition_ids provided"):
        transition(lifecycle_node_names=["a"], transition_ids=[])
    with pytest.raises(ValueError, match="No lifecycle_node_names provided"):
        transition(lifecycle_node_names=[], transition_ids=[1])
    with pytest.raises(ValueError, match=r"expected a constant of .*Transition, 0 to 8, got 99"):
        ros.events.lifecycle.ChangeState(lifecycle_node_matcher=print, transition_id=99)
    with pytest.raises(TypeError, match="expected a function such as matches_action"):
        ros.events.lifecycle.ChangeState(lifecycle_node_matcher="/a", transition_id=1)
    with pytest.raises(RuntimeError, match="'name' must not be None"):
        ros.actions.LifecycleNode(executable="a")


def test_handler_selects_changes_by_node_and_labels(ros):
    event = change(ros, "configuring", "inactive")
    on = ros.event_handlers.OnStateTransition
    assert on().matches(event)
    assert on(goal_state="inactive", start_state="configuring").matches(event)
    assert on(target_lifecycle_node=event.action, transition="transition_success").matches(event)
    assert on(matcher=lambda event: True).matches(event)
    assert not on(goal_state="active").matches(event)
    assert not on(target_lifecycle_node="another").matches(event)
    assert not on().matches(object())


async def test_requests_reach_the_node_in_their_order_and_its_changes_are_events(launch, ros):
    lifecycle = importlib.import_module("rclpy.lifecycle")
    rclpy_context = importlib.import_module("rclpy.context").Context()
    executors = importlib.import_module("rclpy.executors")
    rclpy_context.init([])
    node = lifecycle.LifecycleNode("lidar", context=rclpy_context)
    executor = executors.SingleThreadedExecutor(context=rclpy_context)
    executor.add_node(node)
    spinning = asyncio.get_running_loop().run_in_executor(None, executor.spin)
    context = launch.LaunchContext()
    goals = []
    context.on_event = lambda: goals.append(context.events.popleft().goal_state)
    action = SimpleNamespace(node_name="/lidar")
    control = importlib.import_module("launch_ros.lifecycle_control").LifecycleControl(
        action, context
    )
    for number in (1, 3):
        event = ros.events.lifecycle.ChangeState(
            lifecycle_node_matcher=lambda found: found is action, transition_id=number
        )
        assert control.matches(event)
        control.handle(event, context)
    while len(goals) < 4:
        await asyncio.sleep(0.01)
    assert goals == ["configuring", "inactive", "activating", "active"]
    await control.close()
    await asyncio.gather(*(end() for end in context.at_end))
    executor.shutdown()
    await spinning
    rclpy_context.shutdown()
