"""Connections to other machines are encrypted and authenticated on both sides, or refused."""

import asyncio
import contextlib
import os
import ssl

import pytest
import trustme

import taskrpc
from taskrpc.core.security.tls import Tls, digest, pinned_context, shown_certificate
from taskrpc.core.transport import endpoint
from tests.core.transport.helpers import Add, add, ask, outcome, until

pytestmark = pytest.mark.real_time

TOKEN = "a secret of this lab"


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


@pytest.fixture
def certificates(authority, tmp_path):
    """The files of a server on 127.0.0.1 and of the authority that signed it."""
    issued = authority.issue_cert("127.0.0.1")
    cert, key, ca = tmp_path / "cert.pem", tmp_path / "key.pem", tmp_path / "ca.pem"
    cert.write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
    issued.private_key_pem.write_to_path(key)
    authority.cert_pem.write_to_path(ca)
    return Tls(cert=cert, key=key), Tls(ca=ca)


def elsewhere(tls, token=TOKEN, **options):
    """A node that finds no server in the registry, like a node on another machine."""
    return taskrpc.Node("elsewhere", tls=tls, token=token, **options)


async def call(node):
    client = node.create_client(Add, "/add", timeout=5)
    return await outcome(client.call(ask(2, 3)))


async def far_call(server, monkeypatch, tmp_path, tls, token=TOKEN):
    """What a program on another machine gets from a server."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    async with elsewhere(tls, token, peers=[server.address]) as node:
        return await call(node)


async def test_another_machine_calls_with_the_authority_and_the_token(
    certificates, monkeypatch, tmp_path
):
    async with taskrpc.Node("server", tls=certificates[0], token=TOKEN) as server:
        server.create_service(Add, "add", add)
        answer = await far_call(server, monkeypatch, tmp_path, certificates[1])
    assert answer.sum == 5


async def test_a_program_of_this_machine_calls_a_tls_server_with_nothing_configured(certificates):
    async with (
        taskrpc.Node("server", tls=certificates[0], token=TOKEN, listen="0.0.0.0:0") as server,
        taskrpc.Node("here") as here,
    ):
        server.create_service(Add, "add", add)
        assert server.address.startswith("0.0.0.0:")
        assert (await call(here)).sum == 5


async def test_node_with_tls_still_calls_plain_servers_on_this_machine(certificates):
    async with taskrpc.Node("server") as server, elsewhere(certificates[1]) as node:
        server.create_service(Add, "add", add)
        assert (await call(node)).sum == 5


async def test_node_without_a_certificate_offers_unencrypted_on_this_machine(
    certificates,
):
    async with elsewhere(certificates[1]) as node, taskrpc.Node("here") as here:
        node.create_service(Add, "add", add)
        assert (await call(here)).sum == 5


@pytest.mark.parametrize("wrong", ["authority", "plain", "token"])
async def test_client_without_the_token_or_the_authority_is_refused(
    certificates, wrong, monkeypatch, tmp_path
):
    tls, token = certificates[1], TOKEN
    if wrong == "authority":
        other = tmp_path / "other.pem"
        trustme.CA().cert_pem.write_to_path(other)
        tls = Tls(ca=other)
    elif wrong == "plain":
        tls = None
    else:
        token = "another secret"
    async with taskrpc.Node("server", tls=certificates[0], token=TOKEN) as server:
        server.create_service(Add, "add", add)
        error = await far_call(server, monkeypatch, tmp_path, tls, token)
    assert isinstance(error, taskrpc.AuthenticationFailed | taskrpc.ServiceUnavailable)
    assert error.not_executed
    assert TOKEN not in str(error)


async def test_server_with_ca_requires_certificates_of_its_callers(
    certificates, authority, monkeypatch, tmp_path
):
    server_tls = Tls(cert=certificates[0].cert, key=certificates[0].key, ca=certificates[1].ca)
    caller = authority.issue_cert("student@lab.example")
    cert = tmp_path / "caller.pem"
    caller.private_key_and_cert_chain_pem.write_to_path(cert)
    async with taskrpc.Node("server", tls=server_tls, token=TOKEN) as server:
        server.create_service(Add, "add", add)
        known = Tls(ca=certificates[1].ca, cert=cert, key=cert)
        assert (await far_call(server, monkeypatch, tmp_path, known)).sum == 5
        stranger = await far_call(server, monkeypatch, tmp_path, certificates[1])
        assert isinstance(stranger, taskrpc.ServiceUnavailable)


def test_only_tls_1_3_is_spoken(certificates):
    server, client = certificates
    for context in (server.server_context(), client.client_context()):
        assert context.minimum_version is ssl.TLSVersion.TLSv1_3


@pytest.mark.parametrize("content", [None, b"no certificate"])
def test_file_without_a_certificate_is_named(tmp_path, content):
    path = tmp_path / "cert.pem"
    if content:
        path.write_bytes(content)
    with pytest.raises(taskrpc.TaskRpcError, match=r"cert\.pem: "):
        Tls(cert=path, key=path).server_context()
    with pytest.raises(taskrpc.TaskRpcError, match=r"cert\.pem: "):
        Tls(ca=path).client_context()
    with pytest.raises(taskrpc.CannotListen, match="a certificate and its key"):
        Tls().server_context()


async def test_client_with_ca_trusts_no_other_authority(certificates, monkeypatch, tmp_path):
    """Whoever can have a certificate from an authority of the system's is not believed."""
    system, other = tmp_path / "system.pem", tmp_path / "other.pem"
    system.write_bytes(certificates[1].ca.read_bytes())
    trustme.CA().cert_pem.write_to_path(other)
    monkeypatch.setenv("SSL_CERT_FILE", str(system))
    async with taskrpc.Node("server", tls=certificates[0], token=TOKEN) as server:
        server.create_service(Add, "add", add)
        assert (await far_call(server, monkeypatch, tmp_path, Tls())).sum == 5
        error = await far_call(server, monkeypatch, tmp_path, Tls(ca=other))
    assert isinstance(error, taskrpc.ServiceUnavailable)
    assert "no TLS connection: " in str(error)


@pytest.fixture
def one_file(authority, tmp_path):
    """A key, its certificate and the authority's in one file."""
    path = tmp_path / "all.pem"
    path.touch(0o600)
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    with path.open("ab") as file:
        file.write(authority.cert_pem.bytes())
    return path


async def test_the_registry_has_the_certificate_and_never_the_key(one_file):
    async with taskrpc.Node("server", tls=Tls(cert=one_file, key=one_file)) as server:
        server.create_service(Add, "add", add)
        (entry,) = await server.graph()
        assert "PRIVATE" not in entry.certificate
        assert entry.certificate.count("BEGIN") == 1
        async with taskrpc.Node("here") as here:
            assert (await call(here)).sum == 5


def test_pinned_context_accepts_no_other_certificate_of_the_authority(one_file, authority):
    pinned = pinned_context(shown_certificate(Tls(cert=one_file, key=one_file)), None)
    assert len(pinned.get_ca_certs(binary_form=True)) <= 1
    with pytest.raises(ssl.SSLCertVerificationError):
        shake(pinned, authority.issue_cert("127.0.0.1"))


def shake(client, issued):
    """Shake hands with a server that has this certificate, without any network."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    issued.configure_cert(server)
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(to_client, to_server, server_hostname="127.0.0.1")
    theirs = server.wrap_bio(to_server, to_client, server_side=True)
    for end in (ours, theirs) * 3:
        try:
            end.do_handshake()
        except ssl.SSLWantReadError:
            continue


async def test_local_client_calls_a_server_whose_certificate_changed_without_connections(
    one_file, authority, monkeypatch
):
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    async with taskrpc.Node("server", tls=Tls(cert=one_file, key=one_file)) as server:
        server.create_service(Add, "add", add)
        entries = server._transport.network._registry.entries
        before = entries()[0].certificate
        authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(one_file)
        await until(lambda: entries()[0].certificate != before)
        async with taskrpc.Node("here") as here:
            assert (await call(here)).sum == 5


@pytest.mark.skipif(os.name != "posix", reason="file modes are POSIX's")
@pytest.mark.parametrize(("mode", "warned"), [(0o600, False), (0o400, False), (0o644, True)])
def test_warning_about_a_readable_key_is_logged_once(one_file, caplog, mode, warned):
    one_file.chmod(mode)
    for _ in range(3):
        Tls(cert=one_file, key=one_file).server_context()
    text = f"{one_file}: expected a file that only its owner can read, its mode is {mode:04o}"
    assert [text in each for each in caplog.messages] == [True] * warned


def test_missing_key_is_named_instead_of_the_certificate(certificates, tmp_path):
    with pytest.raises(taskrpc.TaskRpcError, match=r"none\.pem: No such file"):
        Tls(cert=certificates[0].cert, key=tmp_path / "none.pem").server_context()


async def test_caller_gets_the_problem_with_a_certificate(certificates, tmp_path):
    other = tmp_path / "other.pem"
    trustme.CA().cert_pem.write_to_path(other)
    async with taskrpc.Node("server", tls=certificates[0], token=TOKEN) as server:
        server.create_service(Add, "add", add)
        network = server._transport.network
        network._registry.close()
        async with elsewhere(Tls(ca=other), peers=[server.address]) as node:
            error = await call(node)
    assert "no TLS connection: unable to get local issuer certificate" in str(error)
    assert "not permitted" not in str(error)
    await asyncio.sleep(0)


@contextlib.asynccontextmanager
async def between(server, context=None):
    """Somebody who passes on all that a caller says to a server, and all that it answers.

    To his callers he shows a certificate of his own, or none. Yields where he listens.
    """
    trusting = ssl.create_default_context()
    trusting.check_hostname = False
    trusting.verify_mode = ssl.CERT_NONE

    async def pass_on(reader, writer):
        with contextlib.suppress(OSError):
            while data := await reader.read(65_536):
                writer.write(data)
                await writer.drain()
        writer.close()

    async def relay(reader, writer):
        host, _, port = server.address.rpartition(":")
        there = await asyncio.open_connection(host, int(port), ssl=trusting)
        await asyncio.gather(pass_on(reader, there[1]), pass_on(there[0], writer))

    async with await asyncio.start_server(relay, "127.0.0.1", 0, ssl=context) as relaying:
        yield "{}:{}".format(*relaying.sockets[0].getsockname())


@pytest.mark.parametrize("encrypted", [False, True])
@pytest.mark.parametrize("account", [False, True])
async def test_proof_of_a_caller_is_invalid_at_another_server(
    certificates, authority, encrypted, account, monkeypatch, tmp_path
):
    """Neither from a port of this machine that he took, nor with a certificate of his own."""
    ada = taskrpc.Account("ada", "adas-secret-for-the-lab")
    token = ada.token if account else TOKEN
    calls = []

    def note(request, response):
        calls.append(request)
        return response

    mine, theirs = None, None
    if encrypted:
        theirs = certificates[1]
        mine = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        authority.issue_cert("127.0.0.1").configure_cert(mine)
    options = {"token": TOKEN, "accounts": taskrpc.Accounts([ada])}
    async with (
        taskrpc.Node("server", tls=certificates[0], **options) as server,
        between(server, mine) as place,
    ):
        server.create_service(Add, "add", note)
        direct = await far_call(server, monkeypatch, tmp_path, certificates[1], token)
        assert isinstance(direct, Add.Response)
        async with taskrpc.Node("victim", peers=[place], tls=theirs, token=token) as victim:
            assert isinstance(await call(victim), taskrpc.AuthenticationFailed)
    assert len(calls) == 1


async def test_proof_uses_the_certificate_of_its_connection_after_a_change(
    one_file, authority, monkeypatch, tmp_path
):
    """Who shakes hands while the certificate changes proves the token for the one he was shown."""
    ca = tmp_path / "ca.pem"
    authority.cert_pem.write_to_path(ca)
    async with taskrpc.Node("server", tls=Tls(cert=one_file, key=one_file), token=TOKEN) as server:
        server.create_service(Add, "add", add)
        tls = server._transport.network._server_tls
        old, before = tls.context(), tls.certificate
        authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(one_file)
        assert tls.context() is not old
        assert tls.shown_with(old) != tls.shown_with(tls.context())
        assert tls.shown_with(old) == digest(ssl.PEM_cert_to_DER_cert(before))
        assert (await far_call(server, monkeypatch, tmp_path, Tls(ca=ca))).sum == 5
