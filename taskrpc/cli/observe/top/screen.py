"""Draws `taskrpc top` on a terminal, and restores the terminal at the end."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Iterator

from rich.console import Console
from rich.live import Live
from rich.text import Text

from taskrpc.cli.observe.top.picture import ASCII, UNICODE, Line, Role, picture
from taskrpc.observe.top.model import View
from taskrpc.spi import terminal

_STYLES = {
    Role.PLAIN: "",
    Role.TITLE: "bold",
    Role.DIM: "dim",
    Role.GOOD: "green",
    Role.WARNING: "yellow",
    Role.ERROR: "bold red",
}
_SUSPEND = "suspend"
_TERMINATED = 128 + 15  # the exit status after SIGTERM, as a shell shows it


def open_console() -> Console | None:
    """Return the terminal on stdout; None if there is none that can show a picture."""
    if not sys.stdout.isatty():
        return None
    console = Console()
    return console if console.is_terminal and not console.is_dumb_terminal else None


async def show(console: Console, read: Callable[[], Awaitable[View]], period: float) -> None:
    """Draw a new picture every `period` seconds until the user presses q.

    The terminal is restored when this ends, also by Ctrl-C, SIGTERM or an error, and while Ctrl-Z
    has stopped the process.
    """
    while await _drawn(console, read, period) == _SUSPEND:
        if sys.platform != "win32":  # no Ctrl-Z there
            os.kill(os.getpid(), signal.SIGSTOP)


async def _drawn(console: Console, read: Callable[[], Awaitable[View]], period: float) -> str:
    """Draw until the user presses q or Ctrl-Z; returns which."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[str] = loop.create_future()
    screen = _Screen(console)

    def end(reason: str) -> None:
        if not ended.done():
            ended.set_result(reason)

    signals: dict[str, Callable[[], object]] = {
        "SIGWINCH": screen.draw,
        "SIGTSTP": lambda: end(_SUSPEND),
    }
    with (
        _terminated(),
        _quiet(),
        screen.live,
        terminal.keys_pressed(lambda key: end("q") if key in "qQ" else None),
        _handled(signals),
    ):
        due = loop.time()
        while not ended.done():
            screen.draw(await read())
            due = max(due + period, loop.time())
            await asyncio.wait((ended,), timeout=due - loop.time())
    return ended.result()


class _Screen:
    """The whole terminal; `live` occupies it while it is entered."""

    def __init__(self, console: Console) -> None:
        self.live = Live(
            console=console,
            screen=True,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._console = console
        self._view: View | None = None

    def draw(self, view: View | None = None) -> None:
        """Draw a view; without one, the last view again for another size."""
        self._view = view or self._view
        if self._view is not None:
            signs = ASCII if self._console.options.ascii_only else UNICODE
            columns, rows = self._console.size
            lines = picture(self._view, columns, rows, signs)
            self.live.update(styled(lines), refresh=True)


def styled(lines: list[Line]) -> Text:
    """Return lines with colours for rich."""
    text = Text("\n", no_wrap=True, overflow="crop", end="").join(
        Text.assemble(*((span.text, _STYLES[span.role]) for span in line)) for line in lines
    )
    text.no_wrap, text.overflow = True, "crop"
    return text


@contextlib.contextmanager
def _handled(signals: dict[str, Callable[[], object]]) -> Iterator[None]:
    """Call these functions at these signals, where the system has them."""
    loop = asyncio.get_running_loop()
    numbers = {getattr(signal, name, None): action for name, action in signals.items()}
    for number, action in numbers.items():
        if number is not None:
            loop.add_signal_handler(number, action)
    try:
        yield
    finally:
        for number in filter(None, numbers):
            loop.remove_signal_handler(number)


@contextlib.contextmanager
def _terminated() -> Iterator[None]:
    """End by an exception at SIGTERM: the default action would leave the terminal as it is."""
    if os.name != "posix" or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(*_: object) -> None:
        raise SystemExit(_TERMINATED)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep log lines off the picture: rows say which programs do not answer."""
    log = logging.getLogger("taskrpc")
    handler, propagate = logging.NullHandler(), log.propagate
    log.addHandler(handler)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = propagate
