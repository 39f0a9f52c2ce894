"""Reads single keys from the terminal of the process."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator

from taskrpc.ros.turtlesim.keys import KeyDecoder, windows_arrow

if sys.platform == "win32":
    import msvcrt

    _SPECIAL = ("\x00", "\xe0")

    def keys() -> Generator[str, None, None]:
        """The keys that the user presses; Ctrl-C raises KeyboardInterrupt."""
        while True:
            character = msvcrt.getwch()
            if character == "\x03":  # getwch reads Ctrl-C as a character
                raise KeyboardInterrupt
            is_special = character in _SPECIAL
            if key := windows_arrow(msvcrt.getwch()) if is_special else character.lower():
                yield key

else:
    import termios
    from contextlib import contextmanager

    def keys() -> Generator[str, None, None]:
        """The keys that the user presses, until the input ends."""
        source = sys.stdin.fileno()
        decoder = KeyDecoder()
        with _single_keys(source):
            while byte := os.read(source, 1):
                if key := decoder.feed(byte):
                    yield key

    @contextmanager
    def _single_keys(source: int) -> Generator[None, None, None]:
        """Let a terminal send each key at once and without showing it; Ctrl-C still works."""
        if not os.isatty(source):
            yield
            return
        before = termios.tcgetattr(source)
        single = termios.tcgetattr(source)
        single[3] &= ~(termios.ICANON | termios.ECHO)
        termios.tcsetattr(source, termios.TCSANOW, single)
        try:
            yield
        finally:
            termios.tcsetattr(source, termios.TCSANOW, before)
