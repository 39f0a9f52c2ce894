"""Measures what open live pages cost the task server: CPU and memory for 0, 1 and 50 pages.

    python -m benchmarks.live_pages [--seconds 10] [PAGES ...]

The server runs in a process of its own, with the simulated robot driving all the time and a client
that makes 20 calls in a second. The pages are connections of this process that read everything.
Linux only: the figures come from /proc.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import taskrpc
from taskrpc.robot.tasks.services.offered_tasks import load_types

CALLS_A_SECOND = 20
TARGETS = ("warehouse", "station_1", "area_a", "dock")
START = [
    sys.executable,
    "-m",
    "taskrpc.cli.robot.server.command_line",
    "--db",
    ":memory:",
    "--web",
    "127.0.0.1:0",
]


class Server:
    """A task server in a process of its own."""

    def __init__(self, folder: str) -> None:
        os.environ["XDG_RUNTIME_DIR"] = os.environ["XDG_STATE_HOME"] = folder
        self.process = subprocess.Popen(START, stderr=subprocess.PIPE, text=True)
        self.port = 0

    def wait(self) -> None:
        """Wait until it accepts calls."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if found := re.search(r"live page is at http://127\.0\.0\.1:(\d+)", line):
                self.port = int(found[1])
            if "ready:" in line:
                return
        raise SystemExit("the server did not start")

    def cpu(self) -> float:
        """Seconds of CPU so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def megabytes(self) -> float:
        """Resident memory."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmRSS:\s+(\d+)", status)
        assert found is not None
        return int(found[1]) / 1024


class Pages:
    """Open pages; counts the bytes that they got."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.received = 0
        self.tasks: list[asyncio.Task[None]] = []

    async def open(self, count: int) -> None:
        """Open pages."""
        self.tasks = [asyncio.create_task(self._read()) for _ in range(count)]
        await asyncio.sleep(2)

    async def close(self) -> None:
        """Close all pages."""
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        await asyncio.sleep(1)

    async def _read(self) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(b"GET /live HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % self.port)
        with contextlib.closing(writer):
            while data := await reader.read(65536):
                self.received += len(data)


async def drive(node: taskrpc.Node) -> None:
    """Keep the robot driving, and make calls."""
    types = load_types()
    submit = node.create_client(types["submit"], "/robot_task")
    listing = node.create_client(types["list"], "/robot_task/list")
    number = 0
    while True:
        response = await listing.call(types["list"].Request())
        if response.queued < 10:
            number += 1
            target = TARGETS[number % len(TARGETS)]
            await submit.call(types["submit"].Request(task_type="move", target=target, priority=5))
        await asyncio.sleep(1 / CALLS_A_SECOND)


async def measure(server: Server, counts: list[int], seconds: float) -> None:
    """Print a row for each number of pages."""
    print("pages  server CPU  server memory  bytes a second and page")
    async with taskrpc.Node("bench") as node:
        driving = asyncio.create_task(drive(node))
        await asyncio.sleep(3)
        for count in counts:
            pages = Pages(server.port)
            await pages.open(count)
            cpu, began, received = server.cpu(), time.monotonic(), pages.received
            await asyncio.sleep(seconds)
            elapsed = time.monotonic() - began
            used, got = server.cpu() - cpu, pages.received - received
            each = got / count / elapsed if count else 0
            share = 100 * used / elapsed
            print(f"{count:5}  {share:8.1f} %  {server.megabytes():10.1f} MB  {each:10.0f}")
            await pages.close()
        driving.cancel()


def main() -> None:
    """Run the measurement."""
    parser = argparse.ArgumentParser(description="measure what open live pages cost the server")
    parser.add_argument("pages", type=int, nargs="*", default=[0, 1, 50])
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = Server(folder)
        try:
            server.wait()
            asyncio.run(measure(server, options.pages, options.seconds))
        finally:
            server.process.terminate()
            server.process.communicate()


if __name__ == "__main__":
    main()
