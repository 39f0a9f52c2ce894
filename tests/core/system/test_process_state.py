"""The system's answers about a process: its open files, whether it is stopped, has ended."""

import os
import signal
import subprocess
import sys

import pytest

from taskrpc.core.system import process_state

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells it")
posix = pytest.mark.skipif(os.name != "posix", reason="Windows has no such states")


@linux
def test_a_file_is_open_in_the_process_that_opened_it(tmp_path):
    with (tmp_path / "file").open("w") as file:
        found = os.fstat(file.fileno())
        assert process_state.has_open(os.getpid(), found)
    assert not process_state.has_open(os.getpid(), found)
    assert not process_state.has_open(-os.getpid(), found)


@pytest.mark.real_time
@posix
def test_a_stopped_process_and_an_ended_one_are_told_apart():
    program = "import signal; print(flush=True); signal.pause()"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        process.stdout.readline()

        def state():
            pid = process.pid
            return process_state.is_stopped(pid), process_state.has_ended(pid)

        os.kill(process.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
        stopped = state()
        process.kill()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        ended = state()
    assert (stopped, ended) == ((True, False), (False, True))


@linux
def test_a_process_that_ignores_the_signal_to_end_is_recognised():
    assert not process_state.ignores_end(os.getpid())
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        assert process_state.ignores_end(os.getpid())
    finally:
        signal.signal(signal.SIGTERM, before)
