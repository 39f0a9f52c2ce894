"""Promises 13 and 22, attacked by clients that continue after a failed handshake."""

import asyncio
import hashlib
import hmac
import json
import ssl

import pytest
import trustme

import srvgen
import taskrpc
from taskrpc import QoS, Role
from taskrpc.core.security.tls import Tls
from taskrpc.core.transport.connection import routes, server_side
from taskrpc.core.wire import handshake
from taskrpc.core.wire.frames import Splitter
from taskrpc.core.wire.session import Session
from tests.core.transport.helpers import Add
from tests.faults import attacker
from tests.faults.attacker import Attacker, broken_handshakes, knowing, replays, wrong_proofs
from tests.faults.harness import Bug

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

String = srvgen.load("std_msgs/msg/String")
TOPIC = "/secrets", String._TYPE, String._HASH
OWN = "the token of the server"
ROWS = {
    "ana": {"secret": "anas-secret-anas"},
    "bo": {"secret": "bos-secret-bos-bos", "role": "observe"},
    "gone": {"secret": "gones-secret-gone", "revoked": True},
    "old": {"secret": "olds-secret-olds-old", "expires": 1.0},
}
TOKENS = {name: f"{name}.{row['secret']}" for name, row in ROWS.items()}
HIDDEN = (server_side.RequestReceived, server_side.ResolveReceived, server_side.SubscribeReceived)


class Target:
    """A server with a service and a topic, which records what clients reached."""

    def __init__(self, node):
        self.ran = 0
        node.create_service(Add, "add", self._add, role=Role.SUBMIT, concurrency=100)
        latched = QoS(depth=1, durability="transient_local")
        self._publisher = node.create_publisher(String, "secrets", latched, role=Role.SUBMIT)
        self._publisher.publish(String(data="a secret"))
        self.address = node.address

    def _add(self, request, response):
        self.ran += 1
        return response


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


@pytest.fixture
def files(tmp_path, authority):
    paths = {name: tmp_path / f"{name}.pem" for name in ("server", "eve", "ca")}
    authority.cert_pem.write_to_path(paths["ca"])
    made = {
        "server": authority.issue_cert("127.0.0.1"),
        "eve": authority.issue_cert("eve.example", common_name="eve"),
    }
    for name, issued in made.items():
        paths[name].touch(0o600)
        issued.private_key_and_cert_chain_pem.write_to_path(paths[name])
    paths["accounts"] = tmp_path / "accounts.json"
    paths["accounts"].touch(0o600)
    paths["accounts"].write_text(json.dumps({"accounts": ROWS}))
    return paths


def believing(own):
    """A TLS context that accepts every certificate, and presents one if it has one."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if own is not None:
        context.load_cert_chain(own)
    return context


def servers(files):
    """Settings of servers, and how an attacker connects to each."""
    key = {"cert": files["server"], "key": files["server"]}
    return {
        "plain": ({}, None),
        "TLS": ({"tls": Tls(**key)}, believing(None)),
        "TLS with client certificates": (
            {"tls": Tls(**key, ca=files["ca"])},
            believing(files["eve"]),
        ),
    }


async def attacked(counts, target, hostile, name):
    """Try every wrong handshake; none may reach anything."""
    tokens = TOKENS["ana"], TOKENS["gone"], TOKENS["old"]
    wrong = wrong_proofs(OWN, *tokens) | replays(hostile, OWN)
    if hostile.context is None:
        del wrong["another certificate"], wrong["another certificate, for an account"]
    else:
        wrong["no certificate"] = attacker.proving("", lambda line: line.proof(OWN, channel=b""))
    for way, go in (wrong | broken_handshakes(OWN)).items():
        heard = await hostile.attempt(go)
        counts["attempts"] += 1
        counts["let in"] += heard.let_in
        counts["hung"] += heard.hung
        counts["refused with a sentence"] += bool(heard.refusals)
        if heard.let_in:
            print(f"{name}: let in by: {way}, got frames {heard.types}")
        if way in wrong:
            counts["answers that differ"] += any(
                told != "the token is not this server's" for told in heard.refusals
            )
    counts["ran for a stranger"] += target.ran


async def honest(counts, target, hostile):
    """The same bytes with right proofs reach everything: otherwise the attack proves nothing."""
    before = target.ran
    for way in (knowing(OWN), knowing(TOKENS["ana"], "ana")):
        heard = await hostile.attempt(way)
        counts["right proofs let in"] += attacker.AUTH_OK in heard.types
        everything = {attacker.RESPONSE, attacker.SUBSCRIBE, attacker.PUBLISH}
        counts["right proofs served"] += heard.types >= everything
    counts["ran for right proofs"] += target.ran - before


def any_proof_accepted(patch):
    patch(handshake.ServerHandshake, "_proves", lambda *_: True)


def account_secret_not_compared(patch):
    proves = handshake.ServerHandshake._proves

    def careless(self, auth, hello, token):
        known = self._me.accounts is not None and self._me.accounts.find(hello.account, 2.0)
        return bool(known) or proves(self, auth, hello, token)

    patch(handshake.ServerHandshake, "_proves", careless)


def certificate_not_bound(patch):
    proof = handshake._proof
    patch(
        handshake,
        "_proof",
        lambda token, role, ours, theirs, _: proof(token, role, ours, theirs, b""),
    )


def nonce_not_bound(patch):
    def proof(token, role, ours, theirs, channel):
        return hmac.digest(token, b"taskrpc " + role + ours + bytes(16) + channel, hashlib.sha256)

    patch(handshake, "_proof", proof)


def half_of_a_proof_is_enough(patch):
    def proves(self, auth, hello, token):
        expected = handshake._proof(
            token, b"client", hello.nonce, self._me.nonce, self.channel_binding
        )
        return hmac.compare_digest(auth.proof[1:], expected[1:])

    patch(handshake.ServerHandshake, "_proves", proves)


def revocation_forgotten(patch):
    patch(taskrpc.Account, "refusal", lambda self, now: "")


def empty_token_believed(patch):
    known = handshake.ServerHandshake._key_by_credentials

    def trusting(self, auth, hello, why):
        self.peer_credentials = self.peer_credentials or handshake.PeerCredentials(
            "", is_owner=True
        )
        return known(self, auth, hello, why)

    patch(handshake.ServerHandshake, "_key_by_credentials", trusting)


def any_certificate_stands_for_an_account(patch):
    known = handshake.ServerHandshake._key_by_credentials

    def trusting(self, auth, hello, why):
        if self.peer_credentials is not None:
            return handshake._Key(b"", None)
        return known(self, auth, hello, why)

    patch(handshake.ServerHandshake, "_key_by_credentials", trusting)


def frames_heard_before_the_proof(patch):
    known = Session._handshake_events

    def hasty(self, given, data):
        early = [frame for frame in Splitter(4096).feed(data) if frame[0] == attacker.RESOLVE]
        return (
            self.handled(early)
            if early and not self.splitter.mid_frame
            else known(self, given, data)
        )

    patch(Session, "_handshake_events", hasty)


def second_guess_allowed(patch):
    accept = handshake.ServerHandshake._accept

    def patient(self, auth, hello):
        try:
            return accept(self, auth, hello)
        except taskrpc.AuthenticationFailed:
            return b""

    patch(handshake.ServerHandshake, "_accept", patient)


def says_what_was_wrong(patch):
    patch(handshake, "_refused", lambda why: taskrpc.AuthenticationFailed(why))


@pytest.mark.planted(
    Bug(any_proof_accepted, "let in"),
    Bug(account_secret_not_compared, "let in"),
    Bug(certificate_not_bound, "let in"),
    Bug(nonce_not_bound, "let in"),
    Bug(half_of_a_proof_is_enough, "let in"),
    Bug(revocation_forgotten, "let in"),
    Bug(empty_token_believed, "let in"),
    Bug(any_certificate_stands_for_an_account, "let in"),
    Bug(frames_heard_before_the_proof, "let in"),
    Bug(second_guess_allowed, "let in"),
    Bug(says_what_was_wrong, "answers that differ"),
)
async def test_client_that_ignores_its_refusal_reaches_nothing(counts, files, monkeypatch):
    for type_ in HIDDEN:
        handler = server_side.ServingConnection.handlers[type_]

        def heard(served, event, known=handler):
            counts["heard of a stranger"] += served.caller == ""
            known(served, event)

        monkeypatch.setitem(server_side.ServingConnection.handlers, type_, heard)
    for name, (options, context) in servers(files).items():
        accounts = files["accounts"]
        async with taskrpc.Node("server", token=OWN, accounts=accounts, **options) as node:
            target = Target(node)
            hostile = Attacker(target.address, topic=TOPIC, context=context)
            await attacked(counts, target, hostile, name)
            await honest(counts, target, hostile)
    counts.check(
        "let in",
        "ran for a stranger",
        "heard of a stranger",
        "hung",
        "answers that differ",
        happened=("refused with a sentence", "ran for right proofs"),
    )
    counts.require(attempts=100, right_proofs_let_in=6, right_proofs_served=6)


def roles_not_compared(patch):
    route_to = routes.route_to
    patch(routes, "route_to", lambda *given: route_to(*given[:-1], Role.ADMIN))


@pytest.mark.planted(Bug(roles_not_compared, "ran"))
async def test_client_that_ignores_a_permission_error_gains_nothing(counts, files):
    """The client calls service ids that it never received, and subscribes without permission."""
    async with taskrpc.Node("server", token=OWN, accounts=files["accounts"]) as node:
        target = Target(node)
        hostile = Attacker(target.address, topic=TOPIC)
        heard = await hostile.attempt(knowing(TOKENS["bo"], "bo"))
        counts["let in"] += attacker.AUTH_OK in heard.types
        counts["got messages"] += attacker.PUBLISH in heard.types
        counts["ran"] += target.ran
        counts["hung"] += heard.hung
    counts.check("ran", "got messages", "hung", happened=("let in",))


async def test_flood_of_wrong_proofs_leaves_nothing_behind(counts, files):
    """Hundreds at once, from one address; then a right proof is served as before."""
    async with taskrpc.Node("server", token=OWN, accounts=files["accounts"]) as node:
        target = Target(node)
        hostile = Attacker(target.address, topic=TOPIC)
        floods = [hostile.attempt(knowing("guess")) for _ in range(100)]
        for heard in await asyncio.gather(*floods):
            counts["let in"] += heard.let_in
            counts["refused"] += bool(heard.refusals)
        await honest(counts, target, hostile)
    counts.check("let in", happened=("refused",))
    counts.require(right_proofs_let_in=2, right_proofs_served=2)
