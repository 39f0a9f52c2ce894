"""roslib in a page of another server on this machine talks to the task server over rosbridge."""

from __future__ import annotations

import contextlib
import functools
import http.server
import threading
from pathlib import Path

import pytest

import srvgen
from taskrpc import sync
from tests.docs.markdown import read_page
from tests.javascript.packages import node_modules

_GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "use-rosbridge.md"
_CDN = "https://cdn.jsdelivr.net/npm/roslib@1"

# The old version is one script; the new one consists of modules with names as in Node.
_OLD = """<!doctype html><title>roslib 1</title><link rel="icon" href="data:,">
<script src="/roslib-1/build/roslib.min.js"></script>
<script>globalThis.lib = ROSLIB</script>"""
_NEW = """<!doctype html><title>roslib 2</title><link rel="icon" href="data:,">
<script type="importmap">{"imports": {
    "roslib": "/roslib/dist/RosLib.js",
    "@cto.af/wtf8": "/@cto.af/wtf8/lib/index.js",
    "bson": "/bson/lib/bson.mjs",
    "cbor2": "/cbor2/lib/index.js",
    "eventemitter3": "/eventemitter3/dist/eventemitter3.esm.js",
    "fast-png": "/fast-png/lib/index.js",
    "fflate": "/fflate/esm/browser.js",
    "iobuffer": "/iobuffer/lib/iobuffer.js",
    "uuid": "/uuid/dist/index.js",
    "ws": "/ws/browser.js"}}</script>
<script type="module">import * as lib from "roslib"; globalThis.lib = lib</script>"""
_CONNECT = """
globalThis.ros = new lib.Ros({url: args[0]});
await new Promise((done, failed) => { ros.on("connection", done); ros.on("error", failed); });
globalThis.service = (name, type) => new lib.Service({ros, name, serviceType: type});
globalThis.call = (name, type, request) => new Promise(
    (done, failed) => service(name, type).callService(request, done, failed));
globalThis.topic = (name, type) => new lib.Topic({ros, name, messageType: type});
"""


def _page_of_the_guide(place):
    """The page that the guide shows, with roslib from this server, for a gateway at `place`."""
    blocks = read_page(_GUIDE).blocks
    text = next(block.text for block in blocks if block.file == "page.html")
    assert _CDN in text
    text = text.replace("<title>", '<link rel="icon" href="data:,"><title>')
    return text.replace(_CDN, "/roslib-1").replace("127.0.0.1:9090", place)


class _Handler(http.server.SimpleHTTPRequestHandler):
    def do_GET(self):
        page = {"/1": _OLD, "/2": _NEW}.get(self.path)
        if self.path.startswith("/guide/"):
            page = _page_of_the_guide(self.path.removeprefix("/guide/"))
        if page is None:
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(page.encode())

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def other_server():
    """A web server at another port, with the pages and with roslib."""
    handler = functools.partial(_Handler, directory=str(node_modules()))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def server(start_for_module):
    """The task server of the pages that `tab` opens."""
    return start_for_module("--speed", "0.01")


@pytest.fixture(params=["1", "2"], ids=["roslib 1", "roslib 2"])
def tab(request, other_server, server, in_module_places, tabs):
    """A page of the other server that is connected to a task server."""
    tab = tabs.open(f"{other_server}/{request.param}")
    tab.wait(lambda: tab.run("return typeof lib === 'object'"), "roslib")
    tab.run_async(_CONNECT, server.url.replace("http", "ws"))
    yield tab
    with contextlib.suppress(RuntimeError):
        tab.run_async("ros.close()")


def test_page_submits_a_task(tab, services):
    response = tab.run_async(
        "return await call('/robot_task', 'my_robot_interfaces/srv/RobotTask', args[0])",
        {"task_type": "move", "target": "warehouse", "priority": 7},
    )
    assert response["success"] is True
    task = services.show(response["task_id"])
    assert (task.target, task.priority) == ("warehouse", 7)
    assert response["estimated_time"] == pytest.approx(task.accepted_estimate, rel=1e-3)


def test_failed_call_has_the_reason(tab):
    with pytest.raises(RuntimeError, match=r"no_such_service"):
        tab.run_async(
            "try { await call('/no_such_service', 'std_srvs/srv/Trigger', {}) }"
            " catch (error) { throw new Error(JSON.stringify(error.message ?? error)) }"
        )


def test_page_gets_messages_of_a_topic(tab, services):
    tab.run(
        "globalThis.got = [];"
        "topic('/robot_task/events', 'taskrpc_interfaces/msg/TaskEvents').subscribe("
        "    message => got.push(message))"
    )
    task_id = services.submit("move", "station_1")
    tab.wait(
        lambda: tab.run(
            "return got.some(message => JSON.stringify(message).includes(arguments[0]))",
            f'"task_id":{task_id},',
        ),
        f"an event of task {task_id}",
    )


def test_page_publishes_messages(tab):
    received = []
    string = srvgen.load("std_msgs/msg/String")
    with sync.Node("listener") as node:
        node.create_subscription(string, "/chatter", lambda message: received.append(message.data))
        tab.run(
            "globalThis.chatter = topic('/chatter', 'std_msgs/msg/String'); chatter.advertise()"
        )

        def heard():
            tab.run("chatter.publish({data: '<b>hello</b>'})")
            return received

        tab.wait(heard, "a message")
    assert set(received) == {"<b>hello</b>"}


def test_page_offers_a_service(tab):
    kind = srvgen.load("std_srvs/srv/SetBool")
    tab.run_async(
        "globalThis.offered = service('/from_the_page', 'std_srvs/srv/SetBool');"
        "offered.advertise((request, response) => {"
        "    response.success = request.data; response.message = 'a page'; return true; })"
    )
    with sync.Node("caller") as node:
        client = node.create_client(kind, "/from_the_page")
        assert client.wait_for_service(20)
        response = client.call(kind.Request(data=True), timeout=20)
        assert (response.success, response.message) == (True, "a page")


def test_page_lists_services_topics_and_nodes(tab):
    for what, expected in (
        ("getServices", "/robot_task/list"),
        ("getTopics", "/robot_task/events"),
        ("getNodes", "/task_server"),
    ):
        found = tab.run_async(f"return await new Promise((done, no) => ros.{what}(done, no))")
        names = found["topics"] if what == "getTopics" else found
        assert expected in names


def test_page_from_elsewhere_cannot_connect(start_server, tabs):
    server = start_server()
    tabs.expect("WebSocket", "ERR_")
    tab = tabs.open("data:text/html,<title>elsewhere</title>")  # its origin is `null`
    with pytest.raises(RuntimeError, match="refused"):
        tab.run_async(
            "await new Promise((done, failed) => { const socket = new WebSocket(args[0]);"
            " socket.onopen = done; socket.onerror = () => failed('refused'); })",
            server.url.replace("http", "ws"),
        )


def test_page_of_the_guide_submits_and_shows_messages_and_errors(other_server, start_server, tabs):
    server = start_server("--speed", "100")
    tab = tabs.open(f"{other_server}/guide/{server.url.split('/')[2]}")

    def logged(text):
        tab.wait(lambda: text in tab.run("return document.querySelector('#log').textContent"), text)

    logged("connected")
    tab.run("document.querySelector('#submit').click()")
    logged("Task queued: move")
    tab.run("document.querySelector('#send').click()")
    logged("chat: hello")
    tab.wait(
        lambda: ", " in tab.run("return document.querySelector('#pose').textContent"), "a position"
    )
    tab.run("chat.publish(new ROSLIB.Message({dta: 'hello'}))")
    logged("publish: dta: unknown field 'dta'; String has data")
