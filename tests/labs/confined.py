"""Whether this machine has a sandbox for submissions, as `.ci/run` makes sure on Linux."""

from __future__ import annotations

import contextlib
import os
import sys

import pytest

from taskrpc.course.labs.sandbox import bubblewrap
from taskrpc.course.labs.sandbox import child_trial as trials
from taskrpc.course.labs.variants import Variant

WHY_NOT = bubblewrap.why_not()
CONFINED = WHY_NOT == ""
"""Whether tests grade in a sandbox; else they grade as on other systems."""

if WHY_NOT and os.environ.get("TASKRPC_NEEDS_BUBBLEWRAP"):
    raise RuntimeError(f"TASKRPC_NEEDS_BUBBLEWRAP is set, but {WHY_NOT}")

needs_bubblewrap = pytest.mark.skipif(not CONFINED, reason=WHY_NOT or "bubblewrap works")


def own(root):
    """The folder for programs that run without bubblewrap."""
    return root.with_name(f"{root.name}-own")


@contextlib.asynccontextmanager
async def child_trial(root, *, confined=CONFINED):
    """Make a trial as the grader does on this machine."""
    if sys.platform == "win32":
        async with trials.spawned_trial(root, Variant(), root) as trial:
            yield trial
    else:
        os.chmod(root, 0o755)  # as `take` does, for the user of a sandbox
        async with (
            trials.Sandbox(root, own(root), confined=confined) as sandbox,
            trials.sandboxed_trial(root, Variant(), sandbox) as trial,
        ):
            yield trial
