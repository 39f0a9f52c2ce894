"""The latency of a service call over rosbridge, beside aiohttp's own WebSocket echo.

    .venv/bin/python benchmarks/rosbridge_latency.py [--calls N] [--rounds N]

Three servers run in processes of their own: aiohttp's echo, `taskrpc bridge rosbridge`, and a
program that offers AddTwoInts. One aiohttp client calls in turn the echo (with the text of a call)
and the service over rosbridge, so that both see the same load of the machine. The result is the
median of each, and the median of the ratios of the rounds.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import aiohttp
from aiohttp import web

import srvgen
import taskrpc

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
CALL = json.dumps(
    {"op": "call_service", "id": "call", "service": "/add_two_ints", "args": {"a": 2, "b": 3}}
)
GOAL = 1.0
"""Milliseconds that the median call may take."""


async def echo() -> None:
    """Serve aiohttp's WebSocket echo; print the port."""

    async def handle(request: web.BaseRequest) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(compress=False)
        await socket.prepare(request)
        async for message in socket:
            await socket.send_str(message.data)
        return socket

    server = await asyncio.get_running_loop().create_server(web.Server(handle), "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


async def add() -> None:
    """Offer AddTwoInts."""

    def handler(request, response):
        response.sum = request.a + request.b
        return response

    async with taskrpc.Node("adder") as node:
        node.create_service(ADD, "/add_two_ints", handler)
        print("ready", flush=True)
        await node.spin()


async def round_of(socket: aiohttp.ClientWebSocketResponse, calls: int) -> list[float]:
    """Return the seconds of each of so many calls."""
    seconds = []
    for _ in range(calls):
        began = time.perf_counter()
        await socket.send_str(CALL)
        await socket.receive()
        seconds.append(time.perf_counter() - began)
    return seconds


async def measure(echo_url: str, bridge_url: str, calls: int, rounds: int) -> dict[str, float]:
    """Call both in turn; return medians in milliseconds, and the median ratio."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(echo_url) as plain,
        session.ws_connect(bridge_url) as bridge,
    ):
        await bridge.send_str(CALL)
        first = await bridge.receive_json()
        assert first["values"] == {"sum": 5}, first
        await round_of(plain, calls)
        await round_of(bridge, calls)
        found = [
            (await round_of(plain, calls), await round_of(bridge, calls)) for _ in range(rounds)
        ]
    medians = [(statistics.median(one), statistics.median(other)) for one, other in found]
    return {
        "echo_ms": 1000 * statistics.median(one for one, _ in medians),
        "rosbridge_ms": 1000 * statistics.median(other for _, other in medians),
        "ratio": statistics.median(other / one for one, other in medians),
    }


def started(*command: str) -> tuple[subprocess.Popen[str], str]:
    """Start a server; return it and the line that it prints when it is ready."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ
    )
    assert process.stdout is not None
    return process, process.stdout.readline().strip()


def main() -> int:
    """Measure, and print one line of JSON; the exit code is 1 if the goal is missed."""
    parser = argparse.ArgumentParser(description="Latency of service calls over rosbridge")
    parser.add_argument("--calls", type=int, default=500, help="calls in a round (500)")
    parser.add_argument("--rounds", type=int, default=7, help="rounds (7)")
    parser.add_argument("--serve", choices=["echo", "add"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        asyncio.run({"echo": echo, "add": add}[options.serve]())
        return 0
    processes = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        try:
            own = [sys.executable, __file__, "--serve"]
            adder, _ = started(*own, "add")
            processes.append(adder)
            plain, port = started(*own, "echo")
            processes.append(plain)
            command = [sys.executable, "-m", "taskrpc", "bridge", "rosbridge"]
            bridge, ready = started(*command, "--listen", "127.0.0.1:0")
            processes.append(bridge)
            place = ready.rpartition("//")[2]
            echo_url, bridge_url = f"http://127.0.0.1:{port}/", f"http://{place}/"
            found = asyncio.run(measure(echo_url, bridge_url, options.calls, options.rounds))
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait(10)
    print(json.dumps({name: round(value, 3) for name, value in found.items()}))
    return int(found["rosbridge_ms"] > GOAL)


if __name__ == "__main__":
    sys.exit(main())
