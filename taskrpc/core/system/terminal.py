"""The terminal: its keys, and output that it may be unable to show."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator

_KEY_POLL = 0.1  # seconds between two looks at the keys of a Windows console
_PREFIXES = ("\0", "\xe0")  # of a Windows console's keys that have no character


def prepare_output() -> None:
    """Let stdout and stderr accept any character, even if the terminal cannot show it."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


@contextlib.contextmanager
def keys_pressed(pressed: Callable[[str], object]) -> Iterator[None]:
    """Call `pressed` on the running event loop for each key, while the block runs.

    Keys are not shown. Without a terminal on stdin, and in the background, the block just runs.
    Ctrl-C stays a signal. The terminal is restored at the end.
    """
    try:
        descriptor = sys.stdin.fileno() if sys.stdin.isatty() else -1
    except (AttributeError, OSError, ValueError):  # stdin is closed
        descriptor = -1
    if descriptor < 0:
        yield
        return
    with _keys_read(descriptor, pressed):
        yield


if sys.platform == "win32":

    @contextlib.contextmanager
    def _keys_read(descriptor: int, pressed: Callable[[str], object]) -> Iterator[None]:
        import asyncio
        import msvcrt

        async def read() -> None:
            is_code = False
            while True:  # the console has no event that asyncio can wait for
                while msvcrt.kbhit():
                    key = msvcrt.getwch()
                    # A key without a character, such as Page Down, arrives as a prefix and a code,
                    # which may be the letter of another key. kbhit() may show the code only when
                    # the next key is pressed, so it is not read at once: that could block.
                    if is_code or key in _PREFIXES:
                        is_code = not is_code
                    else:
                        pressed(key)
                await asyncio.sleep(_KEY_POLL)

        reading = asyncio.get_running_loop().create_task(read())
        try:
            yield
        finally:
            reading.cancel()

else:

    @contextlib.contextmanager
    def _keys_read(descriptor: int, pressed: Callable[[str], object]) -> Iterator[None]:
        import asyncio
        import termios
        import tty

        if os.tcgetpgrp(descriptor) != os.getpgrp():  # changing the terminal would stop us
            yield
            return
        loop = asyncio.get_running_loop()

        def read() -> None:
            typed = os.read(descriptor, 64)
            if not typed:  # the terminal is gone
                loop.remove_reader(descriptor)
            for key in typed.decode(errors="ignore"):
                pressed(key)

        before = termios.tcgetattr(descriptor)
        try:
            tty.setcbreak(descriptor, termios.TCSANOW)
            loop.add_reader(descriptor, read)
            yield
        finally:
            loop.remove_reader(descriptor)
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
