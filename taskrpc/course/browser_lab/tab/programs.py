"""The student's programs: each runs in a thread of the tab as a process would run."""

from __future__ import annotations

import asyncio
import builtins
import io
import re
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from contextvars import Context
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Self, cast

from taskrpc.course.browser_lab.tab.threads import Scheduler
from taskrpc.simulation.interpreter import tracebacks
from taskrpc.simulation.interpreter.threads import Handle
from taskrpc.spi import close_program, current_program

FOLDER: Final = Path("/lab")
"""The folder of the student's files, in the worker's memory."""

MAX_OUTPUT: Final = 200_000
"""Characters that one program may write; the page must stay usable."""

INTERRUPTED: Final = 130
"""The exit code of a program that was stopped, as after Ctrl-C."""

_GRACE = 1.0  # seconds that a stopped program gets to end
_TURNS, _TURN = 50, 0.01  # looks, and seconds between them, until its threads have ended
_SUSPENDED = "_wrap_awaitable"  # the coroutine with which Pyodide waits for a promise

Emit = Callable[..., None]
"""Sends an event to the page: its name, and its values by keyword."""


class Programs:
    """All programs of the tab, and what they share."""

    def __init__(self, scheduler: Scheduler, emit: Emit) -> None:
        self.scheduler = scheduler
        self.emit = emit
        self.by_name: dict[str, Program] = {}
        self._numbers = 0

    def start(self, file: str, *arguments: str) -> Program:
        """Start a file of the student's folder as a program."""
        self._numbers += 1
        program = Program(self, f"{file}#{self._numbers}", file, arguments)
        self.by_name[program.name] = program
        program.begin()
        return program

    def write(self, text: str, *, is_error: bool) -> None:
        """Write text to the output of the running program, or to the browser's console."""
        program = self.by_name.get(current_program.get())
        if program is None:
            self.emit("console", text=text)
        else:
            program.write(text, is_error=is_error)

    def install(self) -> None:
        """Let output, unhandled exceptions and `asyncio.run` be those of the running program."""
        sys.stdout, sys.stderr = _Output(self, is_error=False), _Output(self, is_error=True)
        threading.excepthook = lambda failed: self._thread_failed(failed.exc_value)
        builtins.input = self._no_input
        programs = self

        class Runner(_Runner):
            def __init__(self, *, debug: bool | None = None, loop_factory: Any = None) -> None:
                super().__init__(programs)

        asyncio.Runner = Runner  # type: ignore[misc, assignment]
        asyncio.run = lambda main, **_: Runner().run(main)

    def _thread_failed(self, error: BaseException | None) -> None:
        if error is not None and not isinstance(error, SystemExit):
            self.write(f"In a thread:\n{explained(error)}", is_error=True)

    def _no_input(self, prompt: object = "") -> str:
        raise EOFError("input() does not work in the browser; write the value into the program")


class Program:
    """One program; it ends as a process does: its nodes are closed, its threads end."""

    def __init__(
        self, programs: Programs, name: str, file: str, arguments: Sequence[str] = ()
    ) -> None:
        self.name = name
        """Unique among all programs that were started."""
        self.file = file
        self.arguments = arguments
        self.output: list[str] = []
        """The lines that it has written, to both streams."""
        self.exit_code: int | None = None
        self.tasks: list[asyncio.Task[Any]] = []
        """What it runs with `asyncio.run`, in a browser that cannot wait for it."""
        self._programs = programs
        self._rest = ""
        self._written = 0
        self._is_ending = False
        """Whether its threads are being ended; what they say about that is not its output."""
        self._ended = asyncio.Event()
        self._changed = asyncio.Event()

    def begin(self) -> None:
        """Run it; the page is told when it ends."""
        context = Context()
        context.run(current_program.set, self.name)
        self._programs.emit("started", program=self.name, file=self.file)
        context.run(self._programs.scheduler.start, self._main, Handle())

    def write(self, text: str, *, is_error: bool) -> None:
        """Add text to its output."""
        if self._is_ending:
            return
        *lines, self._rest = (self._rest + text).split("\n")
        self.output += lines
        self._changed.set()
        room = MAX_OUTPUT - self._written
        self._written += len(text)
        if room > 0:
            emit = self._programs.emit
            emit("output", program=self.name, text=text[:room], is_error=is_error)
            if len(text) >= room:
                emit("output", program=self.name, text="\n(no more is shown)\n", is_error=True)

    async def wait_for_line(self, pattern: str, timeout: float) -> re.Match[str] | None:
        """Wait for a line in which the regular expression is found; None after the timeout."""
        seen = 0
        try:
            async with asyncio.timeout(timeout):
                while True:
                    for line in self.output[seen:]:
                        seen += 1
                        if (found := re.search(pattern, line)) is not None:
                            return found
                    if self.exit_code is not None:
                        return None
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return None

    async def finished(self, timeout: float) -> int | None:
        """Wait for the end of the program; its exit code, or None after the timeout."""
        try:
            async with asyncio.timeout(timeout):
                await self._ended.wait()
        except TimeoutError:
            return None
        return self.exit_code

    async def interrupt(self) -> None:
        """Press Ctrl-C."""
        self._interrupt(KeyboardInterrupt())

    async def stop(self) -> None:
        """End the program as Ctrl-C does, or at once if it does not react."""
        if self.exit_code is not None:
            return
        await self.interrupt()
        if await self.finished(_GRACE) is None:
            self._interrupt(SystemExit())
            await self.finished(_GRACE)

    def _interrupt(self, error: BaseException) -> None:
        for task in self.tasks:
            task.cancel()
        scheduler = self._programs.scheduler
        idents = scheduler.idents(self.name)
        for ident in idents if isinstance(error, SystemExit) else idents[:1]:
            scheduler.interrupt(ident, error)

    def _main(self) -> None:
        """What the program's first thread does: all that a process does up to its end."""
        code = self._ran(self._execute)
        self._ran(self._join_threads)
        self._ran(_shut_rclpy_down)
        self._programs.scheduler.loop.create_task(self._end(code))

    def _ran(self, action: Callable[[], object]) -> int:
        """Call a function, report its exception, and return the exit code that it causes."""
        try:
            action()
        except SystemExit as error:
            return self._code_of(error)
        except KeyboardInterrupt:
            return INTERRUPTED
        except BaseException as error:
            self._programs.write(explained(error), is_error=True)
            return 1
        return 0

    def _code_of(self, error: SystemExit) -> int:
        if error.code is None or isinstance(error.code, int):
            return error.code or 0
        self._programs.write(f"{error.code}\n", is_error=True)
        return 1

    def _execute(self) -> None:
        path = FOLDER / self.file
        sys.argv = [str(path), *self.arguments]
        main = ModuleType("__main__")
        main.__file__ = str(path)
        sys.modules["__main__"] = main  # the last program's; only few libraries look at it
        exec(compile(path.read_bytes(), str(path), "exec"), vars(main))

    def _join_threads(self) -> None:
        idents = self._programs.scheduler.idents(self.name)
        for thread in threading.enumerate():
            if thread.ident in idents and not thread.daemon:
                thread.join()

    async def _end(self, code: int) -> None:
        for task in self.tasks:  # the program's end waits for them where its threads cannot
            await asyncio.wait([task])
            if not task.cancelled():
                code = code or self._ran(task.result)
        if self._rest:
            self.write("\n", is_error=False)
        self._is_ending = True
        self._interrupt(SystemExit())
        for _ in range(_TURNS):  # the threads end at their next turns
            if not self._programs.scheduler.idents(self.name):
                break
            await asyncio.sleep(_TURN)
        await close_program(self.name)
        self._cancel_tasks()
        self.exit_code = code
        self._changed.set()
        self._ended.set()
        self._programs.emit("ended", program=self.name, file=self.file, code=code)

    def _cancel_tasks(self) -> None:
        for task in asyncio.all_tasks():
            if getattr(task.get_coro(), "__name__", "") == _SUSPENDED:
                continue  # a thread waits here; SystemExit ends it
            context = cast("Any", task).get_context()  # new in Python 3.12
            if context.get(current_program) == self.name and task is not asyncio.current_task():
                task.cancel()


class _Output(io.TextIOBase):
    """`sys.stdout` or `sys.stderr` of all programs."""

    encoding = "utf-8"

    def __init__(self, programs: Programs, *, is_error: bool) -> None:
        self._programs = programs
        self._is_error = is_error

    def write(self, text: str) -> int:
        self._programs.write(text, is_error=self._is_error)
        return len(text)

    def writable(self) -> bool:
        return True


class _Runner:
    """Takes the place of `asyncio.Runner`: all programs share the browser's event loop."""

    def __init__(self, programs: Programs) -> None:
        self._programs = programs

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        return None

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """The browser's event loop."""
        return self._programs.scheduler.loop

    def run(self, main: Coroutine[Any, Any, Any], *, context: Context | None = None) -> Any:
        """Run a coroutine to its end; where the browser cannot wait for it, begin it."""
        scheduler = self._programs.scheduler
        if not scheduler.can_wait:
            task = scheduler.loop.create_task(main, context=context)
            self._programs.by_name[current_program.get()].tasks.append(task)
            return None
        future = asyncio.run_coroutine_threadsafe(main, scheduler.loop)
        try:
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise


def explained(error: BaseException) -> str:
    """An exception with the lines of the student's files only."""
    return tracebacks.explained(error, FOLDER).replace(f'"{FOLDER}/', '"')


def _shut_rclpy_down() -> None:
    if (utilities := sys.modules.get("taskrpc.ros.packages.rclpy.utilities")) is not None:
        utilities.try_shutdown()
