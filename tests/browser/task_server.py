"""A real `taskrpc-server --web`, and what its services say of the tasks."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import srvgen
from taskrpc import sync

ROOT = Path(__file__).parents[2]
PATIENCE = 60
"""Seconds until a program must be ready."""

_SERVICES = {
    "": "my_robot_interfaces/srv/RobotTask",
    "/list": "taskrpc_interfaces/srv/ListTasks",
    "/show": "taskrpc_interfaces/srv/ShowTask",
    "/cancel": "taskrpc_interfaces/srv/CancelTask",
    "/pause": "taskrpc_interfaces/srv/PauseTasks",
    "/resume": "taskrpc_interfaces/srv/ResumeTasks",
    "/reprioritise": "taskrpc_interfaces/srv/ReprioritiseTask",
    "/stop": "taskrpc_interfaces/srv/StopRobot",
}
_PAGES_AT = re.compile(r"https?://127\.0\.0\.1:\d+")


class TaskServer:
    """A `taskrpc-server --web` process, started and ready.

    Args:
        folder: where it runs and writes its log.
        options: more options of the command line, such as `--speed`.
        web: the address of its pages, to start it again at the same one.
        first: statements that the process executes before it starts the server.
    """

    def __init__(
        self, folder: Path, *options: str, web: str = "127.0.0.1:0", first: str = ""
    ) -> None:
        self.log = folder / f"server-{time.monotonic_ns()}.log"
        module = "taskrpc.cli.robot.server.command_line"
        program = f"{first}; from {module} import main; raise SystemExit(main())"
        how = ["-c", program] if first else ["-m", module]
        command = [sys.executable, *how, "--web", web, *options]
        if "--db" not in options:
            command += ["--db", ":memory:"]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
            )
        ends = time.monotonic() + PATIENCE
        while (pages := _PAGES_AT.search(self.text)) is None or "ready: " not in self.text:
            assert self.process.poll() is None, self.text
            assert time.monotonic() < ends, self.text
            time.sleep(0.02)
        self.url = f"{pages.group()}/"
        """The link that only shows."""

    @property
    def text(self) -> str:
        """What it has written to its log."""
        return self.log.read_text(encoding="utf-8")

    @property
    def web(self) -> str:
        """The address of its pages, as `--web` takes it."""
        return self.url.removeprefix("http://").rstrip("/")

    def kill(self) -> None:
        """End it as a fault would, without a last word."""
        self.process.kill()
        self.process.wait(10)

    def end(self) -> None:
        """End it as an operator would."""
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait(30)


class Services:
    """Calls the public services of the task server, as any program of the user can."""

    def __init__(self, name: str = "ada") -> None:
        self._node = sync.Node(name)
        self._clients: dict[str, Any] = {}

    def __enter__(self) -> Services:
        self._node.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy()

    def call(
        self, verb: str = "", *, timeout: float = PATIENCE, request_id: str = "", **fields: Any
    ) -> Any:
        """Call the service of a verb such as `/list`, "" for `/robot_task`."""
        if (client := self._clients.get(verb)) is None:
            client = self._node.create_client(srvgen.load(_SERVICES[verb]), f"/robot_task{verb}")
            self._clients[verb] = client
            assert client.wait_for_service(PATIENCE)
        request = srvgen.load(_SERVICES[verb]).Request(**fields)
        return client.call(request, timeout=timeout, request_id=request_id)

    def submit(
        self,
        task_type: str = "move",
        target: str = "warehouse",
        priority: int = 5,
        *,
        request_id: str = "",
    ) -> int:
        """Queue a task; returns its number."""
        response = self.call(
            task_type=task_type, target=target, priority=priority, request_id=request_id
        )
        assert response.success, response.message
        return int(response.task_id)

    def show(self, task_id: int) -> Any:
        """Return everything about one task."""
        return self.call("/show", task_id=task_id).task
