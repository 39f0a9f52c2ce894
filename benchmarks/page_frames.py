"""Measures how fast the live page draws while a task server is busy: frames, and CPU per frame.

    python -m benchmarks.page_frames [--tasks 500] [--clients 60] [--seconds 8] [LOOK ...]

Each client makes one call in a second, and the robot drives all the time. A headless Chromium shows
the page: it has no graphics card, so all drawing is work of the CPU. It needs the extra `browser`
and what `make browser` needs. Linux only: the CPU of Chromium's threads comes from /proc. A look is
`page`, `projector`, `phone`, or a tab of the lower panel: `list` or `nodes`.

A row first counts frames: their rate, and the time that 99 % of them keep. Then it measures without
counting, as counting itself costs a frame. The times are milliseconds in a second of the page: all
of the main thread, its scripts, styles and layouts; drawing layers; putting layers together.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import tempfile
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

import taskrpc
from taskrpc.robot.tasks.services.offered_tasks import load_types
from tests.browser.chromium import LAPTOP, PHONE, Tab, Tabs, chromium
from tests.browser.task_server import TaskServer

LOOKS = ("page", "projector", "phone", "list", "nodes")
TARGETS = ("warehouse", "station_1", "area_a", "dock")

_COUNT_FRAMES = """
const frames = [];
return await new Promise(done => requestAnimationFrame(function frame(now) {
    frames.push(now);
    const seconds = (now - frames[0]) / 1000;
    if (seconds < args[0]) return requestAnimationFrame(frame);
    const gaps = frames.slice(1).map((at, i) => at - frames[i]).sort((a, b) => a - b);
    done([gaps.length / seconds, gaps[Math.floor(gaps.length * .99)]]);
}));
"""

_THREADS = {
    "ThreadPoolForeg": "raster",
    "CompositorTileW": "raster",
    "Compositor": "composite",
    "VizCompositorTh": "composite",
    "CrGpuMain": "composite",
}
"""What Chromium's threads do, by their names."""

COLUMNS = {
    "TaskDuration": "main",
    "ScriptDuration": "script",
    "RecalcStyleDuration": "style",
    "LayoutDuration": "layout",
    "raster": "raster",
    "composite": "composite",
}
"""The figures of Chromium, and their names in the table: milliseconds of CPU in a second."""


class Load:
    """Programs that queue tasks and then call all the time, in a thread of this process."""

    def __init__(self, tasks: int, clients: int) -> None:
        self.queued = threading.Event()
        self._tasks, self._clients = tasks, clients
        self._ends = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    def __enter__(self) -> Load:
        self._thread.start()
        self.queued.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    async def _run(self) -> None:
        types = load_types()
        async with contextlib.AsyncExitStack() as stack:
            names = [f"client_{number}" for number in range(self._clients)]
            nodes = [await stack.enter_async_context(taskrpc.Node(name)) for name in names]
            submit = [node.create_client(types["submit"], "/robot_task") for node in nodes]
            show = [node.create_client(types["show"], "/robot_task/show") for node in nodes]
            for number in range(self._tasks):
                target, priority = TARGETS[number % len(TARGETS)], 1 + number % 10
                request = types["submit"].Request(
                    task_type="move", target=target, priority=priority
                )
                await submit[number % len(nodes)].call(request)
            self.queued.set()
            request = types["show"].Request(task_id=1)
            while not self._ends.is_set():
                for client in show:
                    await client.call(request)
                    await asyncio.sleep(1 / self._clients)


def spent(tab: Tab, root: int) -> Counter[str]:
    """Return what Chromium has spent on a page so far, in seconds."""
    seconds = _thread_seconds(root)
    for metric in tab.command("Performance.getMetrics")["metrics"]:
        seconds[metric["name"]] = metric["value"]
    return seconds


def _thread_seconds(root: int) -> Counter[str]:
    """Return the CPU seconds of the threads of a process and its descendants, by what they do."""
    children = defaultdict(list)
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # the process has just ended
            children[int(_fields(path)[2])].append(int(path.parent.name))
    spent: Counter[str] = Counter()
    processes = [root]
    for process in processes:
        processes += children[process]
        for path in Path(f"/proc/{process}/task").glob("*/stat"):
            fields = _fields(path)
            if part := _THREADS.get(fields[0]):
                spent[part] += (int(fields[12]) + int(fields[13])) / os.sysconf("SC_CLK_TCK")
    return spent


def _fields(path: Path) -> list[str]:
    """Return the name, then the fields after it."""
    name, _, rest = path.read_text().partition("(")[2].rpartition(")")
    return [name, *rest.split()]


def measure(tab: Tab, root: int, look: str, seconds: float) -> None:
    """Print one row."""
    rate, slow = tab.run_async(_COUNT_FRAMES, seconds)
    before, begin = spent(tab, root), time.monotonic()
    time.sleep(seconds)
    after, elapsed = spent(tab, root), time.monotonic() - begin
    each = [1000 * (after[name] - before[name]) / elapsed for name in COLUMNS]
    nodes = tab.run("return document.querySelectorAll('*').length")
    print(f"{look:9} {rate:9.1f} {slow:9.1f}", *(f"{ms:9.1f}" for ms in each), f"{nodes:9}")


def main() -> None:
    """Run the measurement."""
    parser = argparse.ArgumentParser(description="measure how fast the live page draws")
    parser.add_argument("looks", nargs="*", metavar="LOOK", default=LOOKS)
    parser.add_argument("--tasks", type=int, default=500)
    parser.add_argument("--clients", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        os.environ["XDG_RUNTIME_DIR"] = os.environ["XDG_STATE_HOME"] = folder
        server = TaskServer(Path(folder))
        stack.callback(server.end)
        stack.enter_context(Load(options.tasks, options.clients))
        browser = stack.enter_context(chromium())
        names = ("frames/s", "99 %, ms", *COLUMNS.values(), "nodes")
        print("look     ", *(f"{name:>9}" for name in names))
        for look in options.looks:
            with Tabs(browser) as tabs:
                tab = tabs.open(
                    server.url + ("?projector" if look == "projector" else ""),
                    size=PHONE if look == "phone" else LAPTOP,
                    color_scheme="light",
                )
                tab.command("Performance.enable", timeDomain="threadTicks")
                if look in ("list", "nodes"):
                    tab.click(f"#tab_{look}")
                time.sleep(3)
                measure(tab, browser.service.process.pid, look, options.seconds)


if __name__ == "__main__":
    main()
