"""The limits that the grader itself holds: output and the size of a folder."""

import asyncio
import signal

from taskrpc.course.labs.sandbox.child import Start
from taskrpc.course.labs.sandbox.limits import LIMITS
from taskrpc.course.labs.sandbox.program import ChildProgram

START = Start("server.py", ())


class Process:
    """A process in memory."""

    def __init__(self, *, reacts=True):
        self.signals = []
        self.end = asyncio.get_running_loop().create_future()
        self.reacts = reacts
        self.used_too_much = ""

    def excess(self):
        return self.used_too_much

    async def start(self, start, on_output):
        self.write = on_output
        return self

    async def wait(self):
        return await asyncio.shield(self.end)

    def send_signal(self, number):
        self.signals.append(number)
        if self.reacts:
            self.end.set_result(-number)

    def kill(self):
        self.signals.append(9)
        if not self.end.done():
            self.end.set_result(-9)


async def started(**settings):
    process = Process(**settings)
    child = ChildProgram()
    await child.run(process, START)
    return process, child


async def test_lines_are_complete_lines_of_both_streams():
    process, child = await started()
    process.write(1, b"sum ")
    process.write(2, b"warning\r\n")
    process.write(1, b"is 5\nrest \xff")
    assert list(child.output) == ["warning", "sum is 5"]
    assert (await child.wait_for_line(r"is (\d)", 1))[1] == "5"
    assert await child.wait_for_line("never", 1) is None
    process.end.set_result(0)
    assert await child.finished(1) == 0
    assert child.output[-1] == "rest \ufffd"
    await child.kill()


async def test_a_program_that_writes_too_much_is_ended():
    process, child = await started()
    process.write(1, b"x" * LIMITS.output)
    process.write(2, b"x\n" * 100)
    assert process.signals == [9]
    assert await child.finished(1) == -9
    process.write(1, b"more\n")
    assert len(child.output) == 1
    assert child.output[0].endswith("ended this program: it wrote more than 1 MB of output")
    await child.kill()


async def test_a_program_is_ended_when_its_sandbox_uses_too_much():
    process, child = await started()
    process.used_too_much = "its folders have more than 2000 files"
    assert await child.finished(5) == -9
    assert child.output[-1].endswith("ended this program: its folders have more than 2000 files")
    await child.kill()


async def test_the_cpu_limit_is_named():
    process, child = await started()
    process.end.set_result(-24)
    await child.finished(1)
    assert child.output[-1].endswith("it computed for more than 10 s")
    await child.kill()


async def test_a_program_gets_ctrl_c_first_and_is_killed_if_it_does_not_react():
    process, child = await started()
    await child.stop()
    assert process.signals == [signal.SIGINT]
    stubborn, child = await started(reacts=False)
    await child.stop()
    assert stubborn.signals == [signal.SIGINT, 9]
    assert list(child.output) == []
