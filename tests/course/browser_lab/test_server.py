"""The server of the page serves its files from memory, with a strict policy."""

import contextlib
import datetime
import gzip
import http.client
import socket
import ssl
import threading
import urllib.error
import urllib.request

import pytest

from taskrpc import CannotListen
from taskrpc.core.security.tls import Tls
from taskrpc.course.browser_lab.server import LabServer
from taskrpc.course.classroom.authority import make_certificates

pytestmark = pytest.mark.real_time


FILES = {"index.html": b"<!doctype html>", "pyodide/pyodide.asm.wasm": b"\0asm"}


@contextlib.contextmanager
def serving(server):
    with server:
        thread = threading.Thread(target=lambda: server.serve_forever(poll_interval=0.01))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def server():
    with serving(LabServer(FILES, 0)) as server:
        yield server


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("class")
    return make_certificates(folder, ["127.0.0.1"], datetime.datetime.now(datetime.UTC))


@pytest.fixture
def class_server(certificates):
    """The page as a class gets it."""
    context = Tls(cert=certificates.cert, key=certificates.key).server_context()
    with serving(LabServer(FILES, 0, host="127.0.0.1", context=context)) as server:
        yield server


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


def test_a_class_gets_the_page_encrypted_and_compressed(class_server, certificates):
    context = ssl.create_default_context(cafile=certificates.ca)
    connection = http.client.HTTPSConnection(
        "127.0.0.1", class_server.server_port, context=context, timeout=30
    )
    with contextlib.closing(connection):
        connection.request("GET", "/", headers={"Accept-Encoding": "gzip, br"})
        response = connection.getresponse()
        assert response.headers["Content-Encoding"] == "gzip"
        assert gzip.decompress(response.read()) == b"<!doctype html>"
        connection.request("GET", "/")
        response = connection.getresponse()
        assert response.headers["Content-Encoding"] is None
        assert response.read() == b"<!doctype html>"
    assert class_server.url == f"https://127.0.0.1:{class_server.server_port}/"
    assert class_server.url_at("fd00::2") == f"https://[fd00::2]:{class_server.server_port}/"


def test_an_address_without_https_leads_to_the_encrypted_page(class_server):
    place = f"127.0.0.1:{class_server.server_port}"
    with contextlib.closing(http.client.HTTPConnection(place, timeout=30)) as connection:
        connection.request("GET", "/?lab=2")
        response = connection.getresponse()
        assert response.status == 307
        assert response.headers["Location"] == f"https://{place}/?lab=2"
        assert response.read() == b""


def test_a_browser_that_refuses_the_certificate_leaves_no_traceback(class_server, capfd):
    place = "127.0.0.1", class_server.server_port
    with pytest.raises(ssl.SSLError), socket.create_connection(place, 30) as connection:
        ssl.create_default_context().wrap_socket(connection, server_hostname="127.0.0.1")
    with socket.create_connection(place, 30) as connection:
        connection.sendall(b"\x16garbage")
        with contextlib.suppress(OSError):  # the server ends the connection at once
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(1024):
                pass
    assert capfd.readouterr().err == ""
