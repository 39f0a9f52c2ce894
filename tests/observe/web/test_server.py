"""The web server over real sockets: pages, refusals, TLS, and silent connections."""

import asyncio
import contextlib
import json
import re
import socket
import ssl
import struct
import sys

import aiohttp
import pytest
import trustme

import taskrpc
from taskrpc.observe.metrics import CONTENT_TYPE
from taskrpc.observe.web import Page, open_connections, server, streams, task_pages
from taskrpc.observe.web.control import Control
from taskrpc.observe.web.live import Live
from taskrpc.observe.web.pages import static_files
from taskrpc.observe.web.server import LivePage, WebServer
from taskrpc.observe.web.streams import LiveStream
from taskrpc.observe.web.tokens import Tokens
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.robot.tasks.services.offered_tasks import load_types
from tests.observe.metrics.exposition import read
from tests.observe.web.test_streams import read as read_events
from tests.robot.tasks.fakes import LineRobot

pytestmark = pytest.mark.real_time


async def hello():
    return Page("hello\n")


@pytest.fixture
async def web():
    async with WebServer({"/hello": hello}, listen="127.0.0.1:0") as made:
        yield made


async def fetch(url, *, method="GET", **options):
    async with aiohttp.request(method, url, **options) as response:
        return response.status, response.headers, await response.text()


async def raw(web, data):
    """What comes back for these bytes, up to the end of the connection."""
    host, _, port = web.url.rpartition("/")[2].rpartition(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(data)
    try:
        return await asyncio.wait_for(reader.read(), 60)
    finally:
        writer.close()


async def test_page_is_shown_and_not_cached(web):
    status, headers, text = await fetch(f"{web.url}/hello")
    assert (status, text) == (200, "hello\n")
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Server"] == "taskrpc"


async def test_no_response_allows_pages_of_other_servers(web):
    for options in ({}, {"headers": {"Origin": "http://evil.example"}}, {"method": "OPTIONS"}):
        _, headers, _ = await fetch(f"{web.url}/hello", **options)
        assert not [name for name in headers if name.lower().startswith("access-control")]


async def test_head_has_the_same_headers_and_no_body(web):
    status, headers, text = await fetch(f"{web.url}/hello", method="HEAD")
    assert (status, headers["Content-Length"], text) == (200, "6", "")


async def test_unknown_path_gets_a_list_of_the_pages(web):
    status, _, text = await fetch(f"{web.url}/")
    assert (status, text) == (404, "no such page; there are /hello\n")


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"GET /hello HTTP/1.1\r\nHost: evil.example\r\n\r\n", b"421"),
        (b"GET /hello HTTP/1.1\r\n\r\n", b"400"),
        (b"POST /hello HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n123456789", b"405"),
        (b"\x16\x03\x01 this is TLS\r\n\r\n", b"400"),
    ],
)
async def test_refused_request_gets_a_status_and_the_connection_is_closed(web, head, status):
    answer = await raw(web, head)
    assert answer.startswith((b"HTTP/1.1 " + status, b"HTTP/1.0 " + status))
    assert b"hello" not in answer.partition(b"\r\n\r\n")[2]
    assert b"Traceback" not in answer


async def test_failed_page_shows_no_internals(caplog):
    async def broken():
        raise OSError("/home/secret")

    async with WebServer({"/broken": broken}, listen="127.0.0.1:0") as web:
        status, headers, text = await fetch(f"{web.url}/broken")
    assert (status, text) == (500, "the server could not make this page; see its log\n")
    assert headers["Server"] == "taskrpc"
    assert "OSError: /home/secret" in caplog.text


async def test_silent_connection_is_closed(web, monkeypatch):
    monkeypatch.setattr(server, "REQUEST_TIMEOUT", 0.1)
    assert await raw(web, b"GET /hello HTTP/1.1\r\nHo") == b""


@pytest.mark.parametrize(
    "unfinished",
    [
        b"",
        b"GET /hello HTTP/1.1\r\nHo",
        b"POST /hello HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n1",
    ],
)
async def test_hundreds_of_unfinished_requests_do_not_delay_a_page(web, unfinished, monkeypatch):
    monkeypatch.setattr(server, "REQUEST_TIMEOUT", 1_000)
    host, _, port = web.url.rpartition("/")[2].rpartition(":")
    unfinished_ones = []
    for _ in range(2 * open_connections.MAX_UNFINISHED):
        _, writer = await asyncio.open_connection(host, int(port))
        writer.write(unfinished)
        unfinished_ones.append(writer)
    status, _, text = await fetch(f"{web.url}/hello")
    assert (status, text) == (200, "hello\n")
    for writer in unfinished_ones:
        writer.close()


async def test_page_in_progress_is_not_closed_for_new_connections(monkeypatch):
    monkeypatch.setattr(open_connections, "MAX_CONNECTIONS", 1)
    monkeypatch.setattr(open_connections, "MAX_UNFINISHED", 1)
    asked, go_on = asyncio.Event(), asyncio.Event()

    async def slow():
        asked.set()
        await go_on.wait()
        return Page("slow\n")

    async with WebServer({"/slow": slow}, listen="127.0.0.1:0") as web:
        host, _, port = web.url.rpartition("/")[2].rpartition(":")
        head = f"GET /slow HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n"
        fetching = asyncio.create_task(raw(web, head.encode()))
        await asked.wait()
        first, first_writer = await asyncio.open_connection(host, int(port))
        _, second_writer = await asyncio.open_connection(host, int(port))
        assert (await first.read()).startswith(b"HTTP/1.1 503 Service Unavailable\r\n")
        go_on.set()
        assert (await fetching).endswith(b"\r\n\r\nslow\n")
        first_writer.close()
        second_writer.close()


MALFORMED = [
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\nA B: c\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
    b"GET / HTTP/1.1\r\nX: " + b"a" * 20_000 + b"\r\n\r\n",
    b"GET http://[ HTTP/1.1\r\nHost: x\r\n\r\n",
    bytes(100),
]


async def test_malformed_requests_get_400_and_one_log_line_together(web, caplog):
    for data in MALFORMED:
        assert (await raw(web, data)).startswith(b"HTTP/1.0 400 Bad Request")
    [line] = caplog.records
    assert re.fullmatch(
        r"refused a request from 127\.0\.0\.1:\d+: it is not valid HTTP \(\w+\)", line.getMessage()
    )
    assert line.exc_info is None


async def test_a_body_that_cannot_be_decoded_logs_no_traceback(web, caplog):
    head = b"POST /hello HTTP/1.1\r\nHost: x\r\nContent-Encoding: gzip\r\nContent-Length: 9\r\n\r\n"
    assert (await raw(web, head + b"no gzip!!")).startswith(b"HTTP/1.1 405")
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1"])
@pytest.mark.parametrize("secret", [None, "token".__eq__])
def test_without_tls_and_a_token_it_listens_on_this_machine_only(host, secret):
    with pytest.raises(taskrpc.CannotListen, match="without a certificate and a token"):
        WebServer({}, listen=f"{host}:0", may_look=secret)


async def test_address_in_use_is_reported(web):
    taken = web.url.removeprefix("http://")
    with pytest.raises(taskrpc.CannotListen, match="cannot listen at"):
        await WebServer({}, listen=taken).start()


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


@pytest.fixture
def tls(authority, tmp_path):
    issued = authority.issue_cert("127.0.0.1", "localhost")
    issued.private_key_pem.write_to_path(tmp_path / "key.pem")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
    return taskrpc.Tls(cert=tmp_path / "cert.pem", key=tmp_path / "key.pem")


async def test_server_on_the_network_needs_tls_and_a_token(authority, tls):
    trusting = ssl.create_default_context()
    authority.configure_trust(trusting)
    pages, may_look = {"/hello": hello}, "secret".__eq__
    async with WebServer(pages, listen="0.0.0.0:0", tls=tls, may_look=may_look) as web:
        url = web.url.replace("0.0.0.0", "127.0.0.1")
        assert url.startswith("https://")
        status, headers, _ = await fetch(f"{url}/hello", ssl=trusting)
        assert (status, headers["WWW-Authenticate"]) == (401, "Bearer")
        secret = {"Authorization": "Bearer secret"}
        status, _, text = await fetch(f"{url}/hello", ssl=trusting, headers=secret)
        assert (status, text) == (200, "hello\n")
        with pytest.raises(aiohttp.ClientError):
            await fetch(f"{url.replace('https', 'http')}/hello", headers=secret)


async def test_the_pages_of_a_task_server_are_its_health_and_its_metrics():
    metrics = taskrpc.Metrics()
    async with taskrpc.Node("task_server", transport="memory", observer=metrics) as node:
        tasks = TaskServer(node, LineRobot(), MemoryStore())
        async with WebServer(task_pages(tasks, metrics), listen="127.0.0.1:0") as web:
            status, headers, text = await fetch(f"{web.url}/health")
            assert (status, headers["Content-Type"]) == (503, "application/json")
            assert text.startswith('{"ready": false, "message": "not ready: starting')
            await tasks.start()
            status, _, text = await fetch(f"{web.url}/health")
            told = '{"ready": true, "message": "ready: no tasks in the queue"}\n'
            assert (status, text) == (200, told)
            status, headers, text = await fetch(f"{web.url}/metrics")
            assert (status, headers["Content-Type"]) == (200, CONTENT_TYPE)
            assert "taskrpc_calls_running" in read(text)
            tasks.dismiss_watchers()
            status, _, text = await fetch(f"{web.url}/health")
            assert (status, text) == (503, '{"ready": false, "message": "not ready: ending"}\n')
        await tasks.close()


# The live page


class Shown:
    """A task server in memory with a live page at a real socket."""

    def __init__(self, folder, **options):
        self.folder = folder
        self.options = options
        self.tokens = Tokens()
        self.stream = LiveStream()

    async def __aenter__(self):
        self.node = taskrpc.Node("task_server", transport="memory")
        await self.node.start()
        self.tasks = TaskServer(self.node, LineRobot(), MemoryStore())
        await self.tasks.start()
        self.live = LivePage(
            static_files(self.folder),
            self.tokens,
            self.stream,
            Live(self.tasks.manager, self.stream, lambda: {"node": "/task_server"}),
            Control(load_types(), lambda _: taskrpc.Node("web_page", transport="memory")),
        )
        pages = task_pages(self.tasks, taskrpc.Metrics())
        options = {"listen": "127.0.0.1:0", **self.options}
        self.web = WebServer(pages, live=self.live, **options)
        await self.web.start()
        self.url = self.web.url
        return self

    async def __aexit__(self, *_):
        await self.web.close()
        await self.tasks.close()
        await self.node.destroy()

    def bearer(self, token):
        return {"Authorization": f"Bearer {token}"}

    async def post(self, verb, body="{}", token=None, **headers):
        headers = {"Content-Type": "application/json", **headers}
        headers |= self.bearer(self.tokens.control if token is None else token)
        url = f"{self.url}/control/{verb}"
        return await fetch(url, method="POST", data=body, headers=headers)


@pytest.fixture
def folder(tmp_path):
    static = tmp_path / "static"
    (static / "js").mkdir(parents=True)
    (static / "index.html").write_text("<!doctype html>", encoding="utf-8")
    (static / "js" / "map.js").write_text("export const x = 1;", encoding="utf-8")
    (static / "notes.secret").write_text("secret", encoding="utf-8")
    (tmp_path / "secret.js").write_text("secret", encoding="utf-8")
    return static


@pytest.fixture
async def page(folder):
    async with Shown(folder) as made:
        yield made


async def test_page_and_its_files_are_served_with_the_security_policy(page):
    status, headers, text = await fetch(f"{page.url}/")
    assert (status, text) == (200, "<!doctype html>")
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert headers["Content-Security-Policy"] == (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
        " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    status, headers, text = await fetch(f"{page.url}/js/map.js")
    assert (status, text) == (200, "export const x = 1;")
    assert headers["Content-Type"] == "text/javascript; charset=utf-8"


async def test_file_is_compressed_for_clients_that_accept_it(page):
    for accepted, encoding in (("gzip", "gzip"), ("identity", None)):
        head = {"Accept-Encoding": accepted}
        status, headers, text = await fetch(f"{page.url}/js/map.js", headers=head)
        assert (status, text) == (200, "export const x = 1;")
        assert (headers.get("Content-Encoding"), headers["Vary"]) == (encoding, "Accept-Encoding")


async def test_browser_that_has_a_file_gets_no_body(page):
    _, headers, _ = await fetch(f"{page.url}/js/map.js")
    known = {"If-None-Match": f'"other", W/{headers["ETag"]}'}
    status, again, text = await fetch(f"{page.url}/js/map.js", headers=known)
    assert (status, text, again["ETag"]) == (304, "", headers["ETag"])
    status, _, text = await fetch(f"{page.url}/js/map.js", headers={"If-None-Match": "x"})
    assert (status, text) == (200, "export const x = 1;")


@pytest.mark.parametrize(
    "path",
    [
        "/js",
        "/js/",
        "/notes.secret",
        "/../secret.js",
        "/js/../../secret.js",
        "/%2e%2e/secret.js",
        "/..%2fsecret.js",
        "//etc/passwd",
        "/js/map.js/",
        "/js\\map.js",
        "/js/map.js%00",
        "/index.html",
    ],
)
async def test_only_the_files_of_the_page_are_served(page, path):
    host = page.url.removeprefix("http://")
    answer = await raw(page.web, f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    assert answer.startswith((b"HTTP/1.1 404", b"HTTP/1.0 400"))
    assert b"secret" not in answer


async def next_events(response, *names):
    """The newest event of each name, once all names have come."""
    found, text = {}, b""
    async with asyncio.timeout(30):
        async for data in response.content.iter_any():
            text += data
            *whole, text = text.split(b"\n\n")
            found |= dict(read_events(b"".join(each + b"\n\n" for each in whole)))
            if found.keys() >= set(names):
                break
    return found


async def test_stream_shows_changes_and_the_end_of_the_server(page):
    async with aiohttp.request("GET", f"{page.url}/live") as response:
        assert response.status == 200
        assert response.headers["Content-Type"] == "text/event-stream"
        found = await next_events(response, "hello", "tasks", "robot", "path")
        assert found["hello"]["control"] is False
        body = json.dumps({"task_type": "move", "target": "100", "priority": 5})
        status, _, text = await page.post("submit", body)
        assert (status, json.loads(text)["task_id"]) == (200, 1)
        found = await next_events(response, "tasks")
        assert [task["task_id"] for task in found["tasks"]["queue"] or [found["tasks"]["running"]]]
        closing = asyncio.create_task(page.web.close())
        found = await next_events(response, "ending")
        assert found["ending"] == {"reason": "the server is ending"}
        await closing
    assert not len(page.stream)


async def test_hello_says_whether_the_token_allows_control(page):
    for token, control in ((page.tokens.control, True), (page.tokens.view, False)):
        headers = page.bearer(token)
        async with aiohttp.request("GET", f"{page.url}/live", headers=headers) as response:
            found = await next_events(response, "hello")
            assert found["hello"]["control"] is control


async def test_control_without_its_token_changes_nothing(page):
    for token in ("", "x", page.tokens.view):
        status, _, text = await page.post("pause", token=token)
        assert (status, json.loads(text)["error"]) == (401, "AuthenticationFailed")
    for expected, (status, _, text) in (
        (403, await page.post("pause", Origin="http://evil.example")),
        (421, await page.post("pause", Host="evil.example")),
        (405, await fetch(f"{page.url}/control/pause")),
    ):
        assert status == expected
        assert json.loads(text).keys() == {"error", "message"}
    assert not page.tasks.manager.is_paused
    assert (await page.post("pause"))[0] == 200
    assert page.tasks.manager.is_paused


async def test_body_that_cannot_be_decoded_is_refused_with_json(page, caplog):
    headers = {"Content-Encoding": "gzip", "Content-Length": "8"}
    status, _, text = await page.post("pause", b"no gzip!", **headers)
    assert status == 400
    assert json.loads(text)["error"] == "RequestError"
    assert "Traceback" not in caplog.text
    assert not page.tasks.manager.is_paused


async def test_too_long_request_of_control_is_refused(page):
    status, _, text = await page.post("submit", " " * 100_000)
    assert status == 400
    assert "at most 65536 bytes" in text


async def test_one_task_is_served_as_json(page):
    await page.tasks.manager.submit("move", "1", 5)
    status, headers, text = await fetch(f"{page.url}/task/1")
    assert (status, headers["Content-Type"]) == (200, "application/json")
    assert json.loads(text)["task_id"] == 1
    for number in ("2", "x", "", "1/2", "-1", "²", "9" * 30):
        status, _, text = await fetch(f"{page.url}/task/{number}")
        assert (status, json.loads(text)["error"]) == (404, "NotFound")


async def test_64_pages_get_the_same_events_and_health_still_answers(page):
    async with (
        contextlib.AsyncExitStack() as stack,
        aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0)) as session,
    ):
        tabs = [await stack.enter_async_context(session.get(f"{page.url}/live")) for _ in range(64)]
        for tab in tabs:
            await next_events(tab, "hello", "tasks")
        await page.tasks.manager.submit("move", "1", 5)
        for tab in tabs:
            found = await next_events(tab, "tasks")
            assert found["tasks"]["revision"] > 0
        assert (await fetch(f"{page.url}/health"))[0] == 200
        assert len(page.stream) == 64


@pytest.mark.faults
async def test_each_of_190_pages_that_open_at_one_instant_gets_its_events_or_a_503(
    page, monkeypatch
):
    # A busy machine opens 190 connections slowly.
    monkeypatch.setattr(open_connections, "TIME_TO_ASK", 60.0)
    monkeypatch.setattr(server, "REQUEST_TIMEOUT", 60.0)
    host, _, port = page.url.rpartition("/")[2].rpartition(":")
    request = f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode()
    calling = [await asyncio.open_connection(host, int(port)) for _ in range(170)]
    calling += await asyncio.gather(*(asyncio.open_connection(host, int(port)) for _ in range(20)))
    try:
        for _, writer in calling:
            writer.write(request)
        heads = [await reader.readuntil(b"\r\n\r\n") for reader, _ in calling]
    finally:
        for _, writer in calling:
            writer.close()
    shown = [head for head in heads if head.startswith(b"HTTP/1.1 200 OK\r\n")]
    refused = [head for head in heads if head.startswith(b"HTTP/1.1 503 Service Unavailable\r\n")]
    assert len(shown) == streams.MAX_TABS
    assert len(refused) == len(calling) - streams.MAX_TABS
    assert all(b"\r\nRetry-After: 5\r\n" in head for head in refused)


async def test_request_above_the_limit_gets_status_503(monkeypatch):
    monkeypatch.setattr(open_connections, "MAX_ANSWERED", 1)
    asked, go_on = asyncio.Event(), asyncio.Event()

    async def slow():
        asked.set()
        await go_on.wait()
        return Page("slow\n")

    async with WebServer({"/slow": slow}, listen="127.0.0.1:0") as web:
        fetching = asyncio.create_task(fetch(f"{web.url}/slow"))
        await asked.wait()
        status, headers, text = await fetch(f"{web.url}/slow")
        assert (status, headers["Retry-After"]) == (503, "5")
        assert text == "too many requests arrive at the same time; try again in some seconds\n"
        go_on.set()
        assert (await fetching)[2] == "slow\n"


async def test_page_above_the_limit_gets_status_503(page, monkeypatch):
    monkeypatch.setattr(streams, "MAX_TABS", 1)
    async with aiohttp.request("GET", f"{page.url}/live") as response:
        await next_events(response, "hello")
        status, headers, text = await fetch(f"{page.url}/live")
        problem = "too many live pages are open; close some of them, then try again\n"
        assert (status, headers["Retry-After"], text) == (503, "5", problem)


async def test_image_of_another_page_takes_no_place_of_a_live_page(page, monkeypatch):
    monkeypatch.setattr(streams, "MAX_TABS", 1)
    image = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    async with aiohttp.request("GET", f"{page.url}/live", headers=image) as refused:
        async with aiohttp.request("GET", f"{page.url}/live") as response:
            assert (refused.status, response.status) == (403, 200)
        text = await refused.text()
    assert text == (
        "expected a request from a page of this server,"
        " got one from another page (Sec-Fetch-Site: cross-site)\n"
    )


async def test_link_of_another_page_opens_the_live_page(page):
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    for path in ("/", "/health"):
        assert (await fetch(f"{page.url}{path}", headers=link))[0] == 200


async def test_pages_that_are_reset_at_once_leave_nothing_and_log_no_traceback(page, caplog):
    host, _, port = page.url.rpartition("/")[2].rpartition(":")
    request = f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode()
    for _ in range(20):
        calling = socket.create_connection((host, int(port)))
        calling.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        calling.sendall(request)
        calling.close()  # sends a reset
        await asyncio.sleep(0.01)
    async with asyncio.timeout(30):
        while len(page.stream):
            await asyncio.sleep(0.01)
    assert (await fetch(f"{page.url}/health"))[0] == 200
    assert "Traceback" not in caplog.text
    assert "Error handling request" not in caplog.text


async def test_page_stays_open_longer_than_a_request_may_take(folder, monkeypatch):
    monkeypatch.setattr(server, "REQUEST_TIMEOUT", 0.05)
    monkeypatch.setattr(streams, "SIGN_OF_LIFE", 0.1)
    async with Shown(folder) as page, aiohttp.request("GET", f"{page.url}/live") as response:
        text = b""
        while text.count(b":\n\n") < 2:
            text += await response.content.readany()


async def test_page_that_does_not_read_is_closed_and_holds_few_bytes(folder, monkeypatch):
    monkeypatch.setattr(streams, "SIGN_OF_LIFE", 0.05)
    monkeypatch.setattr(streams, "MAX_UNREAD_SECONDS", 0.2)
    async with Shown(folder) as page:
        host, _, port = page.url.rpartition("/")[2].rpartition(":")
        _, writer = await asyncio.open_connection(host, int(port), limit=1024)
        writer.write(f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        while not len(page.stream):
            await asyncio.sleep(0.01)
        async with asyncio.timeout(30):
            while len(page.stream):
                page.stream.publish([streams.Event("robot", b'"%s"' % (b"x" * 50_000))])
                await asyncio.sleep(0.002)
        writer.close()


async def test_websocket_upgrade_at_the_root_is_passed_on(folder, caplog):
    async def echo(request):
        socket = aiohttp.web.WebSocketResponse()
        await socket.prepare(request)
        async for message in socket:
            await socket.send_str(message.data)
        return socket

    async with Shown(folder, upgrade=echo) as page, aiohttp.ClientSession() as session:
        async with session.ws_connect(f"{page.url}/", headers={"Origin": page.url}) as opened:
            await opened.send_str("hello")
            assert await opened.receive_str() == "hello"
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await session.ws_connect(page.url, headers={"Origin": "http://evil.example"})
        assert refused.value.status == 403
        assert "refused a WebSocket of 127.0.0.1: a page of another server may not" in caplog.text
        assert "--allow-origin http://evil.example" in caplog.text
        assert (await fetch(f"{page.url}/"))[2] == "<!doctype html>"


async def test_websocket_of_a_page_is_accepted_while_this_user_serves_the_page(folder):
    async def close(request):
        upgraded = aiohttp.web.WebSocketResponse()
        await upgraded.prepare(request)
        return upgraded

    async with Shown(folder, upgrade=close) as page, aiohttp.ClientSession() as session:
        with socket.create_server(("127.0.0.1", 0)) as serving:
            origin = {"Origin": f"http://localhost:{serving.getsockname()[1]}"}
            await session.ws_connect(page.url, headers=origin)
        if sys.platform == "linux":  # other systems do not show who serves a page
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await session.ws_connect(page.url, headers=origin)


async def test_request_in_progress_does_not_delay_the_end_of_the_server(folder):
    begun = asyncio.Event()

    async def wait(request):
        begun.set()
        await asyncio.Event().wait()

    async with aiohttp.ClientSession() as session:
        page = Shown(folder, upgrade=wait)
        await page.__aenter__()
        asking = asyncio.ensure_future(session.ws_connect(f"{page.url}/"))
        await asyncio.wait_for(begun.wait(), 60)
        await asyncio.wait_for(page.__aexit__(None, None, None), 5)
        with pytest.raises(aiohttp.ClientError):
            await asking


async def test_connection_of_a_refused_websocket_is_closed(folder):
    async def refuse(request):
        return aiohttp.web.Response(status=503, text="too many")

    async with Shown(folder, upgrade=refuse) as page, aiohttp.ClientSession() as session:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await session.ws_connect(f"{page.url}/")
        assert refused.value.headers["Connection"] == "close"


async def test_connection_of_another_user_sees_only_files_and_health(page, monkeypatch):
    monkeypatch.setattr(server, "is_other_user", lambda peer, local: True)
    for path, expected in (("/", 200), ("/health", 200), ("/live", 401), ("/task/1", 401)):
        for headers in ({}, page.bearer(page.tokens.control)):
            assert (await fetch(f"{page.url}{path}", headers=headers))[0] == expected
    assert (await page.post("pause"))[0] == 401


class Recorded:
    """A recording of many large parts, which notes how many were taken."""

    def __init__(self):
        self.taken = 0

    def lines(self):
        for _ in range(200):
            self.taken += 1
            yield b"x" * 99_999 + b"\n"

    gzipped = lines

    def hello(self, *, control):
        return b""

    def task(self, task_id):
        return None


@pytest.fixture
async def recorded(tmp_path):
    made = Recorded()
    (tmp_path / "index.html").write_text("<p>page</p>")
    page = LivePage(static_files(tmp_path), Tokens(), LiveStream(), made, recording=made)
    async with WebServer({}, listen="127.0.0.1:0", live=page) as web:
        yield made, web


async def test_recording_is_sent_to_its_end(recorded):
    made, web = recorded
    status, headers, text = await fetch(f"{web.url}/recording", headers={"Accept-Encoding": ""})
    assert status == 200
    assert "Content-Encoding" not in headers
    assert headers["Cache-Control"] == "no-store"
    assert len(text) == made.taken * 100_000 == 20_000_000
    assert (await fetch(f"{web.url}/recording", method="HEAD"))[::2] == (200, "")


async def test_recording_that_is_not_read_takes_no_memory_and_is_given_up(recorded, monkeypatch):
    monkeypatch.setattr(server, "RECORDING_TIMEOUT", 0.2)
    made, web = recorded
    host, _, port = web.url.rpartition("/")[2].rpartition(":")
    with socket.create_connection((host, int(port))) as unread:
        unread.sendall(f"GET /recording HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        await asyncio.sleep(0.5)
        assert 0 < made.taken < 200


async def test_page_of_another_server_gets_no_recording(recorded):
    _, web = recorded
    status, _, _ = await fetch(f"{web.url}/recording", headers={"Origin": "http://evil.example"})
    assert status == 403


async def test_page_of_a_recording_has_nothing_to_control(recorded):
    _, web = recorded
    assert (await fetch(f"{web.url}/control/stop", method="POST"))[0] == 401
    assert (await fetch(f"{web.url}/task/1"))[0] == 404
    assert (await fetch(f"{web.url}/"))[0] == 200


async def test_server_without_a_recording_has_no_such_page(web):
    assert (await fetch(f"{web.url}/recording"))[0] == 404
