"""Programs that are started with all their descendants, and that leave none of them behind.

POSIX: each program gets a process group of its own, and signals go to the group. Windows: each
program gets a console group, and a job object ends everything that is left with this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

_CHUNK = 2**16
_DRAIN = 0.2
"""Seconds to read what a program wrote before its end, if a descendant keeps its pipes open."""
_POLL = 0.05
_LAST_WAIT = 2.0
"""Seconds that descendants have to end after SIGTERM, once their program is gone."""


class ProcessTree:
    """A program and the processes that it starts; create it with `start`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._readers: list[asyncio.Task[None]] = []
        self._stdin = -1
        """The open end of the program's standard input: it waits, as in ROS, and gets no end."""

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
        # Pipes of asyncio would let `wait` wait for descendants that keep them open.
        outer, inner = _streams(has_terminal)
        options: dict[str, Any] = {
            **_own_group(),
            **dict(zip(("stdin", "stdout", "stderr"), inner, strict=True)),
            "cwd": cwd,
            "env": env,
        }
        try:
            if isinstance(command, str):
                process = await asyncio.create_subprocess_shell(command, **options)
            else:
                process = await asyncio.create_subprocess_exec(*command, **options)
        except OSError:
            _close(outer)
            raise
        finally:
            _close(inner if outer else [])
        tree = cls(process)
        streams = [process.stdout, process.stderr]
        if outer:
            tree._stdin, *outputs = outer
            streams = [await _reader_of(output) for output in outputs]
        tree._readers = [
            asyncio.ensure_future(_read(stream, number, on_output))
            for number, stream in enumerate(streams, start=1)
            if stream is not None
        ]
        return tree

    @property
    def pid(self) -> int:
        """The process id of the program."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """The program's exit code, negative after a signal; None while it runs."""
        return self._process.returncode

    async def wait(self) -> int:
        """Wait for the end of the program and of its output; returns the exit code."""
        code = await self._process.wait()
        if self._readers:
            _, unfinished = await asyncio.wait(self._readers, timeout=_DRAIN)
            for each in unfinished:
                each.cancel()
        if self._stdin >= 0:
            os.close(self._stdin)
            self._stdin = -1
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to the program and its descendants, if there are any left."""
        if sys.platform == "win32":
            with contextlib.suppress(OSError):
                if number == signal.SIGINT and self.returncode is None:
                    os.kill(self.pid, signal.CTRL_BREAK_EVENT)
                elif self.returncode is None:
                    self._process.terminate()
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
                return
            await asyncio.sleep(_POLL)
        self.kill()


async def _read(
    stream: asyncio.StreamReader, number: int, on_output: Callable[[int, bytes], None]
) -> None:
    with contextlib.suppress(OSError):  # a terminal's end is an error on Linux
        while data := await stream.read(_CHUNK):
            on_output(number, data)


def _streams(has_terminal: bool) -> tuple[list[int], list[int]]:
    """Our ends of the three streams, and the program's; on Windows only the latter: pipes."""
    if sys.platform == "win32":
        return [], [subprocess.PIPE] * 3
    else:
        stdin, ours = os.pipe()
        pairs = [os.openpty() if has_terminal else os.pipe() for _ in range(2)]
        return [ours, *(one for one, _ in pairs)], [stdin, *(other for _, other in pairs)]


def _close(descriptors: list[int]) -> None:
    for each in descriptors:
        os.close(each)


async def _reader_of(descriptor: int) -> asyncio.StreamReader:
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(descriptor, "rb", 0)
    )
    return reader


def _own_group() -> dict[str, Any]:
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
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

else:

    def end_children_with_this_process() -> None:
        """Do nothing: on POSIX, `ProcessTree` ends groups of processes."""
