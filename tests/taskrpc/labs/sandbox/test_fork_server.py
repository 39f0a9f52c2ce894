"""The process that starts programs by forking, with a grader that ends in several ways."""

import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.labs,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork"),
]

GRADER = """
import asyncio, os, sys
from pathlib import Path
from taskrpc.labs.sandbox import speed
speed.install()
from taskrpc.labs.sandbox import child, fork_server, guard, linux
{before}
base = Path(sys.argv[1])
server = fork_server.fork_server(base)
from taskrpc.labs.sandbox.program import ForkStarter

async def main():
    starter = ForkStarter(server)
    start = child.Start("program.py", ("an argument",), str(base))
    output = []
    process = await starter.start(start, lambda stream, data: output.append((stream, data)))
{after}

asyncio.run(main())
"""
UNCONFINED = """
linux.limit_files = linux.forbid_system_calls = guard.install = lambda *_: False
"""


def grade(folder, program, after, before=""):
    (folder / "submission").mkdir(parents=True)
    (folder / "submission" / "program.py").write_text(program)
    code = GRADER.format(before=before, after=after)
    command = [sys.executable, "-c", code, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    return done.stdout.splitlines()


def test_a_program_has_its_streams_arguments_and_exit_code(tmp_path):
    program = """
import atexit, sys, threading, time
atexit.register(print, "exit function")
def late():
    time.sleep(0.1)
    print("thread")
threading.Thread(target=late).start()
print(sys.argv[1], __name__)
sys.exit("failed")
"""
    after = """
    print(await process.wait())
    for stream in (1, 2):
        print(b"".join(data for number, data in output if number == stream).decode().split("\\n"))
"""
    assert grade(tmp_path / "b", program, after) == [
        "1",
        "['an argument __main__', 'thread', 'exit function', '']",
        "['failed', '']",
    ]


# Two forks and a session of its own: the process has left the program's group.
ESCAPES = """
import os, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        open("escaped", "w").write(str(os.getpid()))
        time.sleep(600)
    os._exit(0)
while not os.path.exists("escaped"):
    time.sleep(0.01)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux hands orphans to the server")
def test_a_process_that_left_its_group_is_killed(tmp_path):
    after = """
    await process.wait()
    pid = int((base / "submission/escaped").read_text())
    while Path(f"/proc/{pid}").exists():
        await asyncio.sleep(0.01)
    print("gone")
"""
    assert grade(tmp_path / "b", ESCAPES, after, UNCONFINED) == ["gone"]


def test_the_server_cleans_up_after_a_grader_that_was_killed(tmp_path):
    program = "import time\nprint('on')\ntime.sleep(600)"
    after = """
    while not output:
        await asyncio.sleep(0.01)
    print(process._pid, flush=True)
    os.kill(os.getpid(), 9)
"""
    (pid,) = grade(tmp_path / "b", program, after)
    # The streams of the server are those of the grader, so `grade` returned after the server.
    assert not (tmp_path / "b").exists()
    gone = [sys.executable, "-c", f"import os; os.kill({pid}, 0)"]
    assert b"ProcessLookupError" in subprocess.run(gone, capture_output=True, check=False).stderr
