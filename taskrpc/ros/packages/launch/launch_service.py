"""Executes launch descriptions: the event loop, the signals, and the end of all programs."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
import traceback
from collections.abc import Iterable, Iterator
from typing import Any

from taskrpc.spi import signals

from .event import Event
from .event_handlers import OnIncludeLaunchDescription, OnShutdown
from .events.general import ExecutionComplete, IncludeLaunchDescription, Shutdown
from .launch_context import LaunchContext
from .launch_description import LaunchDescription
from .launch_description_entity import (
    LaunchDescriptionEntity,
    entities_of,
    visit_all_entities_and_collect_futures,
)
from .logging import get_logger
from .utilities.problems import explained

_REASON = "ctrl-c (SIGINT)"


class LaunchService:
    """Executes launch descriptions until all their work is done, or until a shutdown.

    Args:
        argv: arguments for the launch files, as the context's `argv`.
        noninteractive: the launch is not started from a terminal.
        debug: print tracebacks of errors.
    """

    def __init__(
        self,
        *,
        argv: Iterable[str] | None = None,
        noninteractive: bool = False,
        debug: bool = False,
    ) -> None:
        self._debug = debug
        self._logger = get_logger("launch")
        self._context = LaunchContext(argv=argv, noninteractive=noninteractive)
        self._context.register_event_handler(OnIncludeLaunchDescription())
        self._context.register_event_handler(OnShutdown(on_shutdown=self._on_shutdown))
        self._pending: list[tuple[LaunchDescriptionEntity, asyncio.Future[None]]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._new_event = asyncio.Event()
        self._return_code = 0
        self._is_interrupted = False

    @property
    def context(self) -> LaunchContext:
        """The state of the launch."""
        return self._context

    @property
    def event_loop(self) -> asyncio.AbstractEventLoop | None:
        """The event loop while the service runs."""
        return self._loop

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C ended the launch."""
        return self._is_interrupted

    def emit_event(self, event: Event) -> None:
        """Emit an event, from any thread; before `run`, it is processed then."""
        if self._loop is None:
            self._context.emit_event_sync(event)
        else:
            self._loop.call_soon_threadsafe(self._context.emit_event_sync, event)

    def include_launch_description(self, launch_description: LaunchDescription) -> None:
        """Execute a launch description, from any thread."""
        self.emit_event(IncludeLaunchDescription(launch_description))

    def shutdown(self, force_sync: bool = False) -> None:
        """End the launch, from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._shutdown, "LaunchService.shutdown() called")

    def run(self, *, shutdown_when_idle: bool = True) -> int:
        """As `run_async`, on an event loop of its own."""
        return asyncio.run(self.run_async(shutdown_when_idle=shutdown_when_idle))

    async def run_async(self, *, shutdown_when_idle: bool = True) -> int:
        """Execute all launch descriptions; returns 0, or 1 after an error in one of them.

        Ctrl-C and SIGTERM shut the launch down. When this returns, no program runs any more.
        """
        self._loop = self._context.asyncio_loop = asyncio.get_running_loop()
        self._new_event = asyncio.Event()
        self._context.on_event = self._new_event.set
        try:
            with signals.stop_signals(self._stopped), self._other_signals():
                await self._process_events(shutdown_when_idle)
                await asyncio.gather(*(end() for end in self._context.at_end))
        finally:
            self._loop = self._context.asyncio_loop = None
        return self._return_code

    @contextlib.contextmanager
    def _other_signals(self) -> Iterator[None]:
        """Shut down when the terminal is closed, too: the programs do not get this signal."""
        names = [each for each in ("SIGHUP", "SIGQUIT") if hasattr(signal, each)]
        if not names or threading.current_thread() is not threading.main_thread():
            yield
            return
        numbers = [getattr(signal, name) for name in names]
        before = {number: signal.getsignal(number) for number in numbers}
        for number in numbers:
            if before[number] is not signal.SIG_IGN:  # nohup
                signal.signal(number, lambda number, _: self._stopped(number))
        try:
            yield
        finally:
            for number in numbers:
                signal.signal(number, before[number])

    def _stopped(self, number: int) -> None:
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._interrupt, number)

    def _interrupt(self, number: int) -> None:
        if number != signal.SIGINT:
            name = signal.Signals(number).name
            self._logger.warning(f"received {name}, shutting down")
            self._shutdown(name)
        elif self._is_interrupted:
            self._logger.warning("user interrupted with ctrl-c (SIGINT) again, ignoring...")
        else:
            self._is_interrupted = True
            self._logger.warning("user interrupted with ctrl-c (SIGINT)")
            self._shutdown(_REASON, due_to_sigint=True)

    def _shutdown(self, reason: str, *, due_to_sigint: bool = False) -> None:
        if not self._context.is_shutdown:
            self._context.set_is_shutdown()
            self._context.emit_event_sync(Shutdown(reason=reason, due_to_sigint=due_to_sigint))

    def _on_shutdown(self, event: Event, context: LaunchContext) -> None:
        context.set_is_shutdown()

    async def _process_events(self, shutdown_when_idle: bool) -> None:
        events = self._context.events
        while True:
            self._new_event.clear()
            while events:
                self._process(events.popleft())
            self._drop_finished()
            if events:
                continue
            if not self._pending:
                if self._context.is_shutdown:
                    return
                if shutdown_when_idle:
                    self._shutdown("idle")
                    continue
            await self._wait()

    async def _wait(self) -> None:
        """Wait for an event, or for the end of an entity's work."""
        waiting = asyncio.ensure_future(self._new_event.wait())
        futures: set[asyncio.Future[Any]] = {waiting, *(future for _, future in self._pending)}
        try:
            await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()

    def _drop_finished(self) -> None:
        for entity, future in [each for each in self._pending if each[1].done()]:
            self._pending.remove((entity, future))
            if not future.cancelled() and (error := future.exception()) is not None:
                self._failed(error)
            self._context.emit_event_sync(ExecutionComplete(action=entity))

    def _process(self, event: Event) -> None:
        for handler in self._context.handlers:
            self._context.push_locals()
            try:
                if handler.matches(event):
                    for entity in entities_of(handler.handle(event, self._context)):
                        self._pending += visit_all_entities_and_collect_futures(
                            entity, self._context
                        )
            except Exception as error:  # of the launch file, or of its functions
                self._failed(error)
            finally:
                self._context.pop_locals()

    def _failed(self, error: BaseException) -> None:
        """Report an error in a launch file, and shut down."""
        self._return_code = 1
        if self._debug:
            self._logger.debug("".join(traceback.format_exception(error)).rstrip())
        self._logger.error(
            f"Caught exception in launch (see debug for traceback): {explained(error)}"
        )
        self._shutdown(f"Caught exception in launch: {error}")
