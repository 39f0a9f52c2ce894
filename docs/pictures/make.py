"""Makes the pictures of the documentation: screenshots from a real run of the task server, and
turtlesim's window and its web page.

`make pictures` runs it; it needs the extra `browser` and what `make browser` needs. It takes about
a minute.
"""

from __future__ import annotations

import os
import struct
import sys
import tempfile
import threading
import time
import zlib
from contextlib import ExitStack, closing, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import taskrpc
from taskrpc.cli.shared.page_link import noted_links
from taskrpc.ros.turtlesim.canvas import SIZE
from taskrpc.ros.turtlesim.drawing.raster import picture
from taskrpc.ros.turtlesim.drawing.web_view import WebView
from taskrpc.ros.turtlesim.world import CENTRE, STEP, World
from tests.browser.chromium import LAPTOP, PHONE, Tab, Tabs, chromium
from tests.browser.task_server import Services, TaskServer

FOLDER = Path(__file__).parent
MOST_BYTES = 200_000
"""Most bytes of one picture."""
PROGRAMS = ("ada", "ben", "cleo", "display")
FAULTS = ("--fault", "delay-response:1ms,first=7", "--fault", "lose-response:first=1")
"""The eighth submission loses its response; the ones before are not disturbed."""

BACKGROUND = (69, 86, 255)
"""The color of turtlesim's paper."""


def main() -> int:
    """Write the pictures; returns the exit code."""
    (FOLDER / "turtlesim.png").write_bytes(_turtlesim())
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "runtime").mkdir(mode=0o700)
        os.environ["XDG_RUNTIME_DIR"] = str(folder / "runtime")  # no other server is in the picture
        server = TaskServer(folder, "--introspection", "metadata", *FAULTS)
        stack.callback(server.end)
        programs = {name: stack.enter_context(Services(name)) for name in PROGRAMS}
        tabs = stack.enter_context(Tabs(stack.enter_context(chromium())))
        pictures = _open(tabs, server)
        _story(stack, programs)
        for name, tab in pictures.items():
            tab.picture(FOLDER / f"{name}.png")
        _turtlesim_page(tabs, FOLDER / "turtlesim_page.png")
        if problems := tabs.problems():
            raise SystemExit("\n".join(problems))
    large = [path.name for path in FOLDER.glob("*.png") if path.stat().st_size > MOST_BYTES]
    for name in large:
        print(f"{name} has more than {MOST_BYTES} bytes", file=sys.stderr)
    return 1 if large else 0


def _open(tabs: Tabs, server: TaskServer) -> dict[str, Tab]:
    """Open one tab for each picture: its name is that of the file."""
    control = noted_links()[0].control_link
    light, dark = {"color_scheme": "light"}, {"color_scheme": "dark"}
    return {
        "live-light": tabs.open(control, size=LAPTOP, **light),
        "live-dark": tabs.open(control, size=LAPTOP, **dark),
        "projector": tabs.open(f"{server.url}?projector", size=LAPTOP, **light),
        "phone": tabs.open(control, size=PHONE, **light),
    }


def _story(stack: ExitStack, programs: dict[str, Services]) -> None:
    """Let tasks and calls of every kind happen; the last one goes ahead of the others."""
    ada, ben, cleo = (programs[name] for name in PROGRAMS[:3])
    ada.submit("report", "dock", 6)
    ended = ben.submit("scan", "1.6,1.4", 6)
    cancelled = cleo.submit("move", "station_1", 2)
    stack.enter_context(_watching(programs["display"]))  # its lane is below those of the others
    _until_ended(ada, ended)
    cleo.call("/cancel", task_id=cancelled)
    ada.submit("move", "warehouse", 8)
    ben.submit("move", "station_1", 5)
    cleo.submit("scan", "area_a", 5)
    ada.submit("report", "dock", 3)
    _until_begun(ada)
    for number in range(12):  # the robot is on its way
        (ada, ben, cleo)[number % 3].show(number % 5 + 1)
        time.sleep(0.5)
    request = {"task_type": "move", "target": "central", "priority": 5, "request_id": "ben-1"}
    with suppress(taskrpc.DeadlineExceeded):
        ben.call(**request, timeout=2.4)  # its response is lost
    time.sleep(0.3)
    ben.call(**request)  # the retry saves it: the server repeats its stored answer
    time.sleep(1.8)  # its label leaves the edge of the drawing
    cleo.submit("scan", "central", 10)
    time.sleep(0.6)  # the rows have slid to their new places; their reasons are shown


class _watching:
    """A program that asks for the list of tasks a few times a second."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ends.wait(0.4):
            self._services.call("/list")


def _until_ended(services: Services, task_id: int) -> None:
    while not services.show(task_id).ended.sec:
        time.sleep(0.2)


def _until_begun(services: Services) -> None:
    while not any(task.state == "RUNNING" for task in services.call("/list").tasks):
        time.sleep(0.1)


def _world() -> World:
    """The turtles after the tutorial's commands."""
    world = World()
    first = world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    second = world.spawn("turtle2", 2.0, 2.0, 0.2)
    second.set_pen((255, 196, 61), 5, off=False)
    for number in range(300):
        first.command(2.0, 0.0, 1.8, number * STEP)
        second.command(1.6, 0.0, 0.06, number * STEP)
        world.step(number * STEP)
    return world


def _turtlesim_page(tabs: Tabs, path: Path) -> None:
    """Write a screenshot of turtlesim's web page."""
    with closing(WebView(0)) as view:
        tab = tabs.open(view.url, size=(860, 576), color_scheme="light")
        world = _world()

        def drawn() -> bool:
            view.show(world, BACKGROUND, "/turtlesim")
            return len(tab.texts("#poses tr")) == len(world.turtles)

        tab.find('[data-state="live"]')
        tab.wait(drawn, "the turtles")
        time.sleep(0.3)  # the animation frame has drawn them
        tab.picture(path)
        tab.open("about:blank")


def _turtlesim() -> bytes:
    """The window of turtlesim after the tutorial's commands, as a PNG file."""
    rows = [b"\0" + b"".join(map(bytes, row)) for row in picture(_world(), BACKGROUND, SIZE, SIZE)]
    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(b"".join(rows), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in parts)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


if __name__ == "__main__":
    sys.exit(main())
