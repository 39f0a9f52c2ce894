"""`taskrpc scene --page` serves the page at a port that does not change, and opens it."""

import socket

import aiohttp
import pytest

from taskrpc.cli.course.scene import page
from taskrpc.cli.main import main
from taskrpc.course.scenes.page import OwnTokens, ScenePage
from taskrpc.observe.web.server import LivePage, WebServer
from taskrpc.observe.web.streams import LiveStream


@pytest.fixture
def served(monkeypatch):
    """What was served, as (name, port, browser)."""
    seen = []

    def serve(name, *, port, browser):
        seen.append((name, port, browser))
        return 0

    monkeypatch.setattr(page, "serve", serve)
    return seen


def test_options_choose_scene_port_and_browser(served):
    assert main(["scene", "--page"]) == 0
    assert main(["scene", "deadlock", "--page", "--port", "9000", "--no-browser"]) == 0
    assert served == [("", None, True), ("deadlock", 9000, False)]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--page", "--cure"], "--page has buttons for --cure and --like-ros"),
        (["deadlock", "--port", "9000"], "--port belongs to --page"),
        (["deadlock", "--no-browser"], "--no-browser belongs to --page"),
    ],
)
def test_options_that_do_not_fit_are_named(capsys, served, arguments, words):
    assert main(["scene", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert served == []


def test_link_is_printed_without_a_browser(monkeypatch, capsys):
    page._open("http://127.0.0.1:8738/?scene=deadlock", browser=False)
    assert capsys.readouterr().out.splitlines() == [
        "http://127.0.0.1:8738/?scene=deadlock",
        "projector: http://127.0.0.1:8738/?scene=deadlock&projector",
    ]
    opened = []
    monkeypatch.setattr(page.webbrowser, "open", lambda link: opened.append(link) or True)
    page._open("http://127.0.0.1:8738/?scene=", browser=True)
    assert opened == ["http://127.0.0.1:8738/?scene="]


@pytest.mark.real_time
async def test_only_pages_of_this_server_may_run_a_scene():
    stream = LiveStream()
    scenes = ScenePage(stream)
    live = LivePage({}, OwnTokens(), stream, scenes, scenes)
    async with (
        WebServer({}, listen="127.0.0.1:0", live=live) as web,
        aiohttp.ClientSession() as session,
    ):
        for origin, status in (("http://evil.example", 403), (web.url, 400)):
            headers = {"Origin": origin}
            request = session.post(f"{web.url}/control/scene", json={"name": ""}, headers=headers)
            async with request as response:
                assert response.status == status


@pytest.mark.real_time
def test_port_that_is_taken_is_one_message(capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        assert main(["scene", "--page", "--no-browser", "--port", port]) == 1
    err = capsys.readouterr().err
    assert f"cannot listen at 127.0.0.1:{port}" in err
    assert "hint: end the other page of the scenes, or choose a port with --port" in err
