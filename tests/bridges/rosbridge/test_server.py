"""rosbridge over real WebSockets: who may connect, huge messages, clients that do not read."""

import asyncio
import json
from socket import create_server

import aiohttp
import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
import taskrpc
from taskrpc.bridges.rosbridge import protocol, server
from taskrpc.bridges.rosbridge.server import RosbridgeServer, _ClientConnection
from taskrpc.bridges.rosbridge.session import Bridge
from taskrpc.observe.web import Page, WebServer
from taskrpc.testing import VirtualTimeLoop

pytestmark = pytest.mark.real_time

TEXT = srvgen.load("std_msgs/msg/String")
TRIGGER = srvgen.load("std_srvs/srv/Trigger")
ORIGIN = "https://lab.example:8443"


async def hello():
    return Page("hello\n")


@pytest.fixture
async def web():
    async with taskrpc.Node("bridge", transport="memory") as node:
        rosbridge = RosbridgeServer(node)
        pages = {"/": hello}
        upgrade = rosbridge.handle
        web = WebServer(pages, listen="127.0.0.1:0", upgrade=upgrade, origins=[ORIGIN])
        async with web:
            yield web
            await rosbridge.close()


@pytest.fixture
async def http():
    async with aiohttp.ClientSession() as session:
        yield session


async def call(socket, service):
    await socket.send_json({"op": "call_service", "service": service})
    return await asyncio.wait_for(socket.receive_json(), 60)


async def test_page_and_websocket_share_an_address(web, http):
    async with http.get(web.url) as response:
        assert await response.text() == "hello\n"
    async with http.ws_connect(web.url) as socket:
        assert (await call(socket, "/rosapi/nodes"))["values"] == {"nodes": ["/bridge"]}


async def test_operation_in_a_binary_message_is_understood(web, http):
    async with http.ws_connect(web.url) as socket:
        await socket.send_bytes(b'{"op": "call_service", "service": "/rosapi/nodes"}')
        assert (await socket.receive_json())["result"] is True


async def flood(socket, service):
    while True:
        await socket.send_json({"op": "call_service", "service": service})
        await asyncio.sleep(0.001)


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        ("http://localhost:{port}", True),
        ("http://127.0.0.1:{port}", True),
        (ORIGIN, True),
        ("https://lab.example", False),
        ("http://evil.example", False),
        ("null", False),
        ("http://localhost.evil.example", False),
    ],
)
async def test_pages_of_other_machines_may_not_connect(web, http, origin, accepted):
    with create_server(("127.0.0.1", 0)) as serving:  # the page's own server
        headers = {"Origin": origin.format(port=serving.getsockname()[1])}
        if accepted:
            async with http.ws_connect(web.url, headers=headers) as socket:
                assert (await call(socket, "/rosapi/nodes"))["result"] is True
        else:
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await http.ws_connect(web.url, headers=headers)


async def test_websocket_under_another_host_name_is_refused(web, http):
    with pytest.raises(aiohttp.WSServerHandshakeError, match="421"):
        await http.ws_connect(web.url, headers={"Host": "evil.example"})


async def test_request_without_a_key_is_no_websocket(web, http):
    async with http.get(web.url, headers={"Upgrade": "websocket"}) as response:
        assert response.status == 400


async def test_long_message_gets_an_error_and_a_huge_one_ends_only_its_connection(
    web, http, monkeypatch
):
    monkeypatch.setattr(protocol, "MAX_MESSAGE", 100_000)
    monkeypatch.setattr(server, "_RECEIVE_LIMIT", 200_000)
    async with http.ws_connect(web.url) as other, http.ws_connect(web.url) as socket:
        await socket.send_str("x" * 150_000)
        status = await asyncio.wait_for(socket.receive_json(), 60)
        assert status["msg"] == "expected at most 100000 bytes, got 150000"
        assert (await call(socket, "/rosapi/nodes"))["result"] is True
        await socket.send_str("x" * 250_000)
        assert (await asyncio.wait_for(socket.receive(), 60)).type is aiohttp.WSMsgType.CLOSE
        assert socket.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
        assert (await call(other, "/rosapi/nodes"))["result"] is True


async def test_one_client_too_many_is_refused(web, http, monkeypatch):
    monkeypatch.setattr(server, "MAX_CLIENTS", 1)
    async with http.ws_connect(web.url) as socket:
        await call(socket, "/rosapi/nodes")
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503") as refused:
            await http.ws_connect(web.url)
    headers = refused.value.headers
    assert headers["Server"] == "taskrpc"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Connection"] == "close"


async def test_client_that_does_not_read_loses_only_its_own_connection(
    web, http, monkeypatch, caplog
):
    monkeypatch.setattr(server, "_MAX_UNREAD", 1_000_000)

    def tell(request, response):
        response.message = "x" * 100_000
        return response

    async with taskrpc.Node("program", transport="memory") as node:
        node.create_service(TRIGGER, "/tell", tell)
        async with http.ws_connect(web.url) as other, http.ws_connect(web.url) as slow:
            slow._conn.transport.pause_reading()
            with pytest.raises(ConnectionError):
                await flood(slow, "/tell")
            assert (await call(other, "/tell"))["result"] is True
    assert "it does not read its messages" in caplog.text


async def test_slow_subscriber_gets_the_newest_message_when_it_reads_again(web, http, monkeypatch):
    monkeypatch.setattr(server, "_BEHIND", 100_000)
    async with taskrpc.Node("program", transport="memory") as node:
        publisher = node.create_publisher(TEXT, "/chatter", 1000)
        async with http.ws_connect(web.url) as socket:
            await socket.send_json({"op": "subscribe", "topic": "/chatter"})
            while not publisher.get_subscription_count():
                await asyncio.sleep(0.01)
            socket._conn.transport.pause_reading()
            for number in range(300):
                publisher.publish(TEXT(data=f"{number} {'x' * 100_000}"))
                await asyncio.sleep(0)
            socket._conn.transport.resume_reading()
            last = ""
            while not last.startswith("299 "):
                last = (await asyncio.wait_for(socket.receive_json(), 60))["msg"]["data"]


async def test_ending_server_sends_a_close_frame_to_each_client_also_if_one_does_not_read(http):
    def tell(request, response):
        response.message = "x" * 8_000_000
        return response

    async with taskrpc.Node("bridge", transport="memory") as node:
        node.create_service(TRIGGER, "/tell", tell)
        rosbridge = RosbridgeServer(node)
        async with WebServer({}, listen="127.0.0.1:0", upgrade=rosbridge.handle) as web:
            socket, slow = [await http.ws_connect(web.url, max_msg_size=0) for _ in range(2)]
            await call(socket, "/rosapi/nodes")
            slow._conn.transport.pause_reading()
            await slow.send_json({"op": "call_service", "service": "/tell"})
            await call(socket, "/tell")
            ending = asyncio.ensure_future(rosbridge.close())
            message = await asyncio.wait_for(socket.receive(), 60)
            assert message.type is aiohttp.WSMsgType.CLOSE
            assert message.data == aiohttp.WSCloseCode.GOING_AWAY
            assert message.extra == "the server is ending"
            await asyncio.wait_for(ending, 60)
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await http.ws_connect(web.url)


@pytest.mark.parametrize("calls", [1, 200])
async def test_calls_in_flight_get_a_response_before_the_close_frame(http, calls):
    begun = []

    async def slow(request, response):
        begun.append(request)
        await asyncio.Event().wait()

    async with taskrpc.Node("bridge", transport="memory") as node:
        node.create_service(TRIGGER, "/slow", slow, concurrency=calls)
        rosbridge = RosbridgeServer(node)
        serving = WebServer({}, listen="127.0.0.1:0", upgrade=rosbridge.handle)
        async with serving as web, http.ws_connect(web.url) as socket:
            for number in range(calls):
                await socket.send_json(
                    {"op": "call_service", "service": "/slow", "id": str(number)}
                )
            while len(begun) < calls:
                await asyncio.sleep(0.01)
            ending = asyncio.ensure_future(rosbridge.close())
            got = [await asyncio.wait_for(socket.receive_json(), 60) for _ in range(calls)]
            assert {each["id"] for each in got} == {str(number) for number in range(calls)}
            assert {(each["result"], each["values"]) for each in got} == {
                (False, "OutcomeUnknown: the gateway ends; the call may have run")
            }
            last = await asyncio.wait_for(socket.receive(), 60)
            assert (last.type, last.extra) == (aiohttp.WSMsgType.CLOSE, "the server is ending")
            await ending


async def test_text_of_any_client_is_valid_json(web, http):
    async with http.ws_connect(web.url) as socket:
        await socket.send_str('{"op": "\\u2028", "id": "\\u2028"}')
        received = await socket.receive()
        assert json.loads(received.data)["id"] == "\u2028"


@pytest.mark.parametrize(("token", "accepted"), [("own", True), ("of an account", False)])
async def test_token_of_an_account_does_not_give_the_rights_of_the_node(http, token, accepted):
    async with taskrpc.Node("bridge", transport="memory") as node:
        rosbridge = RosbridgeServer(node, may_connect=lambda given: given == "own")
        async with WebServer({}, listen="127.0.0.1:0", upgrade=rosbridge.handle) as web:
            headers = {"Authorization": f"Bearer {token}"}
            if accepted:
                async with http.ws_connect(web.url, headers=headers) as socket:
                    assert (await call(socket, "/rosapi/nodes"))["result"] is True
            else:
                with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                    await http.ws_connect(web.url, headers=headers)


class Pipe:
    """A WebSocket, its request and its transport in one; the test decides what waits unread."""

    remote = "a test"

    def __init__(self):
        self.transport = self
        self.sent = []
        self.unread = 0
        self.can_write = asyncio.Event()
        self.can_write.set()

    def get_extra_info(self, name):
        return None

    def get_write_buffer_size(self):
        return self.unread

    async def send_str(self, text):
        self.sent.append(text)
        await self.can_write.wait()


def in_virtual_time(coroutine):
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(coroutine)


def test_text_is_written_without_a_turn_of_the_event_loop_if_nothing_waits():
    async def run():
        async with taskrpc.Node("bridge", transport="memory") as node:
            pipe = Pipe()
            client = _ClientConnection(pipe, pipe, Bridge(node))
            client._send("short")
            assert pipe.sent == ["short"]
            client._send("x" * 16_001)
            client._send("after a long text")
            pipe.unread = 1
            client._send("the client does not read")
            assert pipe.sent == ["short"]
            writer = asyncio.ensure_future(client._write())
            await asyncio.sleep(1)
            assert len(pipe.sent) == 4
            writer.cancel()

    in_virtual_time(run())


STEPS = st.one_of(
    st.integers(0, 40_000),  # sends a text of this length
    st.sampled_from(["blocked", "free", "unread", "read", "turn"]),
)


@given(st.lists(STEPS, max_size=40))
def test_texts_are_written_in_order_whatever_the_client_reads(steps):
    async def run():
        async with taskrpc.Node("bridge", transport="memory") as node:
            pipe = Pipe()
            client = _ClientConnection(pipe, pipe, Bridge(node))
            writer = asyncio.ensure_future(client._write())
            expected = []
            for step in steps:
                if step in ("blocked", "free"):
                    pipe.can_write.clear() if step == "blocked" else pipe.can_write.set()
                elif step in ("unread", "read"):
                    pipe.unread = int(step == "unread")
                elif step == "turn":
                    await asyncio.sleep(0)
                else:
                    expected.append(f"{len(expected)} {'x' * step}")
                    client._send(expected[-1])
                assert pipe.sent == expected[: len(pipe.sent)]
            pipe.can_write.set()
            await asyncio.sleep(1)
            assert pipe.sent == expected
            writer.cancel()

    in_virtual_time(run())
