"""Programs of a submission in child processes."""

import pytest

from taskrpc.course.labs.lab import NotMet
from tests.labs.confined import child_trial

pytestmark = pytest.mark.real_time


async def test_output_and_exit_code_of_a_program(tmp_path):
    code = "import sys\nprint('sum is 5')\nprint('end', file=sys.stderr)\nsys.exit(3)"
    (tmp_path / "client.py").write_text(code)
    async with child_trial(tmp_path) as trial:
        program = await trial.start("client.py")
        assert await program.wait_for_line(r"sum is (\d)", 10)
        assert await program.finished(10) == 3
        assert sorted(program.output) == ["end", "sum is 5"]


async def test_missing_file_is_named_with_those_that_exist(tmp_path):
    (tmp_path / "sever.py").write_text("")
    async with child_trial(tmp_path) as trial:
        with pytest.raises(NotMet, match=r"expected a file server\.py; the folder has sever\.py"):
            await trial.start("server.py")


async def test_programs_end_with_the_trial(tmp_path):
    (tmp_path / "server.py").write_text("import time\nprint('on', flush=True)\ntime.sleep(600)")
    async with child_trial(tmp_path) as trial:
        program = await trial.start("server.py")
        await program.wait_for_line("on", 10)
    assert await program.finished(0) is not None


async def test_ctrl_c_reaches_the_program(tmp_path):
    code = """
import time
try:
    print("on", flush=True)
    time.sleep(600)
except KeyboardInterrupt:
    raise SystemExit(7)
"""
    (tmp_path / "server.py").write_text(code)
    async with child_trial(tmp_path) as trial:
        program = await trial.start("server.py")
        await program.wait_for_line("on", 10)
        before = trial.time()
        await program.interrupt()
        assert await program.finished(10) == 7
        assert trial.time() > before
