"""The story of a fleet: always the same, and it ends well."""

from __future__ import annotations

import time

import pytest

from taskrpc.cli.robot.demo import command_line, fleet_story
from taskrpc.cli.shared.parsing import Parser
from taskrpc.robot.tasks import TaskState


@pytest.fixture(scope="module")
def performance():
    return fleet_story.perform()


def said(performance, text):
    return [line for line in performance.lines if text in line.text]


def test_every_task_succeeds_and_only_the_interrupted_one_is_executed_again(performance):
    assert fleet_story.is_right(performance)
    assert {task.state for task in performance.tasks} == {TaskState.SUCCEEDED}
    assert sum(performance.executions.values()) == len(fleet_story.SCRIPT) + 1


def test_all_robots_share_the_work(performance):
    assert {task.robot for task in performance.tasks} == set(fleet_story.ROBOTS)


def test_lost_server_is_noticed_and_its_task_is_interrupted(performance):
    [lost], [noticed] = said(performance, "is cut off"), said(performance, "is INTERRUPTED")
    assert lost.at < noticed.at <= lost.at + 8.0
    assert said(performance, "the database cannot be reached")


def test_story_is_the_same_each_time(performance):
    assert fleet_story.perform().lines == performance.lines


def test_command_tells_the_story_and_succeeds(monkeypatch, capsys):
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    parser = Parser(prog="taskrpc demo")
    command_line.configure(parser)
    assert command_line.run(parser.parse_args(["--fleet"])) == 0
    text = capsys.readouterr()
    assert "7 tasks, 3 robots, one queue:" in text.out
    assert text.err == ""


def test_command_fails_if_a_task_was_lost(monkeypatch, capsys, performance):
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    lossy = performance._replace(tasks=performance.tasks[1:])
    monkeypatch.setattr(fleet_story, "perform", lambda: lossy)
    parser = Parser(prog="taskrpc demo")
    command_line.configure(parser)
    assert command_line.run(parser.parse_args(["--fleet"])) == 1
