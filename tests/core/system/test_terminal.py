"""Output takes any character, and keys are letters only."""

import asyncio
import importlib.util
import os
import subprocess
import sys

from taskrpc.core.system import terminal


def test_output_takes_any_character(capfd):
    module = "taskrpc.core.system.terminal"
    program = f"from {module} import prepare_output; prepare_output(); print('é → \\U0001f916')"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, check=True
    )
    assert done.stdout.strip() == b"\\xe9 \\u2192 \\U0001f916"


class _Console:
    """The Windows console: each key is the characters that it delivers.

    `kbhit` sees keys; the second character of a key is seen only together with the next key.
    """

    def __init__(self, *keys):
        self._keys = list(keys)
        self._second = ""

    def kbhit(self):
        return bool(self._keys)

    def getwch(self):
        if self._second:
            typed, self._second = self._second, ""
        else:
            typed, *rest = self._keys.pop(0)
            self._second = "".join(rest)
        return typed


async def test_special_keys_of_a_windows_console_are_no_letters(monkeypatch):
    page_down, alt_q = "\xe0Q", "\0\x10"
    console = _Console("a", page_down, "b", alt_q, page_down, "q")
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "stdin", _Terminal())
    source = importlib.util.spec_from_file_location("terminal_of_windows", terminal.__file__)
    windows = importlib.util.module_from_spec(source)
    source.loader.exec_module(windows)
    pressed = []
    with windows.keys_pressed(pressed.append):
        await asyncio.sleep(1.0)
    assert pressed == ["a", "b", "q"]


class _Terminal:
    """A standard input that is a terminal."""

    def fileno(self):
        return 0

    def isatty(self):
        return True
