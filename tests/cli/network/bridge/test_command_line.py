"""`taskrpc bridge rosbridge`: its options, and a client of the running command."""

import asyncio
import subprocess
import sys

import aiohttp
import pytest

from taskrpc.cli import main


def test_gateway_serves_until_sigterm():
    command = [sys.executable, "-m", "taskrpc", "bridge", "rosbridge", "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        ready = process.stderr.readline()
        assert ready.startswith("taskrpc bridge ready: rosbridge at ws://127.0.0.1:")
        try:
            url = ready.split()[-1].replace("ws", "http", 1)
            names, page, last = asyncio.run(_received(url, process))
            assert process.wait(60) == 0 or sys.platform == "win32"
        finally:
            process.kill()
    assert names == ["/rosbridge_websocket"]
    assert page.startswith("This address speaks rosbridge v2")
    if sys.platform != "win32":  # there, `terminate` gives a process no time
        assert last == (1001, "the server is ending")


async def _received(url, process):
    """The names of nodes, the page, and the code and reason with which the gateway ends."""
    async with aiohttp.ClientSession() as http, http.ws_connect(url) as socket:
        await socket.send_json({"op": "call_service", "service": "/rosapi/nodes"})
        response = await socket.receive_json()
        async with http.get(url) as page:
            text = await page.text()
        process.terminate()
        end = await asyncio.wait_for(socket.receive(), 60)
        return response["values"]["nodes"], text, (end.data, end.extra)


@pytest.mark.parametrize(
    ("options", "status", "problem"),
    [
        (["--listen", "9090"], 2, "argument --listen: expected HOST:PORT"),
        (["--listen", "0.0.0.0:0"], 1, "without a certificate and a token"),
        (["--allow-origin", "lab:8000"], 2, "expected an origin such as http://lab.local:8000"),
        (["--allow-origin", "http://lab/page"], 2, "expected an origin such as"),
        (["--token-file", "missing"], 1, "--token-file missing: "),
    ],
)
def test_mistake_in_the_options_gives_one_message(options, status, problem, capsys):
    assert main.main(["bridge", "rosbridge", *options]) == status
    assert problem in capsys.readouterr().err
