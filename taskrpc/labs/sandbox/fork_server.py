"""Starts programs by forking a process that has imported taskrpc: in milliseconds, on POSIX.

The server is a process of its own. When its end of the socket closes, however the grader ended,
it kills all programs. It also adopts and kills processes that a program has left behind.

    grader to server:   {"start": {...}} with three descriptors, or {"signal": 2, "pid": 71}
    server to grader:   {"pid": 71}, and at its end {"ended": 71, "code": 0}
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import socket
import sys
import traceback
from pathlib import Path

import msgspec

from taskrpc.labs.sandbox import linux
from taskrpc.labs.sandbox.child import Start, run
from taskrpc.labs.submission import remove

LONGEST = 2**16
"""Most bytes of a message."""


class Request(msgspec.Struct, omit_defaults=True):
    """What the grader asks for: to start a program, or to send a signal to one."""

    start: Start | None = None
    signal: int = 0
    pid: int = 0


class Report(msgspec.Struct, omit_defaults=True):
    """What the server says: the id of a program that it started, or how one ended."""

    pid: int = 0
    ended: int = 0
    code: int = 0


if sys.platform != "win32":

    def fork_server(base: Path) -> socket.socket:
        """Fork the server; returns the grader's end of the socket.

        At its end the server removes the folder `base`, if the grader could not do that.
        Call it before the first thread, outside of `try` and `with`: each program leaves through
        the caller's frames, so that Python ends it as any other program.
        """
        ours, its = socket.socketpair()
        sys.stdout.flush()
        sys.stderr.flush()
        if os.fork():
            its.close()
            return ours
        ours.close()
        try:
            os.setpgid(0, 0)  # the end of the grader's group must not end it: it cleans up
            start = _Server(its).serve()
        except BaseException:
            traceback.print_exc()
            start = None
        if start is None:
            if base.exists():
                remove(base)
            os._exit(0)
        sys.exit(run(start))

    class _Server:
        def __init__(self, requests: socket.socket) -> None:
            self._requests = requests
            self._received = b""
            self._files: list[int] = []
            self._programs: set[int] = set()
            self._woken, wake = os.pipe()
            os.set_blocking(wake, False)
            os.set_blocking(self._woken, False)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGCHLD, lambda *_: None)
            signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
            linux.adopt_orphans()
            gc.freeze()

        def serve(self) -> Start | None:
            """Serve until the grader ends; in each program, return what it has to run."""
            while True:
                sources: list[socket.socket | int] = [self._requests, self._woken]
                ready, _, _ = select.select(sources, [], [])
                if self._woken in ready:
                    with contextlib.suppress(BlockingIOError):
                        os.read(self._woken, LONGEST)
                    self._reap()
                if self._requests not in ready:
                    continue
                for request in self._requested():
                    if request is None:
                        self._end()
                        return None
                    if request.start is not None and self._fork():
                        return request.start
                    if request.pid in self._programs:
                        with contextlib.suppress(OSError):
                            os.killpg(request.pid, request.signal)

        def _requested(self) -> list[Request | None]:
            """Read requests; None at the end of the grader."""
            try:
                data, files, _, _ = socket.recv_fds(self._requests, LONGEST, 3)
            except OSError:
                data, files = b"", []
            if not data:
                return [None]
            self._files += files
            *lines, self._received = (self._received + data).split(b"\n")
            return [msgspec.json.decode(line, type=Request) for line in lines]

        def _fork(self) -> bool:
            """Start a program; returns whether this process is it."""
            files, self._files = self._files, []
            pid = os.fork()
            with contextlib.suppress(OSError):  # both do it, so that it is done for either
                os.setpgid(pid, pid)
            if pid:
                for each in files:
                    os.close(each)
                self._programs.add(pid)
                self._tell(Report(pid=pid))
                return False
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for number, each in enumerate(files):
                os.dup2(each, number)
            self._requests.close()
            os.closerange(3, 256)
            return True

        def _reap(self) -> None:
            while ended := self._ended():
                pid, status = ended
                if pid in self._programs:
                    self._programs.remove(pid)
                    self._tell(Report(ended=pid, code=os.waitstatus_to_exitcode(status)))
            self._kill(set(linux.adopted()) - self._programs)

        def _ended(self) -> tuple[int, int] | None:
            """Return the id and the status of a child that has ended, and end its group."""
            try:
                if sys.platform == "linux":
                    # While the child is a zombie, no other process can have its id.
                    found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
                    if found is None:
                        return None
                    self._kill({found.si_pid} & self._programs, group=True)
                    return os.waitpid(found.si_pid, 0)
                else:
                    pid, status = os.waitpid(-1, os.WNOHANG)
                    self._kill({pid} & self._programs, group=True)
                    return (pid, status) if pid else None
            except ChildProcessError:
                return None

        def _kill(self, pids: set[int], *, group: bool = False) -> None:
            for pid in pids:
                with contextlib.suppress(OSError):
                    (os.killpg if group else os.kill)(pid, signal.SIGKILL)

        def _tell(self, report: Report) -> None:
            with contextlib.suppress(OSError):  # the grader has ended: `serve` sees that next
                self._requests.sendall(msgspec.json.encode(report) + b"\n")

        def _end(self) -> None:
            self._kill(self._programs, group=True)
            for pid in self._programs:
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, 0)
            self._kill(set(linux.adopted()))
