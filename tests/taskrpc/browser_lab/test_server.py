"""The server of the page serves its files from memory, with a strict policy."""

import threading
import urllib.error
import urllib.request

import pytest

from taskrpc import CannotListen
from taskrpc.browser_lab.server import LabServer

pytestmark = pytest.mark.real_time


@pytest.fixture
def server():
    files = {"index.html": b"<!doctype html>", "pyodide/pyodide.asm.wasm": b"\0asm"}
    with LabServer(files, 0) as server:
        thread = threading.Thread(target=lambda: server.serve_forever(poll_interval=0.01))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_files_have_their_types_and_a_policy_without_other_origins(server):
    with urllib.request.urlopen(server.url) as response:
        assert response.read() == b"<!doctype html>"
        assert "default-src 'none'" in response.headers["Content-Security-Policy"]
        tag = response.headers["ETag"]
    with urllib.request.urlopen(f"{server.url}pyodide/pyodide.asm.wasm?x") as response:
        assert response.headers["Content-Type"] == "application/wasm"
    again = urllib.request.Request(server.url, headers={"If-None-Match": tag})
    with pytest.raises(urllib.error.HTTPError, match="304") as caught:
        urllib.request.urlopen(again)
    caught.value.close()


@pytest.mark.parametrize("path", ["../pyproject.toml", "nothing", "%2e%2e/index.html"])
def test_other_paths_are_not_found(server, path):
    with pytest.raises(urllib.error.HTTPError, match="404") as caught:
        urllib.request.urlopen(server.url + path)
    caught.value.close()


def test_a_port_in_use_is_named_with_the_remedy(server):
    with pytest.raises(CannotListen, match="--port"):
        LabServer({"index.html": b""}, server.server_port)
