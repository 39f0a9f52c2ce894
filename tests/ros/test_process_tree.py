"""A program ends together with the processes that it has started."""

import asyncio
import os
import signal
import subprocess
import sys
import time

import pytest

from taskrpc.ros.process_tree import ProcessTree

pytestmark = pytest.mark.real_time

PARENT = """
import signal, subprocess, sys, time
child = "import os, signal, time; signal.signal(2, signal.SIG_IGN); os.write(1, b'0')"
child += "; time.sleep(600)"
subprocess.Popen([sys.executable, "-c", child])
time.sleep(600)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a job object does this there")
async def test_signals_reach_descendants_and_none_is_left():
    said = asyncio.Event()
    tree = await ProcessTree.start([sys.executable, "-c", PARENT], lambda stream, data: said.set())
    await said.wait()
    tree.send_signal(signal.SIGINT)
    assert await tree.wait() == -signal.SIGINT
    assert tree.has_processes()
    await tree.end_descendants()
    assert not tree.has_processes()


@pytest.mark.skipif(sys.platform == "win32", reason="uvloop is not for Windows")
def test_programs_start_and_end_on_uvloop():
    async def start_and_end():
        said = asyncio.Event()
        tree = await ProcessTree.start(
            [sys.executable, "-c", PARENT], lambda stream, data: said.set()
        )
        await said.wait()
        assert os.getpgid(tree.pid) == tree.pid
        tree.send_signal(signal.SIGINT)
        assert await tree.wait() == -signal.SIGINT
        await tree.end_descendants()
        assert not tree.has_processes()

    uvloop = pytest.importorskip("uvloop")
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(start_and_end())


async def test_end_is_seen_while_a_descendant_keeps_the_output_open():
    child = "import os, time; os.write(1, b'%d' % os.getpid()); time.sleep(600)"
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {child!r}]); input()"
    said = []
    tree = await ProcessTree.start(
        [sys.executable, "-c", code], lambda stream, data: said.append(data)
    )
    while not said:
        await asyncio.sleep(0.01)
    os.kill(tree.pid, signal.SIGTERM)
    await asyncio.wait_for(tree.wait(), 60)
    os.kill(int(said[0]), signal.SIGTERM)


async def test_program_reads_what_is_written_to_it():
    output = []
    command = [sys.executable, "-c", "print(input()[::-1])"]
    tree = await ProcessTree.start(command, lambda _, data: output.append(data))
    tree.write(b"abc\n")
    assert await tree.wait() == 0
    tree.write(b"late\n")
    assert b"".join(output).split() == [b"cba"]


async def test_output_has_its_stream_and_files_are_closed():
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for has_terminal in (False, True):
        found = {}
        code = "import sys; print('a'); print('b', file=sys.stderr); sys.exit(3)"
        tree = await ProcessTree.start(
            [sys.executable, "-c", code],
            lambda stream, data, found=found: found.setdefault(stream, data.strip()),
            has_terminal=has_terminal,
        )
        assert await tree.wait() == 3
        assert found == {1: b"a", 2: b"b"}
    await asyncio.sleep(0)
    if before:
        assert len(os.listdir("/proc/self/fd")) <= before


async def test_caller_gets_the_tree_before_the_output():
    for _ in range(2):
        order = []
        command = [sys.executable, "-c", "print(1)"]
        tree = await ProcessTree.start(command, lambda *_, order=order: order.append("output"))
        order.append("started")
        time.sleep(0.05)  # the program ends before the event loop runs again
        await tree.wait()
        assert order[0] == "started"
        assert set(order[1:]) == {"output"}  # in one piece or more


LAUNCH = """
import asyncio, sys
from taskrpc.ros.process_tree import ProcessTree, end_children_with_this_process
end_children_with_this_process()
async def main():
    said = asyncio.Event()
    ended = await ProcessTree.start([sys.executable, "-c", ""], print)
    await ended.wait()
    await ProcessTree.start([sys.executable, "-c", sys.argv[1]], lambda *_: said.set())
    await said.wait()
    print("started", flush=True)
    await asyncio.sleep(600)
asyncio.run(main())
"""
WAITS = """
import os, signal, sys, time
def end(number, frame):
    open({path!r}, "w").close()
    sys.exit()
# SIGTERM follows after two seconds, in which a busy machine may not let this program run.
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, end)
# One write: with PYTHONUNBUFFERED, `print` writes the newline separately. By then the reader of the
# pipe may have been killed, and BrokenPipeError would end this program before a signal does.
os.write(1, b"running")
time.sleep(600)
"""


async def test_programs_end_if_the_process_that_started_them_is_killed(tmp_path):
    path = tmp_path / "ended"
    command = [sys.executable, "-c", LAUNCH, WAITS.format(path=str(path))]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline().split() == [b"started"]
        process.kill()
    if sys.platform != "win32":  # there the program does not learn that it ends
        try:
            async with asyncio.timeout(60):
                while not path.exists():
                    await asyncio.sleep(0.01)
        except TimeoutError:
            listed = subprocess.run(["ps", "-A", "-o", "pid,pgid,stat,args"], capture_output=True)
            lines = [each for each in listed.stdout.splitlines() if os.fsencode(path) in each]
            pytest.fail(f"the program did not end by a signal; it is now {lines or 'gone'}")


async def test_missing_program_raises_and_leaves_no_file_open():
    with pytest.raises(FileNotFoundError):
        await ProcessTree.start(["no-such-program-9"], print)
