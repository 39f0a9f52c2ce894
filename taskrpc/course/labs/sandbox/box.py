"""The checks' end of a sandbox: starts it, and asks its supervisor for programs and sockets.

A sandbox serves one check after another as long as its supervisor cleans up after each. Otherwise
it is ended, and the next check gets a new one.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
from asyncio.subprocess import Process
from collections import deque
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from taskrpc.course.labs.sandbox import boot, bubblewrap, orders, speed
from taskrpc.course.labs.sandbox.child import Start, system_environment
from taskrpc.course.labs.sandbox.limits import FILES, MEGABYTE, RESIDENT
from taskrpc.course.labs.sandbox.orders import Setup
from taskrpc.course.labs.sandbox.program import Written
from taskrpc.errors import TaskRpcError
from taskrpc.spi import EntryChange, RegistryEntry

_START = 60.0
"""Real seconds that a new sandbox may need until its first check begins, on a busy machine."""
_END = 5.0
"""Real seconds in which a sandbox must clean up after a check."""
_KEPT = 2000
_Result = TypeVar("_Result")
_decode = msgspec.json.Decoder(orders.Report).decode

if sys.platform != "win32":

    class Sandbox:
        """A sandbox for the programs of one submission; use it with `async with`.

        Args:
            submission: the folder of the submission, which nothing changes.
            base: a folder in which programs without bubblewrap get folders; it need not exist.
            confined: whether to use bubblewrap; else the programs run as any other program.
        """

        def __init__(self, submission: Path, base: Path, *, confined: bool) -> None:
            self._submission = submission
            self._base = base
            self.confined = confined
            self._running: _Running | None = None

        async def __aenter__(self) -> Sandbox:
            return self

        async def __aexit__(self, *_: object) -> None:
            if self._running is not None:
                await self._running.close()

        @contextlib.asynccontextmanager
        async def check(self) -> AsyncIterator[Check]:
            """Begin a check; at the end, all its programs and files are gone.

            Raises TaskRpcError if there is no sandbox, or OSError.
            """
            if self._running is None or self._running.lost:
                self._running = await _Running.start(self._submission, self._base, self.confined)
            running = self._running
            try:
                check = await running.begin()
                try:
                    yield check
                finally:
                    await running.end()
            except BaseException:
                await running.close()
                raise

    class Check:
        """What one check has in a sandbox: a socket that listens there, entries, programs."""

        def __init__(self, running: _Running, listening: socket.socket, files: int) -> None:
            self._running = running
            self.listening = listening
            """Belongs to the network that uses it."""
            self._files = files
            self.entries: list[RegistryEntry] = []
            """The entries of the programs in the sandbox's registry."""
            self.revision = 0
            """Counts the changes of `entries`."""
            self._next: asyncio.Future[None] | None = None

        async def start(self, start: Start, on_output: Written) -> SandboxedProcess:
            """Start a program. Raises TaskRpcError if the sandbox has ended."""
            return await self._running.run(start, on_output)

        async def new_socket(self) -> socket.socket:
            """Return a socket that can connect within the sandbox. Raises TaskRpcError."""
            return await self._running.ask(orders.Socket(), self._running.sockets)

        def publish(self, entry: RegistryEntry, change: EntryChange) -> None:
            """Publish a change of the checks' entry."""
            self._running.send(orders.Publish(entry, change))

        def seen(self, entries: list[RegistryEntry]) -> None:
            """Note the entries of the registry."""
            self.entries = entries
            self.revision += 1
            if self._next is not None and not self._next.done():
                self._next.set_result(None)
            self._next = None

        async def next_change(self) -> None:
            """Return at the next change of `entries`."""
            if self._next is None:
                self._next = asyncio.get_running_loop().create_future()
            await asyncio.shield(self._next)

        def excess(self) -> str:
            """Return which limit of the sandbox is exceeded, "" if none is."""
            if not self._running.confined:
                return ""
            status = os.fstatvfs(self._files)
            if status.f_files - status.f_ffree > FILES:
                return f"its folders have more than {FILES} files"
            if _resident(self._running.pid) > RESIDENT:
                return f"its processes hold more than {RESIDENT // MEGABYTE} MB of memory"
            return ""

        def close(self) -> None:
            """Close what the network has not used."""
            self.listening.close()
            os.close(self._files)

    class _Running:
        """One process of a supervisor, and the messages to and from it."""

        def __init__(self, process: Process, control: socket.socket, *, confined: bool) -> None:
            self._process = process
            self._control = control
            self._reader = orders.Reader(control)
            self.confined = confined
            self.lost = ""
            """Why this sandbox cannot be used any more, "" while it can."""
            self.sockets: deque[asyncio.Future[socket.socket]] = deque()
            """Waiting requests for sockets."""
            self._check: Check | None = None
            self._begun: deque[asyncio.Future[Check]] = deque()
            self._cleaned: deque[asyncio.Future[None]] = deque()
            self._started: deque[asyncio.Future[tuple[int, asyncio.Future[int]]]] = deque()
            self._ends: dict[int, asyncio.Future[int]] = {}
            self._errors = asyncio.ensure_future(_last(process.stdout))
            asyncio.get_running_loop().add_reader(control, self._read)

        @classmethod
        async def start(cls, submission: Path, base: Path, confined: bool) -> _Running:
            """Start a sandbox. Raises OSError."""
            ours, its = socket.socketpair()
            ours.setblocking(False)
            filter = bubblewrap.filter_descriptor()
            try:
                where = bubblewrap.WRITABLE if confined else str(base)
                what = bubblewrap.SUBMISSION if confined else str(submission)
                setup = Setup(its.fileno(), where, what, confined)
                command = boot.command("supervisor", msgspec.json.encode(setup).decode())
                environment = system_environment()
                if confined:
                    environment.pop("TMPDIR", None)
                    command = bubblewrap.confined(command, submission, environment, filter)
                process = await asyncio.create_subprocess_exec(
                    *command,
                    stdin=asyncio.subprocess.DEVNULL,
                    # A pipe, as the streams of the programs, which get these objects of Python.
                    stdout=asyncio.subprocess.PIPE,
                    stderr=asyncio.subprocess.STDOUT,
                    pass_fds=(its.fileno(), filter),
                    env=environment,
                )
            except BaseException:
                ours.close()
                raise
            finally:
                its.close()
                os.close(filter)
            return cls(process, ours, confined=confined)

        @property
        def pid(self) -> int:
            """The process id of bubblewrap, or of the supervisor."""
            return self._process.pid

        async def begin(self) -> Check:
            """Begin a check. Raises TaskRpcError."""
            try:
                async with asyncio.timeout(_START * speed.speed()):
                    self._check = await self.ask(orders.Begin(), self._begun)
            except TimeoutError:
                self._lose(f"it did not start within {_START:g} s")
                raise TaskRpcError(f"the sandbox has ended: {self.lost}") from None
            except TaskRpcError:
                if said := await self._errors:
                    reason = said.decode(errors="replace").strip().rpartition("\n")[2]
                    raise TaskRpcError(f"the sandbox does not start: {reason}") from None
                raise
            return self._check

        async def end(self) -> None:
            """End the check; a sandbox that does not clean up is ended too."""
            check, self._check = self._check, None
            if check is not None:
                check.close()
            if not self.lost:
                try:
                    async with asyncio.timeout(_END * speed.speed()):
                        await self.ask(orders.End(), self._cleaned)
                except (TaskRpcError, TimeoutError):
                    await self.close()

        async def close(self) -> None:
            """End the sandbox and all that is in it."""
            self._lose("it was closed")
            if not self.confined:
                with contextlib.suppress(TimeoutError):  # it ends its programs first
                    async with asyncio.timeout(_END * speed.speed()):
                        await self._process.wait()
            if self._process.returncode is None:
                self._process.kill()
            await self._process.wait()
            await self._errors

        async def run(self, start: Start, on_output: Written) -> SandboxedProcess:
            """Start a program. Raises TaskRpcError."""
            outer, inner = zip(*(os.pipe() for _ in range(2)), strict=True)
            stdin, keep_open = os.pipe()  # standard input waits, as in ROS, and gets no end
            try:
                pid, end = await self.ask(orders.Run(start), self._started, stdin, *inner)
            except BaseException:
                for each in (*outer, keep_open):
                    os.close(each)
                raise
            finally:
                for each in (stdin, *inner):
                    os.close(each)
            return SandboxedProcess(self, pid, end, list(outer), keep_open, on_output)

        async def ask(
            self, order: orders.Order, waiting: deque[asyncio.Future[_Result]], *files: int
        ) -> _Result:
            """Send an order, and return what the report says. Raises TaskRpcError."""
            future: asyncio.Future[_Result] = asyncio.get_running_loop().create_future()
            waiting.append(future)
            self.send(order, *files)
            return await future

        def send(self, order: orders.Order, *files: int) -> None:
            """Send an order; a sandbox that does not read its orders is lost."""
            data = msgspec.json.encode(order) + b"\n"
            if not self.lost:
                try:
                    sent = socket.send_fds(self._control, [data], files)
                except OSError as error:
                    self._lose(f"it takes no orders: {error.strerror}")
                else:
                    if sent < len(data):
                        self._lose("it takes no orders")
            if self.lost:
                self._fail_waiting()

        def _read(self) -> None:
            try:
                lines = self._reader.read()
                if lines is None:
                    self._lose("its first process has ended")
                    return
                for line in lines:
                    self._reported(_decode(line))
            except (OSError, ValueError, IndexError, KeyError, msgspec.MsgspecError) as error:
                self._lose(f"it sent something else than reports: {error}")

        def _reported(self, report: orders.Report) -> None:
            """Handle a report; raises ValueError, IndexError or KeyError for one out of order."""
            files = self._reader.take(orders.DESCRIPTORS.get(type(report), 0))
            match report:
                case orders.Begun():
                    listening = _checked_socket(files[0])
                    _answer(self._begun, Check(self, listening, files[1]))
                case orders.Cleaned():
                    _answer(self._cleaned, None)
                case orders.Started():
                    # `run` gets its end with it: the program may have ended before `run` goes on.
                    end = self._ends[report.pid] = asyncio.get_running_loop().create_future()
                    _answer(self._started, (report.pid, end))
                case orders.Ended():
                    self._ends.pop(report.pid).set_result(report.code)
                case orders.Entries():
                    if self._check is not None:
                        self._check.seen(report.entries)
                case orders.Made():
                    _answer(self.sockets, _checked_socket(files[0]))

        def _lose(self, reason: str) -> None:
            """End the use of this sandbox."""
            if self.lost:
                return
            self.lost = reason
            asyncio.get_running_loop().remove_reader(self._control)
            self._control.close()
            for each in self._reader.descriptors:
                os.close(each)
            if self.confined and self._process.returncode is None:
                self._process.kill()
            if self._check is not None:
                self._check.seen([])
            for end in self._ends.values():
                end.set_result(-signal.SIGKILL)
            self._ends.clear()
            self._fail_waiting()

        def _fail_waiting(self) -> None:
            queues: Sequence[deque[Any]] = (
                *(self.sockets, self._begun, self._cleaned, self._started),
            )
            for queue in queues:
                while queue:
                    future = queue.popleft()
                    if not future.done():
                        future.set_exception(TaskRpcError(f"the sandbox has ended: {self.lost}"))

    class SandboxedProcess:
        """A program that a supervisor has started."""

        def __init__(
            self,
            running: _Running,
            pid: int,
            end: asyncio.Future[int],
            outputs: list[int],
            keep_open: int,
            on_output: Written,
        ) -> None:
            self._running = running
            self._pid = pid
            self._end = end
            self._keep_open = keep_open
            self._outputs = dict(enumerate(outputs, start=1))
            self._on_output = on_output
            for stream, output in self._outputs.items():
                os.set_blocking(output, False)
                asyncio.get_running_loop().add_reader(output, self._read, stream)

        async def wait(self) -> int:
            """Wait for its end and its output."""
            code = await asyncio.shield(self._end)
            # Its whole group has been killed, so nothing can write any more.
            for stream in list(self._outputs):
                while stream in self._outputs and self._read(stream):
                    continue
                self._close(stream)
            os.close(self._keep_open)
            return code

        def send_signal(self, number: int) -> None:
            """Send a signal to it."""
            self._running.send(orders.Signal(self._pid, number))

        def kill(self) -> None:
            """End it at once."""
            self.send_signal(signal.SIGKILL)

        def write(self, data: bytes) -> None:
            """Write to its standard input; one that does not read is ended."""
            os.set_blocking(self._keep_open, False)
            try:
                sent = os.write(self._keep_open, data)
            except OSError:
                sent = 0
            if sent < len(data):
                self.kill()

        def _read(self, stream: int) -> bool:
            """Read what there is; returns whether there was something."""
            try:
                data = os.read(self._outputs[stream], 2**16)
            except BlockingIOError:
                return False
            if data:
                self._on_output(stream, data)
            else:
                self._close(stream)
            return bool(data)

        def _close(self, stream: int) -> None:
            if (output := self._outputs.pop(stream, None)) is not None:
                asyncio.get_running_loop().remove_reader(output)
                os.close(output)

    def _answer(waiting: deque[asyncio.Future[_Result]], result: _Result) -> None:
        """Answer the oldest request. Raises IndexError if there is none."""
        future = waiting.popleft()
        if not future.done():
            future.set_result(result)

    def _checked_socket(descriptor: int) -> socket.socket:
        """Return a socket that came from the sandbox. Raises OSError or ValueError for others."""
        sock = socket.socket(fileno=descriptor)
        if sock.family != socket.AF_INET or sock.type != socket.SOCK_STREAM:
            sock.close()
            raise ValueError("expected a socket for TCP")
        sock.setblocking(False)
        return sock

    async def _last(stream: asyncio.StreamReader | None) -> bytes:
        """Return the last bytes of a stream at its end."""
        kept = b""
        while stream is not None and (data := await stream.read(_KEPT)):
            kept = (kept + data)[-_KEPT:]
        return kept

    def _resident(pid: int) -> int:
        """Return the bytes of memory of a process and its descendants; 0 if they have ended."""
        size, waiting = 0, [pid]
        while waiting:
            process = Path(f"/proc/{waiting.pop()}")
            with contextlib.suppress(OSError, ValueError, IndexError):
                size += int((process / "statm").read_text().split()[1])
                for task in (process / "task").iterdir():
                    with contextlib.suppress(OSError, ValueError):
                        waiting += map(int, (task / "children").read_text().split())
        return size * os.sysconf("SC_PAGE_SIZE")
