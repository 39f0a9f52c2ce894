"""`taskrpc view FILE`: serves the live page with a recording instead of a running task server."""

from __future__ import annotations

import argparse
import asyncio
import sys
import webbrowser
from pathlib import Path

import msgspec

from taskrpc.cli.shared.command import tune_for_long_run
from taskrpc.errors import TaskRpcError
from taskrpc.observe.recording.mcap_file import Recording, RecordingError
from taskrpc.observe.recording.replay import replay
from taskrpc.observe.recording.timeline import Timeline
from taskrpc.program import run, stop_requested

try:
    from taskrpc.observe.web.server import LivePage, WebServer
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"taskrpc view needs {error.name}: pip install aiohttp") from None

from taskrpc.observe.web.pages import static_files
from taskrpc.observe.web.streams import LiveStream, framed
from taskrpc.observe.web.tokens import Tokens

_MOST_REPLAYED = 20_000_000
"""Most bytes of a recording whose decisions are replayed; the replay takes a second."""


def view(options: argparse.Namespace) -> int:
    """Serve the page of a recording until a signal ends the command."""
    timeline = _timeline(Path(options.file))
    if timeline.problem:
        print(f"WARNING: {timeline.problem}", file=sys.stderr, flush=True)
    return 128 + run(_serve(timeline, options))


def _timeline(path: Path) -> Timeline:
    """Read a recording. Raises RecordingError."""
    recording = Recording(path)
    return Timeline(recording, mistake=_difference(recording))


def _difference(recording: Recording) -> str:
    """Return in words how the decisions differ from their replay; "" if they do not."""
    if recording.size > _MOST_REPLAYED:
        return ""
    try:
        report = replay(recording)
    except RecordingError:
        return ""  # there are no decisions, or the time line says which one is impossible
    if not report.differences:
        return ""
    first = report.differences[0]
    return f"the decisions differ from their replay (did another version write them?): {first}"


class _RecordedPage:
    """What the page gets before it reads the recording."""

    def __init__(self, timeline: Timeline) -> None:
        self._hello = framed("hello", msgspec.json.encode(timeline.hello.data))

    def hello(self, *, control: bool) -> bytes:
        """Return the first event of a page as text; there is nothing to control."""
        del control
        return self._hello

    def task(self, task_id: int) -> bytes | None:
        """Return None: the results of tasks are events of the recording."""
        del task_id
        return None


async def _serve(timeline: Timeline, options: argparse.Namespace) -> int:
    """Serve until the process gets a signal; returns the signal's number."""
    page = LivePage(
        static_files(), Tokens(), LiveStream(), _RecordedPage(timeline), recording=timeline
    )
    async with stop_requested() as stopped, WebServer({}, listen="127.0.0.1:0", live=page) as web:
        tune_for_long_run()
        # In a thread: a browser that starts slowly must not delay its own first request.
        await asyncio.to_thread(_show, web.url, options)
        print("Ctrl-C ends the command", file=sys.stderr, flush=True)
        return await stopped


def _show(url: str, options: argparse.Namespace) -> None:
    """Open the page in the browser, or print its links if no browser can be opened."""
    projector = f"{url}/?projector"
    if not options.no_browser:
        # These links only show, and this machine needs no token for that.
        if webbrowser.open(projector if options.projector else f"{url}/"):
            print(f"the recording is at {url}/", file=sys.stderr, flush=True)
            return
        print("found no browser; open one of these links yourself:", file=sys.stderr)
    print(f"read-only: {url}/")
    print(f"projector: {projector}", flush=True)
