"""Each solution also passes the hidden checks of its lab."""

import dataclasses
import runpy
from pathlib import Path

import pytest

from taskrpc.labs.catalogue import lab
from taskrpc.labs.grading import findings
from taskrpc.labs.sandbox.child_trial import child_trial
from taskrpc.labs.variants import Variant
from tests.labs.test_submissions import LECTURERS, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
HIDDEN = sorted(LECTURERS.glob("lab*/hidden.py"))


@pytest.mark.parametrize("path", HIDDEN, ids=lambda path: path.parent.name)
async def test_solution_passes_the_hidden_checks(path: Path, tmp_path):
    number = int(path.parent.name.removeprefix("lab"))
    submission(number, path.parent / "solution", tmp_path, Variant("ada"))
    checks = runpy.run_path(str(path))["CHECKS"]
    hidden = dataclasses.replace(lab(number), checks=checks)
    found = [each async for each in findings(hidden, lambda: child_trial(tmp_path, Variant("ada")))]
    assert [(each.check.title, each.problem) for each in found if not each.passed] == []
