"""`taskrpc view` with a joined lab prints the links of its page, and starts no server."""

import asyncio
import datetime

import pytest

import srvgen
import taskrpc
from taskrpc.cli.main import main
from taskrpc.cli.observe.view import command_line as view
from taskrpc.core.security.lab import Lab, remember_lab
from taskrpc.course.classroom.authority import fingerprint, make_certificates

pytestmark = pytest.mark.real_time

STARTED = 99
"""The exit code that stands for a server on this laptop."""
TOKEN = "ada.0123456789abcdef"
Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    return make_certificates(folder, ["localhost"], datetime.datetime.now(datetime.UTC))


@pytest.fixture(autouse=True)
def no_server(monkeypatch):
    monkeypatch.setattr(view, "_run_server", lambda options: STARTED)


@pytest.fixture
def tls(made):
    return taskrpc.Tls(cert=made.cert, key=made.key)


@pytest.fixture
async def server(made, tls, monkeypatch, tmp_path):
    """A lab's server that this user has joined; from then on, the test is on another machine."""
    async with taskrpc.Node("server", tls=tls, token=TOKEN) as node:
        node.create_service(Trigger, "/robot_task/health", lambda request, response: response)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        certificate = made.cert.read_text(encoding="ascii")
        remember_lab(Lab(address=node.address, token=TOKEN, certificate=certificate))
        yield node


def serve_page(node, url):
    def address(request, response):
        response.success, response.message = True, url
        return response

    node.create_service(Trigger, "/robot_task/page", address)


async def test_links_of_the_lab_have_the_account_of_the_student(server, made, capsys):
    serve_page(server, f"https://{server.address}")  # any TLS server with the lab's certificate
    assert await asyncio.to_thread(main, ["view"]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        f"look:      https://{server.address}/#view={TOKEN}",
        f"projector: https://{server.address}/?projector#view={TOKEN}",
    ]
    known = fingerprint(made.cert.read_text(encoding="ascii")).hex(":").upper()
    assert said.err.splitlines()[-1] == known


async def test_page_is_looked_for_at_the_address_at_which_the_laptop_reaches_the_lab(
    server, capsys
):
    port = server.address.rpartition(":")[2]
    serve_page(server, f"https://192.0.2.1:{port}")
    assert await asyncio.to_thread(main, ["view"]) == 0
    assert f"https://{server.address}/#view=" in capsys.readouterr().out


async def test_lab_without_a_page_says_what_to_do(server, capsys):
    assert await asyncio.to_thread(main, ["view"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert f"the lab at {server.address} serves no live page for laptops" in said.err
    assert "taskrpc classroom --web 0.0.0.0:8443 --serve" in said.err
    assert "taskrpc-server --web 127.0.0.1:0" in said.err


@pytest.mark.parametrize(
    "url",
    [
        "http://127.0.0.1:8443",
        "https://127.0.0.1:8443/#view=x",
        "https://evil.example:1@x",
        "\x1b[2J",
        "",
    ],
)
async def test_invalid_address_of_a_page_is_refused(server, url, capsys):
    serve_page(server, url)
    assert await asyncio.to_thread(main, ["view"]) == 1
    said = capsys.readouterr()
    assert "expected the page's address, got" in said.err
    assert "\x1b" not in said.err
    assert TOKEN not in said.out + said.err


async def test_page_with_another_certificate_gets_no_secret(server, tmp_path, capsys):
    folder = tmp_path / "other"
    folder.mkdir()
    other = make_certificates(folder, ["localhost"], datetime.datetime.now(datetime.UTC))
    stranger = taskrpc.Tls(cert=other.cert, key=other.key)
    async with taskrpc.Node("stranger", tls=stranger, token=TOKEN) as node:
        node.create_service(Trigger, "/stranger/health", lambda request, response: response)
        serve_page(server, f"https://{node.address}")
        assert await asyncio.to_thread(main, ["view"]) == 1
    said = capsys.readouterr()
    assert "cannot be reached from here" in said.err
    assert TOKEN not in said.out + said.err


async def test_with_peers_the_lab_is_not_called(server, monkeypatch):
    monkeypatch.setenv("TASKRPC_PEERS", "192.0.2.1:1")
    assert await asyncio.to_thread(main, ["view"]) == STARTED
