"""A sandbox from the side of the checks."""

import asyncio
import os
import sys
import time

import pytest

from taskrpc.course.labs.sandbox import child_trial as trials
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError
from tests.labs.confined import needs_bubblewrap, own

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork"),
]
both = pytest.mark.parametrize("confined", [False, pytest.param(True, marks=needs_bubblewrap)])


async def end_supervisor(sandbox):
    async with sandbox.check() as check:
        check.publish(None, None)  # the supervisor cannot read it, and ends
        await check.new_socket()


@both
async def test_each_check_finds_an_empty_home_and_no_processes(confined, tmp_path):
    os.chmod(tmp_path, 0o755)
    (tmp_path / "server.py").write_text(
        "import os, time\n"
        "home = os.environ['HOME']\n"
        "print('found', os.listdir(home), flush=True)\n"
        "open(home + '/file', 'w').close()\n"
        "time.sleep(600)"
    )
    async with trials.Sandbox(tmp_path, own(tmp_path), confined=confined) as sandbox:
        for _ in range(2):
            async with trials.sandboxed_trial(tmp_path, Variant(), sandbox) as trial:
                program = await trial.start("server.py")
                assert await program.wait_for_line(r"found \[\]", 10), program.output
    assert not own(tmp_path).exists()


@both
async def test_a_sandbox_that_ends_is_replaced(confined, tmp_path):
    os.chmod(tmp_path, 0o755)
    (tmp_path / "server.py").write_text("import time\nprint('on', flush=True)\ntime.sleep(600)")
    async with trials.Sandbox(tmp_path, own(tmp_path), confined=confined) as sandbox:
        with pytest.raises(TaskRpcError, match="the sandbox has ended"):
            await end_supervisor(sandbox)
        async with trials.sandboxed_trial(tmp_path, Variant(), sandbox) as trial:
            program = await trial.start("server.py")
            assert await program.wait_for_line("on", 10)


@both
async def test_a_program_that_has_ended_before_its_start_was_handled_is_waited_for(
    confined, tmp_path
):
    os.chmod(tmp_path, 0o755)
    (tmp_path / "server.py").write_text("print('done')")
    async with (
        trials.Sandbox(tmp_path, own(tmp_path), confined=confined) as sandbox,
        trials.sandboxed_trial(tmp_path, Variant(), sandbox) as trial,
    ):
        starting = asyncio.ensure_future(trial.start("server.py"))
        await asyncio.sleep(0)
        time.sleep(1)  # the reports of its start and of its end arrive together
        program = await starting
        assert await program.finished(10) == 0
