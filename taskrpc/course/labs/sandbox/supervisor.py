"""Process 1 of a sandbox: starts programs by forking a process that has imported taskrpc.

It starts them in milliseconds, and connects the checks with the registry and the loopback in the
sandbox; `orders` lists the messages. It is a part of the sandbox: a submission that attacks it
harms only its own checks. Without bubblewrap, it does the same as a process beside the others.

When the grader ends, however it ended, its end of the socket closes. The supervisor then kills all
programs.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import shutil
import signal
import socket
import sys
import tempfile
from pathlib import Path

import msgspec

from taskrpc.course.labs.sandbox import child, orders
from taskrpc.course.labs.sandbox.child import Start, environment, run
from taskrpc.course.labs.sandbox.orders import Setup
from taskrpc.course.labs.submission import remove
from taskrpc.spi import Registry, TrackedEntry

_POLL = 0.01
"""Seconds between two looks at the registry."""
_BACKLOG = 64


if sys.platform != "win32":

    def main(text: str) -> int:
        """Serve until the grader ends. In each program: run it, and return its exit code."""
        setup = msgspec.json.decode(text, type=Setup)
        child.preload()
        start = Supervisor(setup).serve()
        return 0 if start is None else run(start)

    class Supervisor:
        """Carries out the orders of the checks.

        Each program leaves `serve` through the caller's frames, so that Python ends it as any other
        program.
        """

        def __init__(self, setup: Setup) -> None:
            self._setup = setup
            self._control = socket.socket(fileno=setup.control)
            self._control.set_inheritable(False)
            self._reader = orders.Reader(self._control)
            self._programs: set[int] = set()
            self._scratch = Path()
            """The folder of this check."""
            self._before: set[str] = set()
            """What was in the folder of all checks before the first one."""
            self._registry: Registry | None = None
            self._own: TrackedEntry | None = None
            self._seen: object = None
            """The registry's signature at the last report; None to report in any case."""
            self._woken, wake = os.pipe()
            os.set_blocking(wake, False)
            os.set_blocking(self._woken, False)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGCHLD, lambda *_: None)
            signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
            if setup.confined:
                self._before = set(os.listdir(setup.base))
            else:
                os.setpgid(0, 0)  # the end of the grader's group must not end it: it cleans up
            gc.freeze()

        def serve(self) -> Start | None:
            """Serve until the grader ends; in each program, return what it has to run."""
            try:
                start = self._served()
            except BaseException:
                self._end()
                raise
            if start is None:
                self._end()
            return start

        def _served(self) -> Start | None:
            while True:
                timeout = None if self._registry is None else _POLL
                sources: list[socket.socket | int] = [self._control, self._woken]
                ready, _, _ = select.select(sources, [], [], timeout)
                if self._woken in ready:
                    with contextlib.suppress(BlockingIOError):
                        os.read(self._woken, 2**16)
                    self._reap()
                if self._control in ready:
                    try:
                        lines = self._reader.read()
                    except OSError:
                        lines = None
                    if lines is None:
                        return None
                    for line in lines:
                        if start := self._obey(msgspec.json.decode(line, type=orders.Order)):
                            return start
                self._report_entries()

        def _obey(self, order: orders.Order) -> Start | None:
            """Carry out an order; in a new program, return what it has to run."""
            match order:
                case orders.Begin():
                    self._begin()
                case orders.End():
                    self._end_check()
                case orders.Run():
                    return self._fork(order.start)
                case orders.Signal():
                    if order.pid in self._programs:
                        with contextlib.suppress(OSError):
                            os.killpg(order.pid, order.number)
                case orders.Publish():
                    self._publish(order)
                case orders.Socket():
                    with _tcp_socket() as made:
                        self._tell(orders.Made(), made.fileno())
            return None

        def _begin(self) -> None:
            os.makedirs(self._setup.base, mode=0o700, exist_ok=True)
            self._scratch = Path(tempfile.mkdtemp(prefix="check", dir=self._setup.base))
            if not self._setup.confined:
                shutil.copytree(self._setup.submission, self._scratch / "submission")
            os.environ.update(environment(self._scratch))
            self._registry, self._own, self._seen = Registry(0), None, None
            folder = os.open(self._setup.base, os.O_RDONLY | os.O_DIRECTORY)
            with _tcp_socket() as listening:
                listening.bind(("127.0.0.1", 0))
                listening.listen(_BACKLOG)
                self._tell(orders.Begun(), listening.fileno(), folder)
            os.close(folder)

        def _end_check(self) -> None:
            """End the check; raises OSError if its files cannot be removed."""
            self._kill_all()
            if self._registry is not None:
                self._registry.abandon()
                self._registry = None
            if self._setup.confined:
                for name in set(os.listdir(self._setup.base)) - self._before:
                    path = Path(self._setup.base, name)
                    shutil.rmtree(
                        path
                    ) if path.is_dir() and not path.is_symlink() else path.unlink()
            else:
                remove(self._scratch)
            self._tell(orders.Cleaned())

        def _publish(self, order: orders.Publish) -> None:
            if self._registry is None:
                return
            if self._own is None:
                # The pid of the checks means nothing here.
                self._own = TrackedEntry(msgspec.structs.replace(order.entry, pid=os.getpid()))
            self._registry.publish(self._own, order.change)

        def _report_entries(self) -> None:
            if self._registry is None:
                return
            signature = self._registry.signature()
            if signature != self._seen:
                self._seen = signature
                entries = [tracked.entry() for tracked in self._registry.others()]
                self._tell(orders.Entries(entries))

        def _fork(self, start: Start) -> Start | None:
            files = self._reader.take(3)
            pid = os.fork()
            with contextlib.suppress(OSError):  # both do it, so that it is done for either
                os.setpgid(pid, pid)
            if pid:
                for each in files:
                    os.close(each)
                self._programs.add(pid)
                self._tell(orders.Started(pid))
                return None
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for number, each in enumerate(files):
                os.dup2(each, number)
            self._control.close()
            self._registry = None  # closes its folder, before the descriptor means another file
            os.closerange(3, 256)
            confined = self._setup.confined
            folder = self._setup.submission if confined else str(self._scratch / "submission")
            return msgspec.structs.replace(
                start, scratch=str(self._scratch), folder=folder, confined=confined
            )

        def _reap(self) -> None:
            while ended := self._ended():
                pid, status = ended
                self._seen = None  # its entry is that of a dead process
                if pid in self._programs:
                    self._programs.remove(pid)
                    self._tell(orders.Ended(pid, os.waitstatus_to_exitcode(status)))
            if self._setup.confined:
                for pid in set(_children()) - self._programs:  # what a program has left behind
                    _kill(pid)

        def _ended(self) -> tuple[int, int] | None:
            """Return the id and the status of a child that has ended, and end its group."""
            try:
                if sys.platform == "linux":
                    # While the child is a zombie, no other process can have its id.
                    found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
                    if found is None:
                        return None
                    if found.si_pid in self._programs:
                        _kill(found.si_pid, group=True)
                    return os.waitpid(found.si_pid, 0)
                else:
                    pid, status = os.waitpid(-1, os.WNOHANG)
                    if pid in self._programs:
                        _kill(pid, group=True)
                    return (pid, status) if pid else None
            except ChildProcessError:
                return None

        def _kill_all(self) -> None:
            if self._setup.confined:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(-1, signal.SIGKILL)  # all processes of the sandbox but this one
            for pid in self._programs:
                _kill(pid, group=True)
            while self._programs:
                pid, status = os.waitpid(-1, 0)
                if pid in self._programs:
                    self._programs.remove(pid)
                    self._tell(orders.Ended(pid, os.waitstatus_to_exitcode(status)))

        def _tell(self, report: orders.Report, *files: int) -> None:
            data = msgspec.json.encode(report) + b"\n"
            with contextlib.suppress(OSError):  # the grader has ended: `serve` sees that next
                if files:
                    sent = socket.send_fds(self._control, [data], files)
                    data = data[sent:]
                self._control.sendall(data)

        def _end(self) -> None:
            self._kill_all()
            if not self._setup.confined and os.path.isdir(self._setup.base):
                remove(Path(self._setup.base))

    def _tcp_socket() -> socket.socket:
        # The protocol is explicit for asyncio, which then sends small packets at once.
        return socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)

    def _kill(pid: int, *, group: bool = False) -> None:
        with contextlib.suppress(OSError):
            (os.killpg if group else os.kill)(pid, signal.SIGKILL)

    def _children() -> list[int]:
        """Return the ids of this process's children, also of adopted ones."""
        try:
            return [int(each) for each in Path("/proc/self/task/1/children").read_text().split()]
        except OSError:  # a kernel without this file
            return []
