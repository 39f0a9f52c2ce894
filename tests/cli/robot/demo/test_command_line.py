"""`taskrpc demo`: its options, what it prints, and how it ends."""

from __future__ import annotations

import asyncio
import os
import re
from pathlib import Path

import pytest

import taskrpc
from taskrpc.cli.robot.demo import command_line, story
from taskrpc.cli.robot.demo.story import open_stage
from taskrpc.cli.shared.command import UsageError
from taskrpc.cli.shared.parsing import Parser
from tests.cli.robot.demo.conftest import on_virtual_time


def test_demo_leaves_no_file_and_is_invisible_to_other_programs():
    async def main():
        async with open_stage() as stage, taskrpc.Node("student") as node:
            await stage.until(1.0)
            return [entry for entry in await node.graph() if entry.services]

    assert on_virtual_time(main) == []
    assert not [path for path in Path(os.environ["XDG_STATE_HOME"]).rglob("*") if path.is_file()]


def options(*argv):
    parser = Parser(prog="taskrpc demo")
    command_line.configure(parser)
    return parser.parse_args(argv)


@pytest.mark.parametrize("speed", ["0", "0.4", "21", "nan", "fast"])
def test_speed_out_of_range_is_refused(speed):
    with pytest.raises(UsageError, match=r"expected a number from 0\.5 to 20"):
        options("--speed", speed)


@pytest.fixture
def in_virtual_time(monkeypatch):
    monkeypatch.setattr(asyncio, "run", lambda main: on_virtual_time(lambda: main))


def test_command_prints_story_summary_and_next_steps(in_virtual_time, capsys):
    assert command_line.run(options("--plain")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(
        "  0.0 s  client_1   move warehouse 8 -> Task queued: move (task 1, "
    )
    assert lines[-2:] == [
        "  taskrpc-server",
        "  taskrpc-call /robot_task task_type=move target=warehouse priority=8",
    ]


def test_the_command_fails_if_an_estimate_was_wrong(in_virtual_time, monkeypatch, capsys):
    show = story.TaskServices.show

    async def forgetful(self, task_id):
        """The planted bug: the server forgets why estimates changed."""
        task = await show(self, task_id)
        task.estimate_changes = []
        return task

    monkeypatch.setattr(story.TaskServices, "show", forgetful)
    assert command_line.run(options()) == 1
    assert re.search(r"wrong by more than 5 %: task 1 by \+16\.\d\d s", capsys.readouterr().out)
