"""Programs that a notebook starts: each is a process of its own, as in a terminal."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_END = 3.0
"""Seconds that a program has to end after Ctrl-C."""

_ENDS_WITH_THE_NOTEBOOK = """
import os, signal, sys, threading

def wait():
    while os.read(0, 100):
        pass
    os.kill(os.getpid(), signal.SIGINT)
    threading.Event().wait(3.0)
    os._exit(1)

threading.Thread(target=wait, daemon=True).start()
from taskrpc.__main__ import main
sys.argv[:] = ["taskrpc", *sys.argv[1:]]
sys.exit(main())
"""
"""Runs the command; its standard input ends with the kernel, however that ends."""

# The kernel's interrupt also goes to the kernel's group, so that programs get one of their own.
if sys.platform == "win32":
    # A thread that waits for the input can block the start of other programs there.
    _COMMAND = ["-m", "taskrpc"]
    _INTERRUPT = signal.CTRL_BREAK_EVENT
    _OWN_GROUP: dict[str, Any] = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
else:
    _COMMAND = ["-c", _ENDS_WITH_THE_NOTEBOOK]
    _INTERRUPT = signal.SIGINT
    _OWN_GROUP: dict[str, Any] = {"start_new_session": True}


class Program:
    """A command of taskrpc in a process, whose output appears in the notebook.

    Args:
        arguments: those of the command, such as `run server.py`.
        folder: its working directory.
    """

    def __init__(self, arguments: Sequence[str], folder: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-u", *_COMMAND, *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONIOENCODING": "utf-8", "NO_COLOR": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            **_OWN_GROUP,
        )
        atexit.register(self.stop)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def show_output(self) -> None:
        """Print its lines until it ends; an interrupt of the cell ends it."""
        try:
            self._print_lines()
            self._process.wait()
        finally:
            self.stop()

    def show_output_later(self) -> None:
        """Print its lines from now on, without waiting."""
        threading.Thread(target=self._print_lines, name="program", daemon=True).start()

    def stop(self) -> None:
        """End it as Ctrl-C does, or at once if it does not react."""
        atexit.unregister(self.stop)
        if self.is_running:
            with contextlib.suppress(subprocess.TimeoutExpired, OSError):
                self._process.send_signal(_INTERRUPT)
                self._process.wait(_END)
            self._process.kill()
        self._process.wait()
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def _print_lines(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout:
            for line in self._process.stdout:
                print(line, end="", flush=True)


class Programs:
    """The programs that run in the background, by their files."""

    def __init__(self) -> None:
        self._running: dict[str, Program] = {}

    def start(self, file: str, arguments: Sequence[str], folder: Path) -> None:
        """Start a file; the program that was started from it before ends."""
        self.stop(file)
        program = self._running[file] = Program(["run", file, *arguments], folder)
        program.show_output_later()

    def stop(self, file: str) -> None:
        """End the program of a file, if it runs."""
        if (program := self._running.pop(file, None)) is not None:
            program.stop()
