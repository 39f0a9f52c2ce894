"""What the supervisor of a sandbox leaves behind."""

import errno
import sys

import pytest

from tests.labs.confined import child_trial, needs_bubblewrap

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork"),
]


@needs_bubblewrap
async def test_a_full_temporary_folder_is_an_error_of_the_program(tmp_path):
    code = """
import tempfile
try:
    for _ in range(6):
        with tempfile.NamedTemporaryFile(delete=False) as file:
            file.write(bytes(9 * 2**20))
except OSError as error:
    print(error.errno)
"""
    (tmp_path / "server.py").write_text(code)
    async with child_trial(tmp_path, confined=True) as trial:
        program = await trial.start("server.py")
        assert await program.finished(30) == 0
        assert list(program.output) == [str(errno.ENOSPC)]


@needs_bubblewrap
async def test_a_process_that_left_its_group_ends_with_its_program(tmp_path):
    code = """
import os, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        open(os.environ["HOME"] + "/escaped", "w").write(str(os.getpid()))
        time.sleep(600)
    os._exit(0)
while not os.path.exists(os.environ["HOME"] + "/escaped"):
    time.sleep(0.01)
"""
    watch = """
import os, time
pid = int(open(os.environ["HOME"] + "/escaped").read())
while os.path.exists(f"/proc/{pid}"):
    time.sleep(0.01)
print("gone")
"""
    (tmp_path / "server.py").write_text(code)
    (tmp_path / "watch.py").write_text(watch)
    async with child_trial(tmp_path, confined=True) as trial:
        assert await (await trial.start("server.py")).finished(10) == 0
        program = await trial.start("watch.py")
        assert await program.finished(10) == 0
        assert list(program.output) == ["gone"]
