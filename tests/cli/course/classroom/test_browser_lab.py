"""`taskrpc classroom lab` prints what students open, and serves it with the class's certificate."""

import pytest

from taskrpc.cli.course.classroom import browser_lab
from taskrpc.cli.main import main
from taskrpc.core.system import folders
from taskrpc.course.classroom.register import Register

pytestmark = pytest.mark.real_time


@pytest.fixture
def served(monkeypatch):
    """The servers of the page, which end at once."""
    servers = []

    def serve(server):
        servers.append((server.server_address[0], server.url))
        return 0

    monkeypatch.setattr(browser_lab, "files_of_the_page", lambda folder: {"index.html": b""})
    monkeypatch.setattr(browser_lab, "serve", serve)
    return servers


def test_address_and_fingerprint_are_printed_for_the_students(served, capsys):
    assert main(["classroom", "--address", "192.0.2.7", "--address", "fd00::7"]) == 0
    capsys.readouterr()
    assert main(["classroom", "lab", "--port", "0"]) == 2
    assert main(["classroom", "lab", "--port", "18737", "--pyodide", "folder"]) == 0
    said = capsys.readouterr()
    assert said.out == "https://192.0.2.7:18737/\nhttps://[fd00::7]:18737/\n"
    register = Register(folders.state_dir() / "classroom")
    assert register.certificates.fingerprint.hex(":").upper() in said.err.splitlines()
    ((host, url),) = served
    assert host == "0.0.0.0"
    assert url.startswith("https://")


def test_page_needs_a_class_whose_certificate_it_shows(served, capsys):
    assert main(["classroom", "lab"]) == 1
    assert capsys.readouterr().err == "there is no class yet: `taskrpc classroom` makes one\n"
    assert served == []
