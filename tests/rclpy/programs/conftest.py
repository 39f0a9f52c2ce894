"""ROS 2 programs as processes of their own, and what they print with its time stamps replaced."""

import os
import re
import signal
import subprocess
import sys
import threading

import pytest

PATIENCE = 30
_STAMP = re.compile(r"\[\d{9,}\.\d{9}\]")


class Program:
    """A program that runs: what it has printed, and how it ends."""

    def __init__(self, process):
        self._process = process
        self._lines = {"out": [], "err": []}
        self._news = threading.Condition()
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
        """What it wrote to stderr, each time stamp as [T]."""
        return "".join(self._lines["err"])

    def wait_for(self, text, times=1):
        """Return once it has written this text so often, to either stream."""
        with self._news:
            seen = lambda: (self.out + self.err).count(text) >= times  # noqa: E731
            if not self._news.wait_for(seen, timeout=PATIENCE):
                raise AssertionError(f"never said {text!r}: {self.out}{self.err}")

    def interrupt(self):
        """Press Ctrl-C, and return its exit status."""
        self._process.send_signal(signal.SIGINT)
        return self.end()

    def end(self):
        """Wait for its end, and return its exit status."""
        code = self._process.wait(timeout=PATIENCE)
        for reader in self._readers:
            reader.join(timeout=PATIENCE)
        return code

    def kill(self):
        """End it, whatever it does."""
        self._process.kill()
        self.end()

    def _read(self, name, stream):
        with stream:
            for line in stream:
                with self._news:
                    self._lines[name].append(_STAMP.sub("[T]", line))
                    self._news.notify_all()


@pytest.fixture
def ros(tmp_path, monkeypatch):
    """Starts programs with `taskrpc run`, in an empty folder and a domain of their own."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    (tmp_path / "run").mkdir(mode=0o700)
    started = []

    def start(source, *arguments, name="program.py"):
        path = tmp_path / name
        path.write_text(source)
        process = subprocess.Popen(
            [sys.executable, "-u", "-m", "taskrpc", "run", name, *map(str, arguments)],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(Program(process))
        return started[-1]

    yield start
    for program in started:
        program.kill()


@pytest.fixture
def run(ros):
    """Runs a program to its end: its exit status, stdout and stderr."""

    def run(source, *arguments, name="program.py"):
        program = ros(source, *arguments, name=name)
        code = program.end()
        return code, program.out, program.err

    return run
