"""The checks of lab 6 find each fault that a starter file can have."""

from pathlib import Path

import pytest

import taskrpc.labs.catalogue
from taskrpc.labs.catalogue import lab
from taskrpc.labs.checks.planted import FAULTS, FILES, values_with
from taskrpc.labs.grading import findings
from taskrpc.labs.sandbox.child_trial import child_trial
from taskrpc.labs.starter import filled
from taskrpc.labs.variants import Variant
from tests.labs.submissions import solution_of, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
TEMPLATES = Path(taskrpc.labs.catalogue.__file__).parent / "files" / "lab6"
FINDS = {
    "robot.py": {"the robot answers each request", "the robot answers while it scans"},
    "planner.py": {"the planner's mission uses the robot"},
    "console.py": {"the console prints both responses"},
}
"""The checks that look at each program."""


@pytest.mark.parametrize(
    ("file", "fault"), [(file, fault) for file in FILES for fault in FAULTS[file]]
)
async def test_each_planted_fault_is_found(file, fault, tmp_path):
    submission(6, solution_of(6), tmp_path, Variant())
    robot = lab(6).values(Variant())["ROBOT"]
    template = (TEMPLATES / file).read_text(encoding="utf-8")
    (tmp_path / file).write_text(filled(template, values_with({file: fault}, robot)))
    trial = lambda: child_trial(tmp_path, Variant())  # noqa: E731
    found = [each async for each in findings(lab(6), trial)]
    assert {each.check.title for each in found if each.problem} <= FINDS[file]
    assert any(each.problem for each in found)
