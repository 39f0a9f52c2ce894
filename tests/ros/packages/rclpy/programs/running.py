"""Runs ROS 2 programs as processes, and reads their output with time stamps replaced."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE = 120  # seconds; reached only by a failing test
INTERRUPTED = 130 if sys.platform == "win32" else -signal.SIGINT
"""The exit status of a program that did not catch its KeyboardInterrupt."""
_STAMP = re.compile(r"\[\d{9,}\.\d{9}\]")


class Program:
    """A running program: its output so far, and its exit status."""

    def __init__(self, process):
        self._process = process
        self._lines = {"out": [], "err": []}
        self._line_read = threading.Condition()
        self._readers = [
            threading.Thread(target=self._read, args=(name, stream), daemon=True)
            for name, stream in (("out", process.stdout), ("err", process.stderr))
        ]
        for reader in self._readers:
            reader.start()

    @property
    def out(self):
        """What it wrote to stdout."""
        return "".join(self._lines["out"])

    @property
    def err(self):
        """What it wrote to stderr, with [T] instead of each time stamp."""
        return "".join(self._lines["err"])

    def wait_for(self, text, times=1):
        """Wait until it has written this text `times` times, to stdout and stderr together."""
        with self._line_read:
            seen = lambda: (self.out + self.err).count(text) >= times  # noqa: E731
            if not self._line_read.wait_for(seen, timeout=PATIENCE):
                raise AssertionError(f"it did not print {text!r}: {self.out}{self.err}")

    def interrupt(self):
        """Press Ctrl-C, and return its exit status."""
        if sys.platform != "win32":
            self._process.send_signal(signal.SIGINT)
        elif hasattr(sys, "ctrl_c_reaches_one_process"):  # the Python of `.ci/windows`
            self._process.send_signal(signal.CTRL_C_EVENT)
        else:
            pytest.skip("Windows sends Ctrl-C to whole consoles only")
        return self.end()

    def end(self):
        """Wait for its end, and return its exit status."""
        code = self._process.wait(timeout=PATIENCE)
        for reader in self._readers:
            reader.join(timeout=PATIENCE)
        return code

    def kill(self):
        """Kill it."""
        self._process.kill()
        self.end()

    def _read(self, name, stream):
        with stream:
            for line in stream:
                with self._line_read:
                    self._lines[name].append(_STAMP.sub("[T]", line))
                    self._line_read.notify_all()


def domain_in(folder):
    """The environment variables of programs that see only each other and use this checkout."""
    runtime = folder / "run"
    runtime.mkdir(mode=0o700)
    return {
        "ROS_DOMAIN_ID": str(100 + os.getpid() % 100),
        "XDG_RUNTIME_DIR": str(runtime),
        "XDG_STATE_HOME": str(folder / "state"),
        "PYTHONPATH": str(ROOT),
    }


@contextlib.contextmanager
def programs_in(folder, environment=None):
    """Starts programs with `taskrpc run` in this folder, and ends them."""
    started = []

    def start(source, *arguments, name="program.py"):
        path = folder / name
        path.write_text(source)
        process = subprocess.Popen(
            [sys.executable, "-u", "-m", "taskrpc", "run", name, *map(str, arguments)],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(Program(process))
        return started[-1]

    try:
        yield start
    finally:
        for program in started:
            program.kill()
