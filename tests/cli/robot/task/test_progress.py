"""The progress of a task on terminals of all widths."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

import srvgen
from taskrpc.cli.robot.task import progress
from taskrpc.cli.robot.task.progress import ProgressBar

TASK = SimpleNamespace(
    task_id=12,
    task_type="move",
    target="warehouse",
    state="CANCELING",
    progress=0.45,
    estimated_time=-0.04,
)


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_every_width_shows_the_state_and_no_negative_time(width):
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=width, legacy_windows=False)
    with ProgressBar(console) as bar:
        bar.show(TASK, paused=False)
    text = shown.getvalue()
    assert "CANCELING" in text
    assert " 0.0 s" in text
    assert ("move warehouse" in text) is (width >= 80)


TASK_INFO = srvgen.load("taskrpc_interfaces/msg/TaskInfo")


def info(**fields):
    return TASK_INFO(**{"task_id": 3, "task_type": "move", "target": "dock", **fields})


def test_the_bar_shows_what_is_left_and_that_the_queue_is_paused():
    console = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    with ProgressBar(console) as bar:
        bar.show(info(state="RUNNING", progress=0.5, estimated_time=12.34), paused=False)
        bar._bars.refresh()
        bar.show(info(state="PAUSED", progress=0.5), paused=True)
    drawn = console.file.getvalue()
    assert "task 3  move dock  RUNNING" in drawn
    assert "50 %  done in 12.3 s" in drawn
    assert "the queue is paused" in drawn


def test_without_a_terminal_there_is_no_progress_bar():
    assert isinstance(progress.progress(), progress.ProgressLines)
