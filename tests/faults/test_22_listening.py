"""Promise 22: no server listens beyond loopback unprotected, or serves unauthenticated clients."""

import datetime
import itertools
import ssl

import pytest
import trustme

import taskrpc
from taskrpc import Account, Accounts
from taskrpc.core.security import listen_policy
from taskrpc.core.security.tls import Tls
from taskrpc.core.transport.connection import server_side
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

GOOD = "a token of many letters"
HOSTS = {"127.0.0.1": True, "localhost": True, "[::1]": True, "0.0.0.0": False, "[::]": False}
PROOFS = {
    "nothing": ({}, False),
    "token": ({"token": GOOD}, True),
    "short token": ({"token": "short"}, False),
    "accounts": ({"accounts": Accounts([Account("ana", "anas-secret-anas")])}, True),
    "short account": ({"accounts": Accounts([Account("ana", "short")])}, False),
}
CERTIFICATES = ("none", "own", "own and ca", "ca only")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificates")
    authority, stranger = trustme.CA(), trustme.CA()
    past = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=1)
    made = {
        "server": authority.issue_cert("127.0.0.1"),
        "caller": authority.issue_cert("caller.example", common_name="ana"),
        "expired": authority.issue_cert("127.0.0.1", not_after=past),
        "another host": authority.issue_cert("robot.example"),
        "another authority": stranger.issue_cert("127.0.0.1"),
    }
    for name, issued in made.items():
        issued.private_key_and_cert_chain_pem.write_to_path(folder / f"{name}.pem")
    authority.cert_pem.write_to_path(folder / "ca.pem")
    stranger.cert_pem.write_to_path(folder / "other ca.pem")
    return {path.stem: path for path in folder.iterdir()}


def listens_anywhere(patch):
    patch(listen_policy, "check_listen_policy", lambda host, **options: None)


def trusts_all(patch):
    def context(self):
        made = ssl.create_default_context()
        made.check_hostname = False
        made.verify_mode = ssl.CERT_NONE
        return made

    patch(Tls, "client_context", context)


def forgets_revocation(patch):
    patch(Account, "refusal", lambda self, now: "")


def tls_of(certificate, files):
    own = {"cert": files["server"], "key": files["server"]}
    ca = {"ca": files["ca"]}
    settings = {"none": None, "own": own, "own and ca": own | ca, "ca only": ca}[certificate]
    return settings and Tls(**settings)


@pytest.mark.planted(Bug(listens_anywhere, "listened unprotected"))
async def test_server_listens_beyond_loopback_only_if_protected(counts, files):
    for host, proof, certificate in itertools.product(HOSTS, PROOFS, CERTIFICATES):
        options, proves = PROOFS[proof]
        if certificate == "own and ca" and proof == "nothing":
            proves = True
        protected = HOSTS[host] or (proves and certificate in ("own", "own and ca"))
        tls = tls_of(certificate, files)
        async with taskrpc.Node("server", listen=f"{host}:0", tls=tls, **options) as node:
            try:
                node.create_service(Add, "add", lambda request, response: response)
            except taskrpc.CannotListen as error:
                if "Cannot assign" in str(error) or "not supported" in str(error):
                    counts["no IPv6"] += 1
                    continue
                counts["refused"] += 1
                counts["refused although protected"] += protected
                counts["told a secret"] += GOOD in str(error)
            else:
                counts["listened"] += 1
                counts["listened unprotected"] += not protected
    counts.check(
        "listened unprotected",
        "refused although protected",
        "told a secret",
        happened=("listened", "refused"),
    )
    counts.require(listened=10, refused=20)


async def attempt(counts, name, address, **options):
    async with taskrpc.Node("laptop", peers=[address], **options) as node:
        try:
            await node.create_client(Add, "/add", timeout=5).call(ask(2, 3))
        except taskrpc.TaskRpcError as error:
            counts["refused"] += 1
            counts["not told that nothing ran"] += error.not_executed is not True
            counts["told a secret"] += GOOD in str(error)
        else:
            counts["let in"] += 1
            counts[f"let in: {name}"] += 1


@pytest.mark.planted(Bug(trusts_all, "let in"), Bug(forgets_revocation, "let in"))
async def test_client_without_proof_is_refused_before_anything_is_decoded(
    counts, files, monkeypatch, tmp_path
):
    decoded = []
    for type_ in (server_side.RequestReceived, server_side.ResolveReceived):
        handler = server_side.ServingConnection.handlers[type_]
        monkeypatch.setitem(
            server_side.ServingConnection.handlers,
            type_,
            lambda connection, event, known=handler: decoded.append(1) or known(connection, event),
        )
    trusted = Tls(ca=files["ca"])
    shown = Tls(cert=files["caller"], key=files["caller"], ca=files["ca"])
    forged = Tls(cert=files["another authority"], key=files["another authority"], ca=files["ca"])
    revoked = Account("ana", "anas-secret-anas", revoked=True)
    expired = Account("ana", "anas-secret-anas", expires=1.0)
    wrong = {
        "plaintext": ("server", {}, {"token": GOOD}),
        "wrong CA": ("server", {}, {"token": GOOD, "tls": Tls(ca=files["other ca"])}),
        "the system's CAs": ("server", {}, {"token": GOOD, "tls": Tls()}),
        "expired": ("expired", {}, {"token": GOOD, "tls": trusted}),
        "another host": ("another host", {}, {"token": GOOD, "tls": trusted}),
        "wrong token": ("server", {}, {"token": "another token", "tls": trusted}),
        "no token": ("server", {}, {"tls": trusted}),
        "certificate without token": ("server", {"ca": 1}, {"tls": shown}),
        "forged certificate": ("server", {"ca": 1}, {"token": GOOD, "tls": forged}),
        "no certificate": ("server", {"ca": 1}, {"token": GOOD, "tls": trusted}),
        "revoked": ("server", {"accounts": revoked}, {"token": revoked.token, "tls": trusted}),
        "expired account": (
            "server",
            {"accounts": expired},
            {"token": expired.token, "tls": trusted},
        ),
        "unknown account": (
            "server",
            {"accounts": revoked},
            {"token": f"eve.{GOOD}", "tls": trusted},
        ),
    }
    for name, (certificate, asks, options) in wrong.items():
        with monkeypatch.context() as patch:
            patch.delenv("TASKRPC_TOKEN", raising=False)
            ca = files["ca"] if "ca" in asks else None
            tls = Tls(cert=files[certificate], key=files[certificate], ca=ca)
            accounts = Accounts([asks["accounts"]]) if "accounts" in asks else None
            async with taskrpc.Node("server", tls=tls, token=GOOD, accounts=accounts) as server:
                server.create_service(Add, "add", lambda request, response: response)
                # A different runtime folder simulates another machine.
                patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
                await attempt(counts, name, server.address, **options)
        counts["tried"] += 1
    counts["decoded"] += len(decoded)
    counts.check(
        "let in", "decoded", "not told that nothing ran", "told a secret", happened=("refused",)
    )
    counts.require(refused=len(wrong))
