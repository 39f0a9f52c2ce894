"""`taskrpc doctor HOST:PORT` distinguishes the reasons why a connection to a machine fails."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import shutil
import socket
import ssl
import subprocess
import sys

import pytest
import trustme

from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import probe
from taskrpc.core.security import lab
from taskrpc.core.wire.handshake import refusal
from taskrpc.errors import ProtocolError
from tests.raw_servers import served

pytestmark = pytest.mark.real_time


@pytest.fixture
def diagnose(capsys):
    """Runs the doctor for HOST:PORT: the text and the advice of its only problem."""

    def _diagnose(place, *argv):
        code = main(["doctor", place, *map(str, argv), "--json"])
        found = json.loads(capsys.readouterr().out)
        problems = [(each["text"], each["advice"]) for each in found if each["state"] == "problem"]
        assert code == 1
        assert len(problems) == 1, problems
        return problems[0]

    return _diagnose


@pytest.fixture
def listening():
    """Starts something that does `talk(connection)` with each that comes; returns its place."""
    with contextlib.ExitStack() as stack:
        yield lambda talk: stack.enter_context(served(socket.create_server(("127.0.0.1", 0)), talk))


@pytest.fixture
def encrypted(listening, tmp_path):
    """Starts a TLS server whose certificate is issued so; returns its place."""

    def _encrypted(authority, *names, **options):
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        authority.issue_cert(*names, **options).configure_cert(context)

        def talk(connection):
            with context.wrap_socket(connection, server_side=True) as wrapped:
                wrapped.recv(1)

        return listening(talk)

    return _encrypted


@pytest.fixture
def authority(tmp_path):
    made = trustme.CA()
    made.file = tmp_path / "ca.pem"
    made.cert_pem.write_to_path(made.file)
    return made


# Certificates


def test_certificate_of_an_unknown_authority_is_a_problem(diagnose, encrypted, authority):
    place = encrypted(trustme.CA(), "127.0.0.1")
    text, advice = diagnose(place, "--tls-ca", authority.file)
    assert (
        text
        == f"the certificate of {place} was signed by an authority that this machine does not trust"
    )
    assert "--tls-ca" in advice


def test_expired_certificate_is_a_problem(diagnose, encrypted, authority):
    yesterday = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=1)
    place = encrypted(authority, "127.0.0.1", not_after=yesterday)
    text, advice = diagnose(place, "--tls-ca", authority.file)
    assert text == f"the certificate of {place} has expired"
    assert "clock" in advice


def test_certificate_of_another_name_is_a_problem(diagnose, encrypted, authority):
    place = encrypted(authority, "robot.example")
    text, advice = diagnose(place, "--tls-ca", authority.file)
    assert text == f"the certificate of {place} is not for 127.0.0.1"
    assert "a name or an address that the certificate contains" in advice


def test_encrypted_server_without_a_known_authority_is_a_problem(diagnose, encrypted, authority):
    place = encrypted(authority, "127.0.0.1")
    text, advice = diagnose(place)
    assert text == f"{place} accepts only encrypted connections"
    assert "taskrpc join" in advice


def test_server_without_tls_is_a_problem_if_tls_is_expected(diagnose, session_server, authority):
    text, advice = diagnose(session_server.address, "--tls-ca", authority.file)
    assert text.startswith(f"{session_server.address} accepts no encrypted connections")
    assert "taskrpc classroom --serve" in advice


def test_changed_certificate_of_a_lab_is_a_problem(diagnose, encrypted, authority):
    place = encrypted(authority, "127.0.0.1")
    before = authority.issue_cert("127.0.0.1").cert_chain_pems[0].bytes().decode()
    lab.remember_lab(lab.Lab(address=place, token="ada.secret", certificate=before))
    text, advice = diagnose(place)
    assert text == f"{place} has another certificate than when this laptop joined"
    assert "new string" in advice


def test_server_of_another_version_is_a_problem(diagnose, listening):
    newer = ProtocolError("this server speaks version 2, the client 1 to 1")
    place = listening(
        lambda connection: (connection.recv(4096), connection.sendall(refusal(newer)))
    )
    text, advice = diagnose(place)
    assert text == f"{place}: {newer}"
    assert advice == "install the same version of taskrpc on both machines"


# Networks


def test_host_that_accepts_no_connection_is_a_problem(diagnose, monkeypatch):
    """A listener with a full backlog does not answer, like a host behind a firewall."""
    if sys.platform != "linux":
        pytest.skip("other systems refuse where the backlog is full")
    monkeypatch.setattr(probe, "STEP_TIMEOUT", 0.3)
    with socket.create_server(("127.0.0.1", 0), backlog=0) as sock:
        place = sock.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for each in waiting:
            each.setblocking(False)
            each.connect_ex(place)
        text, advice = diagnose(f"127.0.0.1:{place[1]}")
        for each in waiting:
            each.close()
    assert text == f"127.0.0.1 did not respond at port {place[1]} within 0.3 s"
    assert "firewall" in advice
    assert "client isolation" in advice


SCRIPT = """
ip link set lo up
ip route add unreachable 10.8.0.0/16 && ip route add prohibit 10.7.0.0/16 || exit 99
exec "$0" -c '
from taskrpc.cli.ros.doctor import probe
from taskrpc.cli.main import main
probe.STEP_TIMEOUT = 0.3
for place in ("10.6.0.1:1", "10.7.0.1:1", "10.8.0.1:1"):
    main(["doctor", place, "--json"])
'
"""


@pytest.fixture(scope="module")
def in_a_network_of_its_own(tmp_path_factory):
    """What the doctor says in a network that leads nowhere."""
    if not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("needs unshare and ip")
    runtime = tmp_path_factory.mktemp("runtime")
    runtime.chmod(0o700)
    ran = subprocess.run(
        ["unshare", "-rn", "sh", "-c", SCRIPT, sys.executable],
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    if ran.returncode:
        pytest.skip(f"no network namespace: {ran.stderr.strip()[-200:]}")
    reports = [json.loads(line) for line in ran.stdout.splitlines()]
    return [
        next((each["text"], each["advice"]) for each in report if each["state"] == "problem")
        for report in reports
    ]


@pytest.mark.parametrize(
    ("index", "what", "to_do"),
    [
        (0, "this machine has no route to the network of 10.6.0.1: ", "connect to the network"),
        (1, "a firewall of this machine or a router forbids 10.7.0.1: ", "allow TCP port 1"),
        (2, "no machine answers at 10.8.0.1: ", "the lecturer's hotspot"),
    ],
)
def test_each_network_failure_has_its_advice(in_a_network_of_its_own, index, what, to_do):
    text, advice = in_a_network_of_its_own[index]
    assert text.startswith(what)
    assert to_do in advice
