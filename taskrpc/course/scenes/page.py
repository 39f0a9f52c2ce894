"""The scenes on the live page: their texts as a file, and a run of a scene as events.

The page has buttons that run the programs of the scenes, and nothing else. So every page of this
machine's user may press them, without the token of a link: a link on a slide stays valid.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec

from taskrpc.course.scenes.catalogue import SCENES, scene
from taskrpc.course.scenes.moments import Moment
from taskrpc.course.scenes.player import excerpt, play, program_path
from taskrpc.course.scenes.scene import Scene
from taskrpc.course.scenes.stage import SERVICE
from taskrpc.errors import TaskRpcError
from taskrpc.observe.web.calls import CallLog
from taskrpc.observe.web.pages import JSON, Page, static_files
from taskrpc.observe.web.streams import Event, LiveStream, framed
from taskrpc.observe.web.tokens import Holder, Tokens
from taskrpc.robot.tasks.page_events import PROTOCOL

STATIC = Path(__file__).with_name("static")
"""The folder of the files that only this page has."""
VERB = "scene"
"""The buttons of the page: `POST /control/scene`."""
_TICK = 0.2
"""Seconds between two looks for calls."""


class Wanted(msgspec.Struct, frozen=True):
    """The body of a request to run a program of a scene."""

    name: str
    cure: bool = False
    like_ros: bool = False


class Run(msgspec.Struct):
    """A run of a program of a scene, as the page shows it."""

    number: int
    """Counts the runs."""
    name: str
    cure: bool
    like_ros: bool
    running: bool = True
    problem: str = ""
    """Why the program could not run, "" if it could."""
    moments: list[Moment] = []


class OwnTokens(Tokens):
    """Lets the server's own user press the buttons without a token."""

    def holder(self, given: str, *, of_links: bool = True) -> Holder | None:
        """Return the user; `of_links` is False for processes of other users of this machine."""
        if of_links and not given:
            return Holder("")
        return super().holder(given, of_links=of_links)


class ScenePage:
    """What the live page shows, and what its buttons do; it runs one program at a time."""

    def __init__(self, stream: LiveStream) -> None:
        stream.source = self
        self._stream = stream
        self._calls = CallLog()
        self._started = time.time()
        self._run: Run | None = None
        self._playing: asyncio.Task[None] | None = None
        self._publishing: asyncio.Task[None] | None = None

    # What the page shows

    def hello(self, *, control: bool) -> bytes:
        """Return the first event of a page as text."""
        server = {
            "node": "/task_server",
            "service": SERVICE,
            "address": "this machine",
            "started": self._started,
            "speed": 1.0,
            "version": metadata.version("taskrpc"),
        }
        about = {"protocol": PROTOCOL, "server": server, "control": control, "map": None}
        return framed("hello", msgspec.json.encode({**about, "scenes": True, "now": time.time()}))

    def task(self, task_id: int) -> bytes | None:
        """Return None: the page of the scenes has no details of tasks."""
        del task_id
        return None

    def begin(self) -> None:
        """Publish the run and the calls from now on."""
        self._calls.is_active = True
        self._publishing = asyncio.create_task(self._publish_calls(), name="taskrpc scenes")
        self._publish_run()

    def end(self) -> None:
        """Stop publishing: no page is open."""
        self._calls.is_active = False
        if self._publishing is not None:
            self._publishing.cancel()

    # What its buttons do

    async def answer(self, verb: str, content_type: str, body: bytes, holder: Holder) -> Page:
        """Start to run a program of a scene."""
        del holder
        if verb != VERB:
            return _answer(404, f"expected {VERB}, got {verb[:40]!r}")
        if content_type != JSON:
            return _answer(400, f"expected the Content-Type {JSON}, got {content_type[:80]!r}")
        try:
            wanted = msgspec.json.decode(body, type=Wanted)
            chosen = scene(wanted.name[:40])
        except (msgspec.MsgspecError, UnicodeDecodeError, TaskRpcError) as error:
            return _answer(400, str(error))
        if self._playing is not None and not self._playing.done():
            return _answer(409, "a program of a scene runs; wait until it has ended")
        number = 1 if self._run is None else self._run.number + 1
        self._run = Run(number, chosen.name, wanted.cure, wanted.like_ros, moments=[])
        self._publish_run()
        self._playing = asyncio.create_task(self._play(chosen, self._run), name="taskrpc scene")
        return _answer(200, "The program starts.")

    async def close(self) -> None:
        """End the program that runs."""
        if self._playing is not None:
            self._playing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._playing

    async def _play(self, chosen: Scene, run: Run) -> None:
        def report(moment: Moment) -> None:
            run.moments.append(moment)
            self._publish_run()

        try:
            await play(chosen, report, cure=run.cure, like_ros=run.like_ros, observer=self._calls)
        except (TaskRpcError, OSError) as error:
            run.problem = str(error)
        finally:
            run.running = False
            self._publish_run()

    def _publish_run(self) -> None:
        if self._run is not None:
            self._stream.publish([Event("scene", msgspec.json.encode(_shown(self._run)))])

    async def _publish_calls(self) -> None:
        loop = asyncio.get_running_loop()
        always = True
        while True:
            calls = self._calls.event(loop.time(), always=always)
            always = False
            self._stream.publish([] if calls is None else [calls])
            await asyncio.sleep(_TICK)


def scene_files() -> dict[str, Page]:
    """Return the files that the page of the scenes has more than the live page, by path.

    `/scenes.json` has all scenes with the lines of their programs.
    """
    texts = Page(msgspec.json.encode([_described(each) for each in SCENES]), JSON)
    return {**static_files(STATIC), "/scenes.json": texts}


def _described(each: Scene) -> dict[str, Any]:
    texts = {key: getattr(each, key) for key in ("name", "title", "sees", "ros", "why", "cure")}
    return texts | {
        "robot": each.robot,
        "code": [_lines(each, cure=False), _lines(each, cure=True)],
    }


def _lines(each: Scene, *, cure: bool) -> list[tuple[Any, ...]]:
    program = program_path(each, cure=cure).read_text(encoding="utf-8")
    return [tuple(line) for line in excerpt(each, cure=cure).lines(program)]


def _shown(run: Run) -> dict[str, Any]:
    moments = [moment._asdict() | {"at": round(moment.at, 2)} for moment in run.moments]
    return msgspec.structs.asdict(run) | {"moments": moments}


def _answer(status: int, message: str) -> Page:
    fields = {"success": status == 200, "error": "RequestError", "message": message}
    return Page(msgspec.json.encode(fields), JSON, status)
