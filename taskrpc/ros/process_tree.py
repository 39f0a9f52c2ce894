"""Programs that are started with all their descendants, and that leave none of them behind.

POSIX: each program gets a process group of its own, and signals go to the group. Windows: each
program gets a console group. If this process is killed, a job object of Windows ends its programs,
or a guard: a shell that reads the numbers of the groups from this process until its end.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, cast

from taskrpc.ros.command_line import startable

_DRAIN = 2.0 if sys.platform == "win32" else 0.2
"""Seconds without output after a program's end until a descendant that keeps its pipes open is
not waited for. Windows may deliver the last output of a program after its end."""
_DRAINS = 10
"""How often `_DRAIN` is waited while output still arrives."""
_POLL = 0.05
_LAST_WAIT = 2.0
"""Seconds that descendants have to end after SIGTERM, once their program is gone."""


class ProcessTree:
    """A program and the processes that it starts; create it with `start`."""

    def __init__(self, program: _Program, transports: list[asyncio.BaseTransport]) -> None:
        self._program = program
        self._transports = transports
        """What is closed when the program has ended: the program's own transport is the first."""

    @classmethod
    async def start(
        cls,
        command: Sequence[str] | str,
        on_output: Callable[[int, bytes], None],
        *,
        cwd: str | None = None,
        env: Mapping[str, str] | None = None,
        has_terminal: bool = False,
    ) -> ProcessTree:
        """Start a program; raises OSError if that is not possible.

        Args:
            command: the program and its arguments, or one line for the shell.
            on_output: gets 1 or 2 for the stream, and what the program has written to it.
            has_terminal: let the program write to terminals instead of pipes, where there are any.
        """
        loop = asyncio.get_running_loop()
        program = _Program(on_output)
        ours, its = _terminals() if has_terminal else ([], [])
        outputs: dict[str, Any] = dict(zip(("stdout", "stderr"), its, strict=False))
        options = {**_own_group(loop), **outputs, "cwd": cwd, "env": env}
        try:
            if isinstance(command, str):
                transport, _ = await loop.subprocess_shell(lambda: program, command, **options)
            else:
                words = startable(command, env)
                transport, _ = await loop.subprocess_exec(lambda: program, *words, **options)
        except BaseException:
            _close(ours)
            raise
        finally:
            _close(its)
        tree = cls(program, [transport])
        for number, descriptor in enumerate(ours, start=1):
            opened, _ = await loop.connect_read_pipe(
                partial(_Terminal, program, number), os.fdopen(descriptor, "rb", 0)
            )
            tree._transports.append(opened)
        _tell_guard("+", program.pid)
        loop.call_soon(program.begin)  # the caller gets the tree before the output
        return tree

    @property
    def pid(self) -> int:
        """The process id of the program."""
        return self._program.pid

    @property
    def returncode(self) -> int | None:
        """The program's exit code, negative after a signal; None while it runs."""
        return self._program.returncode

    async def wait(self) -> int:
        """Wait for the end of the program and of its output; returns the exit code.

        If this is cancelled, the program is killed.
        """
        program = self._program
        program.begin()
        try:
            await program.ended.wait()
            for _ in range(_DRAINS):
                seen = program.received
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(program.all_read.wait(), _DRAIN)
                if program.received == seen:
                    break
        finally:
            for each in self._transports:
                each.close()
        if not self.has_processes():
            _tell_guard("-", self.pid)
        assert program.returncode is not None
        return program.returncode

    def write(self, data: bytes) -> None:
        """Write to the program's standard input; nothing happens once it has ended."""
        self._program.write(data)

    def send_signal(self, number: int) -> None:
        """Send a signal to the program and its descendants, if there are any left."""
        if sys.platform == "win32":
            with contextlib.suppress(OSError):
                if number == signal.SIGINT and self.returncode is None:
                    os.kill(self.pid, signal.CTRL_BREAK_EVENT)
                elif self.returncode is None:
                    self._program.terminate()
        else:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, number)

    def kill(self) -> None:
        """End the program and its descendants at once."""
        if sys.platform == "win32":
            self.send_signal(signal.SIGTERM)
        else:
            self.send_signal(signal.SIGKILL)

    def has_processes(self) -> bool:
        """Return whether the program, or a descendant of its group, still runs."""
        if sys.platform == "win32":
            return self.returncode is None
        else:
            try:
                os.killpg(self.pid, 0)
            except ProcessLookupError:
                return False
            except PermissionError:  # macOS: only zombies are left
                return False
            return True

    async def end_descendants(self) -> None:
        """End what the program has left running: first with SIGTERM, then at once."""
        if not self.has_processes():
            return
        self.send_signal(signal.SIGTERM)
        if sys.platform != "win32":
            self.send_signal(signal.SIGCONT)  # a stopped process handles no signal
        for _ in range(int(_LAST_WAIT / _POLL)):
            if not self.has_processes():
                break
            await asyncio.sleep(_POLL)
        else:
            self.kill()
        _tell_guard("-", self.pid)


class _Program(asyncio.SubprocessProtocol):
    """What asyncio reports of one program: its output and its end.

    asyncio's own `Process.wait` also waits for descendants that keep the pipes open.
    """

    def __init__(self, on_output: Callable[[int, bytes], None]) -> None:
        self._on_output = on_output
        self._transport: asyncio.SubprocessTransport | None = None
        self._open = {1, 2}
        self._early: list[tuple[int, bytes]] | None = []
        """Output that arrived before `begin`; None afterwards."""
        self.pid = 0
        self.returncode: int | None = None
        self.received = 0
        """The bytes of output so far."""
        self.ended = asyncio.Event()
        self.all_read = asyncio.Event()
        """Set at the end of both streams."""

    def begin(self) -> None:
        """Begin to pass the output on; a second call does nothing."""
        early, self._early = self._early or (), None
        for each in early:
            self._on_output(*each)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # Cast, not checked: uvloop's transports are no subclasses of asyncio's.
        self._transport = cast("asyncio.SubprocessTransport", transport)
        self.pid = self._transport.get_pid()

    def pipe_data_received(self, fd: int, data: bytes) -> None:
        self.received += len(data)
        if self._early is None:
            self._on_output(fd, data)
        else:
            self._early.append((fd, data))

    def pipe_connection_lost(self, fd: int, exc: Exception | None) -> None:
        self._open.discard(fd)
        if not self._open:
            self.all_read.set()

    def process_exited(self) -> None:
        assert self._transport is not None
        self.returncode = self._transport.get_returncode()
        self.ended.set()

    def terminate(self) -> None:
        assert self._transport is not None
        self._transport.terminate()

    def write(self, data: bytes) -> None:
        assert self._transport is not None
        pipe = cast("asyncio.WriteTransport | None", self._transport.get_pipe_transport(0))
        if pipe is not None:
            pipe.write(data)


class _Terminal(asyncio.Protocol):
    """Passes to a program what arrives from one of its terminals."""

    def __init__(self, program: _Program, number: int) -> None:
        self._program = program
        self._number = number

    def data_received(self, data: bytes) -> None:
        self._program.pipe_data_received(self._number, data)

    def connection_lost(self, exc: Exception | None) -> None:  # an error on Linux, too
        self._program.pipe_connection_lost(self._number, exc)


def _terminals() -> tuple[list[int], list[int]]:
    """Our ends of two terminals and the program's, for its output; Windows has none."""
    if sys.platform == "win32":
        return [], []
    else:
        pairs = [os.openpty() for _ in range(2)]
        return [one for one, _ in pairs], [other for _, other in pairs]


def _close(descriptors: list[int]) -> None:
    for each in descriptors:
        os.close(each)


def _own_group(loop: asyncio.AbstractEventLoop) -> dict[str, Any]:
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    elif type(loop).__module__.startswith("uvloop"):
        return {"start_new_session": True}  # uvloop has no `process_group`
    else:
        return {"process_group": 0}


if sys.platform == "win32":

    def end_children_with_this_process() -> None:
        """Let Windows end all descendants of this process when it ends, however it ends."""
        import ctypes

        class Limits(ctypes.Structure):
            _fields_ = (
                ("times", ctypes.c_int64 * 2),
                ("flags", ctypes.c_uint32),
                ("sizes", ctypes.c_size_t * 2),
                ("processes", ctypes.c_uint32),
                ("affinity", ctypes.c_size_t),
                ("classes", ctypes.c_uint32 * 2),
                ("counts", ctypes.c_uint64 * 6),
                ("memory", ctypes.c_size_t * 4),
            )

        kernel = ctypes.windll.kernel32
        kernel.CreateJobObjectW.restype = ctypes.c_void_p
        kernel.GetCurrentProcess.restype = ctypes.c_void_p
        limits = Limits(flags=0x2000)  # JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE
        job = ctypes.c_void_p(kernel.CreateJobObjectW(None, None))
        # 9: JobObjectExtendedLimitInformation. The handle stays open until this process ends.
        kernel.SetInformationJobObject(job, 9, ctypes.byref(limits), ctypes.sizeof(limits))
        kernel.AssignProcessToJobObject(job, ctypes.c_void_p(kernel.GetCurrentProcess()))

    def _tell_guard(change: str, group: int) -> None:
        """Do nothing: the job object knows the processes."""

else:
    _GUARD = """
trap '' INT TERM HUP QUIT
groups=
while read -r change group; do
    kept=
    for each in $groups; do
        [ "$each" = "-$group" ] || kept="$kept $each"
    done
    groups=$kept
    [ "$change" = - ] || groups="$groups -$group"
done
for name in INT TERM KILL; do
    found=
    for each in $groups; do
        kill -s $name -- $each 2>/dev/null && found=1
    done
    [ -n "$found" ] || exit
    sleep 2
done
"""
    """Reads `+ GROUP` and `- GROUP`, and ends the remaining groups after the end of its input."""
    _guard: list[int] = []
    """The descriptor to which the changes are written, while there is a guard."""

    def end_children_with_this_process() -> None:
        """Let a guard end all programs that start from now on if this process is killed."""
        if _guard:
            return
        reading, writing = os.pipe()
        try:
            os.posix_spawn(
                "/bin/sh",
                ["sh", "-c", _GUARD],
                os.environ,
                file_actions=[
                    (os.POSIX_SPAWN_DUP2, reading, 0),
                    # It must not keep this process's output open.
                    *((os.POSIX_SPAWN_OPEN, each, os.devnull, os.O_WRONLY, 0) for each in (1, 2)),
                ],
                setpgroup=0,
            )
        finally:
            os.close(reading)
        _guard.append(writing)

    def _tell_guard(change: str, group: int) -> None:
        """Tell the guard that a group of processes begins (`+`) or has ended (`-`)."""
        for descriptor in _guard:
            with contextlib.suppress(OSError):
                os.write(descriptor, f"{change} {group}\n".encode())
