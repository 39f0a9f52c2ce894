"""A recorded run replays with the same decisions; any difference is found."""

from __future__ import annotations

import msgspec
import pytest

from taskrpc.observe.recording.decisions import DECISIONS_TOPIC, Decision, decision_of
from taskrpc.observe.recording.mcap_file import Recording, RecordingError, RecordingWriter
from taskrpc.observe.recording.replay import replay
from taskrpc.robot.journal import RobotStep
from taskrpc.robot.kinematics import Limits
from taskrpc.robot.tasks.queue import schedule
from taskrpc.robot.tasks.queue.journal import QueueStep


def decisions(path):
    messages = Recording(path).messages(keep=lambda topic: topic.name == DECISIONS_TOPIC)
    return [(message.time, decision_of(message)) for message in messages]


def changed_copy(path, change):
    """Write the decisions of a recording again, each changed by a function."""
    copy = path.with_name("changed.mcap")
    writer = RecordingWriter(copy)
    topic = writer.add_json_topic(DECISIONS_TOPIC)
    for time, decision in decisions(path):
        writer.write(topic, msgspec.json.encode(change(decision)), time)
    writer.close()
    return copy


async def test_every_kind_of_decision_is_recorded(recorded_run):
    found = [decision for _, decision in decisions(recorded_run)]
    assert {type(each) for each in found} == set(Decision.__args__)
    assert {each.method for each in found if isinstance(each, QueueStep)} == {
        *("set_free_at", "set_start_pose", "accept", "begin", "end", "remove", "reprioritise")
    }
    assert {each.method for each in found if isinstance(each, RobotStep)} == {
        *("forget_clock", "assign", "go", "halt", "complete")
    }


async def test_replay_makes_the_recorded_decisions_event_for_event(recorded_run):
    report = replay(Recording(recorded_run))
    assert report.differences == []
    assert report.events == len(decisions(recorded_run)) > 100


PLANTED = {
    "another estimate": (
        lambda each: isinstance(each, QueueStep) and each.method == "accept",
        lambda each: msgspec.structs.replace(each, result=each.result + 0.001),
        "result",
    ),
    "another planned duration": (
        lambda each: isinstance(each, QueueStep) and each.method == "begin",
        lambda each: msgspec.structs.replace(each, result=each.result * 1.000001),
        "result",
    ),
    "another order of the queue": (
        lambda each: isinstance(each, QueueStep) and len(each.next) >= 2,
        lambda each: msgspec.structs.replace(each, next=each.next[::-1]),
        "next",
    ),
    "a delay left out": (
        lambda each: isinstance(each, QueueStep) and each.delays,
        lambda each: msgspec.structs.replace(each, delays=()),
        "delays",
    ),
    "another end of the motion": (
        lambda each: isinstance(each, RobotStep) and each.method == "go",
        lambda each: msgspec.structs.replace(each, end=each.end + 1e-6),
        "end",
    ),
    "another path": (
        lambda each: isinstance(each, RobotStep) and len(each.waypoints) >= 2,
        lambda each: msgspec.structs.replace(each, waypoints=each.waypoints[1:]),
        "waypoints",
    ),
    "another scan": (
        lambda each: getattr(getattr(each, "task", None), "result", "").count("ranges"),
        lambda each: msgspec.structs.replace(
            each,
            task=msgspec.structs.replace(
                each.task, result=each.task.result.replace('"range_max":12.0', '"range_max":9.0')
            ),
        ),
        "result",
    ),
}


@pytest.mark.parametrize("name", PLANTED)
async def test_one_planted_difference_is_found_with_its_place(recorded_run, name):
    is_meant, change, field = PLANTED[name]
    places = [n for n, (_, each) in enumerate(decisions(recorded_run), 1) if is_meant(each)]
    planted = iter(range(1, 10_000))
    copy = changed_copy(
        recorded_run, lambda each: change(each) if next(planted) == places[0] else each
    )
    (difference,) = replay(Recording(copy)).differences
    assert (difference.number, difference.field) == (places[0], field)


async def test_another_rule_in_the_code_is_found(recorded_run, monkeypatch):
    monkeypatch.setattr(schedule.Schedule, "seconds_through", lambda self, task: 1.0)
    fields = {each.field for each in replay(Recording(recorded_run)).differences}
    assert "result" in fields


async def test_a_slower_robot_is_found(recorded_run):
    def slower(each):
        return msgspec.structs.replace(each, limits=Limits(speed=1.0)) if is_start(each) else each

    def is_start(each):
        return type(each).__name__ == "RobotStart"

    assert replay(Recording(changed_copy(recorded_run, slower))).differences


async def test_an_input_that_is_missing_is_found(recorded_run):
    copy = recorded_run.with_name("missing.mcap")
    writer = RecordingWriter(copy)
    topic = writer.add_json_topic(DECISIONS_TOPIC)
    for time, each in decisions(recorded_run):
        if not (isinstance(each, QueueStep) and each.task_id == 4):
            writer.write(topic, msgspec.json.encode(each), time)
    writer.close()
    assert replay(Recording(copy)).differences


def test_recording_without_decisions_is_refused(tmp_path):
    RecordingWriter(tmp_path / "a.mcap").close()
    with pytest.raises(RecordingError, match="has no decisions; record it with taskrpc-server"):
        replay(Recording(tmp_path / "a.mcap"))
