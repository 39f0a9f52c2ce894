"""What the kernel forbids to a process, tried without the audit hook."""

import subprocess
import sys
import textwrap

import pytest

from taskrpc.labs.sandbox import linux

pytestmark = [
    pytest.mark.labs,
    pytest.mark.real_time,
    pytest.mark.skipif(not linux.can_confine(), reason="needs Linux on a known processor"),
]

START = """
import errno, mmap, os, signal, socket, resource, sys, threading, ctypes, _posixsubprocess
from pathlib import Path
from taskrpc.labs.sandbox import linux

def refused(action):
    try:
        action()
    except OSError as error:
        assert error.errno in (errno.EPERM, errno.EACCES), error
        return True
    except ValueError as error:  # what `resource` makes of EPERM
        return "not allowed" in str(error)
    return False
"""


def run(code, *arguments):
    program = START + textwrap.dedent(code)
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(
    "action",
    [
        "os.fork()",
        "os.execv('/bin/true', ['true'])",
        "os.posix_spawn('/bin/true', ['true'], {})",
        "os.kill(os.getppid(), 0)",
        "os.killpg(0, 0)",
        "os.setsid()",
        "os.pidfd_open(1)",
        "socket.socket()",
        "socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)",
        "resource.setrlimit(resource.RLIMIT_NOFILE, (9, 9))",
        "resource.prlimit(0, resource.RLIMIT_NOFILE, (9, 9))",
        "mmap.mmap(-1, 4096)",
        "os.memfd_create('memory')",
        "os.mknod('/tmp/taskrpc-disk', 0o60600, os.makedev(8, 0))",
        "os.mkfifo('/tmp/taskrpc-pipe')",
        "os.nice(-1)",
        "os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))",
    ],
)
def test_system_call_is_refused(action):
    done = run(f"assert linux.forbid_system_calls()\nassert refused(lambda: {action})")
    assert done.returncode == 0, done.stderr


def test_what_programs_need_still_works():
    done = run("""
        assert linux.forbid_system_calls()
        thread = threading.Thread(target=print, args=("a thread",))
        thread.start()
        thread.join()
        socket.socketpair()[0].close()
        os.kill(os.getpid(), 0)
        mmap.mmap(-1, 4096, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
        resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.prlimit(0, resource.RLIMIT_NOFILE)
        signal.signal(signal.SIGUSR1, lambda *_: print("a signal"))
        signal.raise_signal(signal.SIGUSR1)
    """)
    assert done.stdout.split("\n")[:2] == ["a thread", "a signal"], done.stderr


def test_files_elsewhere_cannot_be_read_or_written(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for each in (own, other):
        each.mkdir()
        (each / "file").write_text("text")
    (own / "link").symlink_to(other / "file")
    done = run(
        """
        own, other = map(Path, sys.argv[1:])
        if not linux.limit_files([Path("/usr"), Path("/dev/null")], [own]):
            sys.exit(3)
        assert refused(lambda: open(other / "file"))
        assert refused(lambda: open(other / "new", "w"))
        assert refused(lambda: os.listdir(other))
        assert refused(lambda: os.unlink(other / "file"))
        assert refused(lambda: open(own / "link"))
        assert refused(lambda: os.rename(own / "file", other / "file"))
        assert refused(lambda: open("/usr/new", "w"))
        assert refused(lambda: open(f"/proc/{os.getppid()}/environ"))
        (own / "file").write_text("changed")
        (own / "folder").mkdir()
        """,
        own,
        other,
    )
    if done.returncode == 3:
        pytest.skip("this kernel has no Landlock")
    assert done.returncode == 0, done.stderr
    assert (own / "file").read_text() == "changed"
    assert (other / "file").read_text() == "text"
