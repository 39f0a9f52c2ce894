"""A door reads its file again when it changes, and understands names as its node does."""

import logging
import os
import sys

import pytest

from taskrpc.bridges.door import Door, Outcome, PolicyError
from taskrpc.bridges.door.decisions import Moment
from taskrpc.bridges.door.door import CHECK_PERIOD, present
from taskrpc.node import Node


class Clock:
    """A clock that the test sets."""

    def __init__(self):
        self.seconds = 100.0

    def __call__(self):
        return Moment(self.seconds, 0)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "door.yaml"


def write(path, text):
    new = path.with_suffix(".new")  # another file, as editors do, so that its status differs
    new.write_text(text, encoding="utf-8")
    new.chmod(0o644)
    os.replace(new, path)


def may(door, target="/x"):
    return door.decide("a", "call", target).outcome is Outcome.ALLOWED


def test_a_changed_file_is_in_force_after_the_period(path, clock):
    write(path, "a: {may: [call /x]}")
    door = Door(path, now=clock)
    assert may(door)
    write(path, "a: {never: [call /x]}")
    clock.seconds += CHECK_PERIOD / 2
    assert may(door)
    clock.seconds += CHECK_PERIOD / 2
    assert not may(door)


def test_a_changed_file_changes_what_is_permitted_and_nothing_counts(path, clock):
    write(path, "a: {may: [call /x], rate: {/x: 1/min}}")
    door = Door(path, now=clock)
    assert all(door.permits("a", "call", "/x") for _ in range(3))
    assert may(door)
    write(path, "a: {never: [call /x]}")
    clock.seconds += CHECK_PERIOD
    assert not door.permits("a", "call", "/x")


def test_the_last_valid_rules_stay_while_the_file_has_a_mistake(path, clock, caplog):
    write(path, "a: {may: [call /x]}")
    door = Door(path, now=clock)
    write(path, "a: {my: [call /x]}")
    with caplog.at_level(logging.ERROR):
        assert not door.refresh()
        assert not door.refresh()
    assert may(door)
    [line] = caplog.messages
    assert line.startswith(f"the policy stays as it was: {path}:1:5: error: a has no 'my'")
    path.unlink()
    with caplog.at_level(logging.ERROR):
        assert not door.refresh()
    assert "cannot read the policy" in caplog.messages[-1]
    write(path, "a: {may: [call /y]}")
    assert door.refresh()
    assert not may(door)


def test_requests_still_count_after_the_file_has_changed(path, clock):
    write(path, "a: {may: [call /x], rate: {/x: 1/min}}")
    door = Door(path, now=clock)
    assert may(door)
    write(path, "\na: {may: [call /x], rate: {/x: 1/min}}")
    assert door.refresh()
    assert not may(door)
    clock.seconds += 60.0
    assert may(door)


@pytest.mark.parametrize(
    ("spelling", "permitted"),
    [
        ("/lab/robot/stop", True),
        ("robot/stop", True),
        ("~/stop", True),
        ("{node}/stop", True),
        ("/{ns}/robot/stop", True),
        ("/robot/stop", False),
        ("//lab/robot/stop", False),
        ("/lab/robot/stop/", False),
        ("/lab/robot/stop\n", False),
        ("", False),
    ],
)
async def test_a_name_means_what_it_means_for_the_node(path, spelling, permitted):
    write(path, "a: {may: [call /lab/robot/stop, read /lab/robot/stop]}")
    async with Node("robot", namespace="/lab") as node:
        door = Door(path, node)
        for verb in ("call", "read"):
            is_allowed = door.decide("a", verb, spelling).outcome is Outcome.ALLOWED
            assert is_allowed is permitted


def test_a_remapped_name_meets_the_rule_of_the_name_that_it_means(path):
    class Remapping:
        def resolve_service_name(self, name):
            return "/robot_task/drop" if name == "/harmless" else name

        def resolve_topic_name(self, name):
            return name

    write(path, "a: {may: [call /*], never: [call /robot_task/drop]}")
    door = Door(path, Remapping())
    assert may(door, "/other")
    assert not may(door, "/harmless")


@pytest.mark.skipif(sys.platform == "win32", reason="file modes of POSIX")
def test_a_file_that_others_can_change_is_refused(path):
    write(path, "a: {}")
    path.chmod(0o664)
    with pytest.raises(PolicyError, match="other users can change the policy"):
        Door(path)


def test_a_missing_file_and_a_wrong_encoding_are_mistakes(path):
    with pytest.raises(PolicyError, match="cannot read the policy"):
        Door(path)
    path.write_bytes(b"\xff\xfe")
    path.chmod(0o600)
    with pytest.raises(PolicyError, match="not UTF-8 text"):
        Door(path)


def test_the_present_minute_is_one_of_the_week():
    assert 0 <= present().minute < 7 * 24 * 60
