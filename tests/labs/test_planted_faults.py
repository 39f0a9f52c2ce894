"""The checks of lab 6 find each fault that a starter file can have."""

from pathlib import Path

import pytest

import taskrpc.course.labs.catalogue
from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.checks.planted import FAULTS, FILES, values_with
from taskrpc.course.labs.starter import filled
from taskrpc.course.labs.variants import Variant
from tests.labs.submissions import solution_of, submission
from tests.labs.test_submissions import problems

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
TEMPLATES = Path(taskrpc.course.labs.catalogue.__file__).parent / "files" / "lab6"
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
    found = await problems(6, tmp_path, Variant())
    assert found
    assert {title for title, _ in found} <= FINDS[file]
