"""The web server over real sockets: pages, refusals, TLS, and silent connections."""

import asyncio
import contextlib
import re
import ssl

import aiohttp
import pytest
import trustme

import taskrpc
from taskrpc.metrics import CONTENT_TYPE
from taskrpc.tasks import MemoryStore, TaskServer
from taskrpc.web import Page, WebServer, server, task_pages
from tests.taskrpc.metrics.exposition import read
from tests.taskrpc.tasks.fakes import LineRobot

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
    assert (status, text) == (500, "this page cannot be shown; see the server's log\n")
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
    for _ in range(4 * server.MAX_CONNECTIONS):
        _, writer = await asyncio.open_connection(host, int(port))
        writer.write(unfinished)
        unfinished_ones.append(writer)
    status, _, text = await fetch(f"{web.url}/hello")
    assert (status, text) == (200, "hello\n")
    for writer in unfinished_ones:
        writer.close()


async def test_page_in_progress_is_not_closed_for_new_connections(monkeypatch):
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 2)
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
        with contextlib.suppress(ConnectionResetError):
            assert await first.read() == b""
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
    with pytest.raises(taskrpc.CannotListen, match=r"a certificate \(tls\) and a token are needed"):
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
