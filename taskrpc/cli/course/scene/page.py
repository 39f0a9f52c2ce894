"""`taskrpc scene --page`: serves the scenes on the live page, on this machine only."""

from __future__ import annotations

import asyncio
import sys
import webbrowser

from taskrpc.cli.shared.command import exit_after, hinted
from taskrpc.errors import CannotListen, TaskRpcError
from taskrpc.program import run, stop_requested

try:
    from taskrpc.observe.web.server import LivePage, WebServer
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"--page needs {error.name}: pip install aiohttp") from None

from taskrpc.course.scenes.page import OwnTokens, ScenePage, scene_files
from taskrpc.observe.web.pages import static_files
from taskrpc.observe.web.streams import LiveStream

PORT = 8738
"""The usual port: always the same one, so that links on slides stay valid."""


def serve(name: str, *, port: int | None, browser: bool) -> int:
    """Serve until a signal ends the command; `name` is the scene that the browser opens.

    Raises CannotListen.
    """
    try:
        return exit_after(run(_serve(name, PORT if port is None else port, browser=browser)))
    except CannotListen as error:
        raise hinted(
            error, "end the other page of the scenes, or choose a port with --port"
        ) from None


async def _serve(name: str, port: int, *, browser: bool) -> int:
    stream = LiveStream()
    page = ScenePage(stream)
    files = {**static_files(), **scene_files()}
    live = LivePage(files, OwnTokens(), stream, page, page)
    server = WebServer({}, listen=f"127.0.0.1:{port}", live=live)
    async with stop_requested() as stopped, server as web:
        # In a thread: a browser that starts slowly must not delay its own first request.
        await asyncio.to_thread(_open, f"{web.url}/?scene={name}", browser=browser)
        print("Ctrl-C ends the page", file=sys.stderr, flush=True)
        return await stopped


def _open(link: str, *, browser: bool) -> None:
    if not browser or not webbrowser.open(link):
        print(link, flush=True)
        print(f"projector: {link}&projector", flush=True)
    else:
        print(f"the page of the scenes is at {link}", file=sys.stderr, flush=True)
