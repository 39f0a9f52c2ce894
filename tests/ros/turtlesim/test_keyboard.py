"""Single keys from a terminal."""

import os
import sys

import pytest

if sys.platform == "win32":
    pytest.skip("these terminals are POSIX's", allow_module_level=True)

import pty
import termios

from taskrpc.ros.turtlesim import keyboard

pytestmark = pytest.mark.real_time


class Input:
    def __init__(self, source):
        self._source = source

    def fileno(self):
        return self._source


def test_keys_come_without_enter_and_the_terminal_is_restored(monkeypatch):
    ours, theirs = pty.openpty()
    monkeypatch.setattr(sys, "stdin", Input(theirs))
    before = termios.tcgetattr(theirs)
    keys = keyboard.keys()
    os.write(ours, b"\x1b[A")
    # The first read sets the terminal's mode; without ECHO nothing comes back from then on.
    assert next(keys) == "up"
    during = termios.tcgetattr(theirs)
    assert not during[3] & (termios.ECHO | termios.ICANON)
    os.write(ours, b"q")
    assert next(keys) == "q"
    keys.close()
    assert termios.tcgetattr(theirs) == before
    os.close(ours)
    os.close(theirs)


def test_a_pipe_is_read_to_its_end(monkeypatch):
    source, target = os.pipe()
    monkeypatch.setattr(sys, "stdin", Input(source))
    os.write(target, b"g\x1b[Bq")
    os.close(target)
    assert list(keyboard.keys()) == ["g", "down", "q"]
    os.close(source)
