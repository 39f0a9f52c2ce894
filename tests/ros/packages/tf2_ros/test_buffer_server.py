"""A buffer that other programs ask with an action."""

from types import SimpleNamespace

import pytest


class Goal:
    """A goal as the action server passes it to the callback."""

    def __init__(self, request):
        self.request = request
        self.is_cancel_requested = False
        self.status = ""

    def succeed(self):
        self.status = "succeeded"

    def canceled(self):
        self.status = "canceled"


class Clock:
    """A clock that the test sets."""

    def __init__(self, time):
        self.now = lambda: time(seconds=self.seconds)
        self.seconds = 100


@pytest.fixture
def module(ros, monkeypatch):
    module = ros.module("tf2_ros.buffer_server")
    created = []
    monkeypatch.setattr(module, "ActionServer", lambda *args, **options: created.append(args))
    module.created = created
    return module


@pytest.fixture
def started(ros, module):
    """A server: its buffer, its clock, its timers, and a function that begins a goal."""
    buffer = ros.tf2_ros.Buffer()
    clock, timers = Clock(ros.Time), []
    node = SimpleNamespace(
        get_clock=lambda: clock,
        create_timer=lambda period, look: timers.append(look),
        destroy_timer=lambda timer: timers.clear(),
    )
    module.BufferServer(buffer, node, "buffer")
    execute = module.created[-1][3]

    def begin(**fields):
        goal = Goal(ros.module("tf2_msgs.action").LookupTransform.Goal(**fields))
        goal.request.timeout.sec = 2
        running = execute(goal)
        return goal, lambda: finished(running)

    return SimpleNamespace(buffer=buffer, clock=clock, timers=timers, begin=begin)


def finished(running):
    """Continue a coroutine; return its result, None if it still waits."""
    try:
        running.send(None)
    except StopIteration as ended:
        return ended.value
    return None


def test_a_known_transform_is_returned_at_once(started, link):
    started.buffer.set_transform(link("a", "b", x=2.0), "")
    goal, go_on = started.begin(target_frame="a", source_frame="b")
    result = go_on()
    assert (goal.status, result.error.error) == ("succeeded", 0)
    assert result.transform.transform.translation.x == 2.0


def test_a_transform_that_comes_in_time_is_returned(started, link):
    goal, go_on = started.begin(target_frame="a", source_frame="b")
    assert go_on() is None
    started.buffer.set_transform(link("a", "b", x=2.0), "")
    started.timers[0]()
    assert go_on().transform.transform.translation.x == 2.0
    assert (goal.status, started.timers) == ("succeeded", [])


def test_a_missing_transform_is_an_error_after_the_timeout(started, ros):
    error = ros.module("tf2_msgs.msg").TF2Error
    goal, go_on = started.begin(target_frame="a", source_frame="b")
    assert go_on() is None
    started.clock.seconds = 102
    started.timers[0]()
    result = go_on()
    assert (goal.status, result.error.error) == ("succeeded", error.LOOKUP_ERROR)
    assert "does not exist" in result.error.error_string


def test_a_cancelled_goal_ends_without_a_transform(started):
    goal, go_on = started.begin(target_frame="a", source_frame="b")
    assert go_on() is None
    goal.is_cancel_requested = True
    started.timers[0]()
    assert go_on().error.error == 0
    assert goal.status == "canceled"


def test_the_transform_between_two_times_is_returned(started, link):
    for sec, x in ((1, 1.0), (2, 5.0)):
        started.buffer.set_transform(link("world", "a", sec, x), "")
    goal, go_on = started.begin(
        target_frame="a", source_frame="a", fixed_frame="world", advanced=True
    )
    goal.request.target_time.sec, goal.request.source_time.sec = 1, 2
    assert go_on().transform.transform.translation.x == 4.0
