"""The progress of a task on terminals of all widths."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from taskrpc.cli.task.progress import ProgressBar

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
