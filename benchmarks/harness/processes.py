"""The processes of a contender, seen from the harness: start, ask, pin to cores, end."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from benchmarks.contenders import CONTENDERS
from benchmarks.harness.contender import Contender
from benchmarks.harness.load import Sample

ROOT = Path(__file__).resolve().parents[2]
_FIRST_DOMAIN = 100
_PATIENCE = 60.0
"""Seconds after which a process that does not answer, or does not end, is killed."""
CAN_PIN = sys.platform == "linux"


class ChildFailed(RuntimeError):
    """A process of a contender ended; what it said is on the standard error."""


class Child:
    """One process of `benchmarks.harness.child`."""

    def __init__(self, role: str, contender: Contender, env: dict[str, str]) -> None:
        self._what = f"{contender.name}, {role}"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.harness.child", role, contender.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=env,
            start_new_session=True,  # Ctrl-C is the harness's alone, which then ends everybody
        )
        self.pid = self._process.pid

    def ask(self, **command: Any) -> Any:
        """Send a command and wait for its answer. Raises ChildFailed when the process ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # BrokenPipeError; on Windows with EINVAL
            print(json.dumps(command), file=self._process.stdin, flush=True)
        return self.read()

    def read(self) -> Any:
        """Wait for the next answer. Raises ChildFailed when the process ended."""
        assert self._process.stdout is not None
        watchdog = threading.Timer(_PATIENCE, self._process.kill)
        watchdog.start()
        try:
            line = self._process.stdout.readline()
        finally:
            watchdog.cancel()
        if not line:
            raise ChildFailed(f"{self._what}: ended with code {self._process.wait()}")
        return json.loads(line)

    def close(self) -> None:
        """End the process."""
        with self._process as process:
            assert process.stdin is not None
            with contextlib.suppress(OSError):
                process.stdin.close()
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()


class Pair:
    """Server and client of one contender, connected; `measure` loads them."""

    def __init__(self, contender: Contender) -> None:
        self.contender = contender
        self._folder = tempfile.TemporaryDirectory(prefix="bench-")
        self.env = environment(contender, self._folder.name)
        self.helpers: list[int] = []
        self.place = ""
        self.server: Child | None = None
        self.client = Child("client", contender, self.env)

    def start(self) -> Self:
        """Start the server and connect the client. Raises ChildFailed."""
        self.client.read()
        self._connect()
        return self

    def renew(self) -> None:
        """Replace both processes: two starts of a program may differ by a fifth in their speed."""
        self.client.close()
        if self.server is not None:
            self.server.close()
        self.client = Child("client", self.contender, self.env)
        self.start()

    def restart(self) -> float:
        """Start another server, connect the same client; seconds until it had its first answer."""
        assert self.server is not None
        self.server.close()
        begin = time.perf_counter()
        self._connect()
        return time.perf_counter() - begin

    def _connect(self) -> None:
        if not self.contender.one_process:
            self.server = Child("server", self.contender, self.env)
            announced = self.server.read()
            self.place, self.helpers = announced["place"], announced["helpers"]
        self.client.ask(place=self.place)

    def measure(self, *, payload: int, in_flight: int, seconds: float) -> Sample:
        """Warm up, then load for so many seconds; `cpu` is that of all its processes."""
        load = {"payload": payload, "in_flight": in_flight}
        self.client.ask(**load, seconds=seconds / 5)
        before = self.usage()
        sample: Sample = self.client.ask(**load, seconds=seconds)
        sample["cpu"] += self.usage()["cpu"] - before["cpu"]
        return sample

    def usage(self) -> dict[str, float]:
        """`cpu` seconds and `memory` bytes of the server's side."""
        return self.server.ask() if self.server is not None else {"cpu": 0.0, "memory": 0}

    def pin(self, cores: set[int]) -> None:
        """Let all its processes run on these cores only."""
        server = [self.server.pid] if self.server is not None else []
        for pid in [self.client.pid, *server, *self.helpers]:
            pin_process(pid, cores)

    def close(self) -> None:
        """End its processes."""
        self.client.close()
        if self.server is not None:
            self.server.close()
        with contextlib.suppress(OSError):
            self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def environment(contender: Contender, folder: str) -> dict[str, str]:
    """What a contender's processes need: our code, a domain and folders of their own."""
    path = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    # What pip installs has its bytecode; ours is in a checkout, and may have been told otherwise.
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {
        **kept,
        "PYTHONPATH": os.pathsep.join(path),
        "ROS_DOMAIN_ID": str(_FIRST_DOMAIN + CONTENDERS.index(contender)),
        "XDG_RUNTIME_DIR": folder,
        "XDG_STATE_HOME": folder,
        "TASKRPC_INTERFACE_PATH": str(ROOT / "benchmarks" / "interfaces"),
    }


def all_cores() -> set[int]:
    """The cores that this process may use."""
    return os.sched_getaffinity(0) if CAN_PIN else set()


def pin_process(pid: int, cores: set[int]) -> None:
    """Let all threads of a process run on these cores only, where the system can do it."""
    if CAN_PIN:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(int(thread.name), cores)
