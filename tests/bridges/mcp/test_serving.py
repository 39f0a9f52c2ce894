"""The running command and the official client: over standard input and output, and over HTTP."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys

import httpx2
import pytest
from mcp import Client, StdioServerParameters
from mcp.client.streamable_http import streamable_http_client

import srvgen
import taskrpc

pytestmark = pytest.mark.real_time

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
TRIGGER = srvgen.load("std_srvs/srv/Trigger")
COMMAND = ["-m", "taskrpc", "bridge", "mcp"]
TOKEN = "token-of-the-agent"


@contextlib.asynccontextmanager
async def program():
    """A program of this machine that offers `/add`, and `/count`, which runs a request once."""
    calls = []

    def add(request, response):
        response.sum = request.a + request.b
        return response

    def count(request, response):
        calls.append(1)
        response.message = str(len(calls))
        return response

    async with taskrpc.Node("program") as node:
        node.create_service(ADD, "add", add)
        node.create_service(TRIGGER, "count", count, exactly_once=taskrpc.MemoryCompletions())
        yield node


@contextlib.contextmanager
def bridge(*options, **settings):
    """The running command, and what its first line on standard error says is ready."""
    command = [sys.executable, *COMMAND, *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **settings) as process:
        try:
            assert process.stderr is not None
            yield process, process.stderr.readline().strip()
        finally:
            process.kill()


@pytest.fixture
def token_file(tmp_path):
    file = tmp_path / "token"
    file.touch(0o600)
    file.write_text(TOKEN)
    return file


async def test_client_starts_the_bridge_and_calls_a_service():
    parameters = StdioServerParameters(command=sys.executable, args=COMMAND, env=dict(os.environ))
    async with program(), Client(parameters) as client:
        assert [each.name for each in (await client.list_tools()).tools] == ["add", "count"]
        result = await client.call_tool("add", {"a": 2, "b": 3})
        assert result.structured_content == {"sum": 5}


@pytest.mark.skipif(sys.platform == "win32", reason="there, `terminate` gives a process no time")
def test_bridge_ends_at_sigterm_while_it_waits_for_standard_input():
    with bridge(stdin=subprocess.PIPE, stdout=subprocess.PIPE) as (process, ready):
        assert ready == "taskrpc bridge ready: MCP at standard input and output"
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0


def test_bridge_ends_when_its_client_closes_standard_input():
    with bridge(stdin=subprocess.PIPE, stdout=subprocess.PIPE) as (process, _):
        process.stdin.close()
        assert process.wait(60) == 0


async def test_clients_with_the_token_call_services_over_http(token_file):
    """All clients number their requests from the same number on; each is a request of its own."""
    options = "--http", "127.0.0.1:0", "--token-file", str(token_file)
    async with program():
        with bridge(*options) as (process, ready):
            url = ready.split()[-1]
            headers = {"Authorization": f"Bearer {TOKEN}"}
            async with httpx2.AsyncClient(headers=headers) as http:
                found = []
                for mode in ("auto", "auto", "legacy", "legacy"):
                    transport = streamable_http_client(url, http_client=http)
                    async with Client(transport, mode=mode) as client:
                        result = await client.call_tool("count", {})
                        found.append(result.structured_content["message"])
                        result = await client.call_tool("add", {"a": 2, "b": 3})
                        assert result.structured_content == {"sum": 5}
            assert found == ["1", "2", "3", "4"]
            process.terminate()
            assert await asyncio.to_thread(process.wait, 60) == 0 or sys.platform == "win32"


def test_http_request_without_the_token_or_from_another_site_is_refused(token_file):
    known = {"Authorization": f"Bearer {TOKEN}"}
    cases = [
        ({}, 401),
        ({"Authorization": "Bearer wrong"}, 401),
        ({"Authorization": TOKEN}, 401),
        ({**known, "Host": "evil.example"}, 421),
        ({**known, "Origin": "https://evil.example"}, 403),
        ({**known, "Origin": "http://localhost:3000"}, 403),
    ]
    body = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
    accept = {"Accept": "application/json, text/event-stream"}
    with bridge("--http", "127.0.0.1:0", "--token-file", str(token_file)) as (_, ready):
        url = ready.split()[-1]
        for headers, status in cases:
            response = httpx2.post(url, json=body, headers={**accept, **headers})
            assert response.status_code == status, headers
