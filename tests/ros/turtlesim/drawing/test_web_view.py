"""turtlesim's web page: its events, its keys, its server and its files."""

import asyncio
import http.client
import json
import re
import socket
from collections import deque
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("aiohttp")

from taskrpc.errors import CannotListen
from taskrpc.observe.web.pages import JSON
from taskrpc.observe.web.tokens import Holder
from taskrpc.ros.turtlesim.drawing import web_view
from taskrpc.ros.turtlesim.drawing.web_view import KEYS, WebView, _Keyboard
from taskrpc.ros.turtlesim.world import CENTRE, World

pytestmark = pytest.mark.real_time

BLUE = (69, 86, 255)
STATIC = Path(web_view.__file__).with_name("static")
MOST_BYTES = 25_000


@pytest.fixture
def view():
    view = WebView(0)
    yield view
    view.close()


@pytest.fixture
def world():
    world = World()
    world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    return world


class _Page:
    """A browser that reads the events of a view."""

    def __init__(self, view):
        self.address = urlsplit(view.url)
        self._stream = self.connect()
        self._stream.request("GET", "/live")
        self._response = self._stream.getresponse()

    def connect(self):
        return http.client.HTTPConnection(self.address.hostname, self.address.port, timeout=10)

    def next(self):
        """Return the name and the data of the next event."""
        name = self._response.readline().decode().removeprefix("event: ").strip()
        data = self._response.readline().decode().removeprefix("data: ")
        self._response.readline()
        return name, json.loads(data)

    def until(self, name):
        """Return the data of the next event of this name, and the names of the events before."""
        before = []
        while (event := self.next())[0] != name:
            before.append(event[0])
        return event[1], before

    def press(self, body, token=None):
        headers = {"Content-Type": JSON}
        token = self.address.fragment.removeprefix("control=") if token is None else token
        headers |= {"Authorization": f"Bearer {token}"} if token else {}
        connection = self.connect()
        connection.request("POST", "/control/press", json.dumps(body), headers)
        response = connection.getresponse()
        text = response.read().decode()
        connection.close()
        return response.status, text

    def close(self):
        self._response.close()
        self._stream.close()


def test_a_page_gets_all_tiles_once_and_then_the_changes(view, world):
    page = _Page(view)
    hello, _ = page.until("hello")
    assert view.show(world, BLUE, "/sim/turtlesim")
    assert (hello["size"], hello["control"]) == (500, False)
    turtles, before = page.until("turtles")
    assert len(before) == 100
    assert (turtles["title"], turtles["background"]) == ("/sim/turtlesim", list(BLUE))
    (turtle,) = turtles["turtles"]
    assert (turtle["name"], turtle["theta"], turtle["pen"]) == ("turtle1", 0.0, [179, 184, 255])
    view.show(world, BLUE, "/sim/turtlesim")  # nothing has changed, so that there is no event
    world.turtles["turtle1"].command(2.0, 0.0, 0.0, 0.0)
    world.step(0.0)
    world.turtles["turtle1"].set_pen((1, 2, 3), 5, off=True)
    view.show(world, (1, 1, 1), "/sim/turtlesim")
    turtles, before = page.until("turtles")
    assert set(before) == {"tile_4_4", "tile_4_5", "tile_5_4", "tile_5_5"} & set(before)
    assert before
    assert turtles["background"] == [1, 1, 1]
    assert turtles["turtles"][0]["pen"] is None
    world.reset()
    view.show(world, (1, 1, 1), "/sim/turtlesim")
    turtles, before = page.until("turtles")
    assert (turtles["turtles"], len(before)) == ([], 100)
    page.close()


def test_keys_of_a_page_need_the_token_of_the_link(view):
    page = _Page(view)
    assert page.press({"key": "up"}, token="")[0] == 401
    assert page.press({"key": "up"}, token="guessed")[0] == 401
    assert list(view.pressed_keys()) == []
    assert page.press({"key": "up"}) == (200, "{}")
    assert page.press({"key": "t"}) == (200, "{}")
    assert list(view.pressed_keys()) == ["up", "t"]
    assert list(view.pressed_keys()) == []
    page.close()


def test_pages_are_told_when_the_view_closes(view):
    page = _Page(view)
    page.next()
    view.close()
    assert page.until("ending")[0] == {"reason": "the server is ending"}
    page.close()


def test_a_port_that_is_not_free_is_an_error_only_if_the_user_has_chosen_it(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(CannotListen):
            WebView(port)
        monkeypatch.setattr(web_view, "PORT", port)
        view = WebView()
        assert urlsplit(view.url).port not in (None, port)
        view.close()


@pytest.mark.parametrize(
    ("verb", "content_type", "body", "status", "reason"),
    [
        ("press", JSON, b'{"key": "q"}', 400, "expected one of the keys"),
        ("press", JSON, b'{"key": 1}', 400, "expected a request such as"),
        ("press", JSON, b"up", 400, "expected a request such as"),
        ("press", "text/plain", b'{"key": "up"}', 400, "expected the Content-Type"),
        ("submit", JSON, b'{"key": "up"}', 404, "expected a request for /control/press"),
    ],
)
def test_a_wrong_key_request_is_refused_with_its_reason(verb, content_type, body, status, reason):
    keys = deque()
    page = asyncio.run(_Keyboard(keys).answer(verb, content_type, body, Holder("")))
    assert page.status == status
    assert reason in json.loads(page.body)["message"]
    assert not keys


def test_the_page_is_small_and_complete():
    texts = {path.name: path.read_text(encoding="utf-8") for path in STATIC.iterdir()}
    assert sum(map(len, texts.values())) <= MOST_BYTES
    html = texts["index.html"]
    ids = set(re.findall(r'\bid="(\w+)"', html))
    code = "\n".join(text for name, text in texts.items() if name.endswith(".js"))
    assert set(re.findall(r'byId\("(\w+)"\)', code)) <= ids
    assert not re.search(r"<style|\sstyle=|\son\w+=|javascript:", html)
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|\beval\(", code)
    assert set(re.findall(r'data-key="(\w+)"', html)) <= KEYS
    assert set(re.search(r'LETTERS = "(\w+)"', code)[1]) == {key for key in KEYS if len(key) == 1}
