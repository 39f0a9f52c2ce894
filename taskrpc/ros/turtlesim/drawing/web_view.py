"""turtlesim on a web page, served to the browsers of this machine; needs the extra `web`.

The page gets server-sent events, as the live page of a task server does: `turtles` (poses, pens and
the background) and one event for each tile of the picture. Keys that the user presses on the page
arrive with `POST /control/press`, which needs the token of the link.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Iterator, Set
from concurrent.futures import Future
from pathlib import Path

import msgspec

from taskrpc.errors import CannotListen
from taskrpc.observe.web.pages import JSON, STATIC, Page, static_files
from taskrpc.observe.web.server import LivePage, WebServer
from taskrpc.observe.web.streams import Event, LiveStream, framed
from taskrpc.observe.web.tokens import Holder, Tokens
from taskrpc.ros.turtlesim.canvas import SIZE, Color
from taskrpc.ros.turtlesim.drawing.tiles import EVERY, SIDE, Position, runs, touched
from taskrpc.ros.turtlesim.keys import CANCEL, DIRECTIONS, HEADINGS
from taskrpc.ros.turtlesim.shape import OUTLINES
from taskrpc.ros.turtlesim.world import PIXELS_PER_METRE, Turtle, World, pixel

PORT = 8643
"""The port of the page, unless another program has it."""
KEYS = frozenset((*DIRECTIONS, *HEADINGS, CANCEL))
"""The keys that the page may send: those of turtle_teleop_key, without `q`."""
_MOST_KEYS = 20
_START_TIMEOUT = 10.0
_SHARED = ("/connection.js", "/dom.js", "/theme.css", "/theme.js", "/words.js")
"""The files of the live page that this page uses too."""


class WebView:
    """A web page with the picture; its server runs in a thread of its own.

    Args:
        port: the port of the page; None for `PORT` or, if another program has it, any free one.

    Raises CannotListen if the port is not free.
    """

    def __init__(self, port: int | None = None) -> None:
        self._ports = (PORT, 0) if port is None else (port,)
        self._stream = LiveStream()
        self._stream.source = self
        self._tokens = Tokens()
        self._loop = asyncio.new_event_loop()
        self._stopped = asyncio.Event()
        self._keys: deque[str] = deque(maxlen=_MOST_KEYS)
        self._is_open = False
        """Whether pages are open."""
        self._is_new = False
        """Whether a page needs everything, and not only the changes."""
        self._generation = 0
        self._turtles = b""
        started: Future[str] = Future()
        self._thread = threading.Thread(
            target=self._run, args=[started], name="turtlesim page", daemon=True
        )
        self._thread.start()
        self._url = started.result(_START_TIMEOUT)

    @property
    def url(self) -> str:
        """The link of the page; with its token, the page may send keys."""
        return f"{self._url}/#control={self._tokens.control}"

    def show(self, world: World, background: Color, title: str = "") -> bool:
        """Send what has changed to the open pages; always returns True."""
        changed = self._changed_tiles(world)
        if self._is_open:
            is_new, self._is_new = self._is_new, False
            events = [*self._tiles(world, EVERY if is_new else changed)]
            turtles = _turtles(world, background, title)
            if is_new or turtles != self._turtles:
                self._turtles = turtles
                events.append(Event("turtles", turtles))
            if events:
                self._loop.call_soon_threadsafe(self._stream.publish, events)
        return True

    def pressed_keys(self) -> Iterator[str]:
        """Yield the keys that users have pressed on the page since the last call."""
        while self._keys:
            yield self._keys.popleft()

    def close(self) -> None:
        """Tell the pages that the server ends, and stop it."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopped.set)
            self._thread.join()

    def _changed_tiles(self, world: World) -> Set[Position]:
        changed = touched(world.canvas.take_changes())
        if world.canvas.generation == self._generation:
            return changed
        self._generation = world.canvas.generation
        return EVERY

    @staticmethod
    def _tiles(world: World, tiles: Set[Position]) -> Iterator[Event]:
        for column, row in sorted(tiles):
            value = {"x": column * SIDE, "y": row * SIDE, "runs": runs(world.canvas, (column, row))}
            yield Event(f"tile_{column}_{row}", msgspec.json.encode(value))

    # In the thread of the server

    def begin(self) -> None:
        """Send everything with the next picture: the first page opens."""
        self._is_new = self._is_open = True

    def end(self) -> None:
        """Make no events: the last page has closed."""
        self._is_open = False

    def hello(self, *, control: bool) -> bytes:
        """Return the first event of a page: what does not change."""
        value = {
            "control": control,
            "size": SIZE,
            "tile": SIDE,
            "pixels_per_metre": PIXELS_PER_METRE,
            "outlines": OUTLINES,
        }
        return framed("hello", msgspec.json.encode(value))

    def task(self, task_id: int) -> None:
        """Return None: there are no tasks."""
        del task_id

    def _run(self, started: Future[str]) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve(started))

    async def _serve(self, started: Future[str]) -> None:
        files = static_files(Path(__file__).with_name("static"))
        files |= {path: file for path, file in static_files(STATIC).items() if path in _SHARED}
        page = LivePage(files, self._tokens, self._stream, self, _Keyboard(self._keys))
        try:
            server = await _started(page, self._ports)
        except Exception as error:  # the thread that waits for it raises it
            started.set_exception(error)
            return
        started.set_result(server.url)
        await self._stopped.wait()
        await server.close()


async def _started(page: LivePage, ports: tuple[int, ...]) -> WebServer:
    """Start the server at the first port that is free. Raises CannotListen."""
    server = WebServer({}, listen=f"127.0.0.1:{ports[0]}", live=page)
    try:
        await server.start()
    except CannotListen:
        if len(ports) == 1:
            raise
        return await _started(page, ports[1:])
    return server


def _turtles(world: World, background: Color, title: str) -> bytes:
    shown = [_shown(turtle) for _, turtle in sorted(world.turtles.items())]
    value = {"title": title, "background": background, "turtles": shown}
    return msgspec.json.encode(value)


def _shown(turtle: Turtle) -> dict[str, object]:
    left, top = pixel(turtle.x, turtle.y)
    return {
        "name": turtle.name,
        "x": round(turtle.x, 3),
        "y": round(turtle.y, 3),
        "theta": round(turtle.theta, 4),
        "left": round(left, 2),
        "top": round(top, 2),
        "pen": turtle.pen.color if turtle.pen.down else None,
        "width": turtle.pen.width,
    }


class _Press(msgspec.Struct):
    key: str


class _Keyboard:
    """Answers `POST /control/press`."""

    def __init__(self, keys: deque[str]) -> None:
        self._keys = keys

    async def answer(self, verb: str, content_type: str, body: bytes, holder: Holder) -> Page:
        """Note the key of a request such as `{"key": "up"}`."""
        if verb != "press" or not holder.may_control:
            return _problem(f"expected a request for /control/press, got {verb[:40]!r}", 404)
        if content_type.partition(";")[0].strip().lower() != JSON:
            return _problem(f"expected the Content-Type {JSON}, got {content_type[:80]!r}", 400)
        try:
            key = msgspec.json.decode(body, type=_Press).key
        except msgspec.MsgspecError as error:
            return _problem(f'expected a request such as {{"key": "up"}}: {error}', 400)
        if key not in KEYS:
            return _problem(f"expected one of the keys {', '.join(sorted(KEYS))}", 400)
        self._keys.append(key)
        return Page("{}", JSON)

    async def close(self) -> None:
        """Do nothing."""


def _problem(message: str, status: int) -> Page:
    return Page(msgspec.json.encode({"error": "RequestError", "message": message}), JSON, status)
