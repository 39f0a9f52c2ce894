"""Promise 23: a secret is in no log, repr, traceback, process list, error or byte on the wire."""

import datetime
import json
import logging
import os
import stat
import subprocess
import sys
import traceback
from pathlib import Path

import pytest

import taskrpc
from taskrpc import Account, Accounts
from taskrpc.core.security import accounts as accounts_module
from taskrpc.core.transport import endpoint, network, pipe
from taskrpc.core.wire import handshake
from tests.core.transport.helpers import Add, add, ask
from tests.core.wire.helpers import Comparisons
from tests.faults.harness import Bug

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

CANARY = "canary-7f3a9d51c0-canary"
ACCOUNT = Account("ana", f"{CANARY}-ana")
ROOT = Path(__file__).parents[2]
CAPTURED = {"capture_output": True, "text": True, "check": False}
posix = pytest.mark.skipif(os.name != "posix", reason="processes and modes are looked at by POSIX")


def shows_accounts(patch):
    patch(Account, "__repr__", lambda self: f"Account({self.name}, {self.secret})")


def shows_addresses(patch):
    patch(network.Address, "__repr__", lambda self: f"Address({self.text}, {self.token!r})")


def logs_accounts(patch):
    known = accounts_module.AccountSource.refresh

    def refresh(source):
        for account in source.current:
            logging.getLogger("taskrpc").debug("known: %s", account.token)
        return known(source)

    patch(accounts_module.AccountSource, "refresh", refresh)


def server_compares_by_hand(patch):
    def proves(self, auth, hello, token):
        nonces = hello.nonce, self._me.nonce
        return handshake._proof(token, b"client", *nonces, self.channel_binding) == auth.proof

    patch(handshake.ServerHandshake, "_proves", proves)


def client_compares_by_hand(patch):
    accept = handshake.ClientHandshake._accept

    def accept_right(self, auth, ack):
        if auth.proof != self._proof(b"server", ack):
            raise taskrpc.AuthenticationFailed("the server could not prove the token")
        return accept(self, auth, ack)

    patch(handshake.ClientHandshake, "_accept", accept_right)


def compares_byte_by_byte(patch):
    def proves(self, auth, hello, token):
        nonces = hello.nonce, self._me.nonce
        expected = handshake._proof(token, b"client", *nonces, self.channel_binding)
        return all(one == other for one, other in zip(auth.proof, expected, strict=True))

    patch(handshake.ServerHandshake, "_proves", proves)


def believes_every_server(patch):
    def accept(self, auth, ack):
        self.peer = handshake.Peer(ack.boot_id, "", ack.limits)
        return b""

    patch(handshake.ClientHandshake, "_accept", accept)


def tells_what_was_wrong(patch):
    patch(handshake, "_refused", lambda why: taskrpc.AuthenticationFailed(why))


@pytest.mark.planted(
    Bug(shows_accounts, "in a repr"),
    Bug(shows_addresses, "in a repr"),
    Bug(logs_accounts, "in the log"),
    Bug(server_compares_by_hand, "compared by hand"),
    Bug(client_compares_by_hand, "compared by hand"),
    Bug(compares_byte_by_byte, "compared by hand"),
    Bug(believes_every_server, "not compared in constant time"),
    Bug(tells_what_was_wrong, "answers that differ"),
)
async def test_secrets_are_in_no_output(counts, monkeypatch, caplog, tmp_path):
    caplog.set_level(logging.DEBUG)
    comparisons = Comparisons().watch(monkeypatch)
    monkeypatch.setattr(endpoint, "TICK", 0.01)
    monkeypatch.setenv("TASKRPC_TOKEN", "")
    server = taskrpc.Node("server", token=CANARY, accounts=Accounts([ACCOUNT]))
    said, seen, answers = [], [server], set()
    async with server:
        server.create_service(Add, "add", add)
        seen += [server._transport.network, *server._transport.network.accounts.current]
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        tokens = {
            "own": CANARY,
            "account": ACCOUNT.token,
            "guess": f"ana.{CANARY}-guess",
            "unknown": f"eve.{CANARY}-eve",
            "wrong": f"{CANARY}-wrong",
        }
        for name, token in tokens.items():
            async with taskrpc.Node(name, peers=[server.address], token=token) as node:
                carrier = node._transport.network
                seen += [node, carrier, *carrier.peers(), node._transport._identity(b"x", "")]
                seen += [node._transport._identity(token.encode(), "")]
                try:
                    await node.create_client(Add, "/add", timeout=5).call(ask(2, 3))
                    counts["let in"] += 1
                except taskrpc.TaskRpcError as error:
                    said += [str(error), repr(error), "".join(traceback.format_exception(error))]
                    answers.add(str(error))
                    counts["refused"] += 1
    for secret in (f"{CANARY}.", f"{CANARY}.x.y z"):
        with pytest.raises(taskrpc.TaskRpcError) as caught:
            Account("bo", secret)
        said += ["".join(traceback.format_exception(caught.value))]
    counts["looked at"] = len(seen) + len(said) + len(caplog.records)
    texts = [f"{each!r} {each}" for each in seen]
    counts["in a repr"] += sum(CANARY in text for text in texts)
    counts["in an error"] += sum(CANARY in text for text in said)
    counts["in the log"] += CANARY in caplog.text
    counts["proofs"] = comparisons.received
    counts["compared by hand"] = comparisons.by_hand
    counts["not compared in constant time"] = max(
        0, comparisons.received - comparisons.in_constant_time
    )
    counts["answers that differ"] += len(answers) - 1
    counts.check(
        "in a repr",
        "in an error",
        "in the log",
        "compared by hand",
        "not compared in constant time",
        "answers that differ",
        happened=("refused", "let in", "looked at"),
    )
    counts.require(let_in=2, refused=3, proofs=7)


def sends_the_token(patch):
    known = handshake.ClientHandshake.start
    patch(
        handshake.ClientHandshake,
        "start",
        lambda self: known(
            handshake.ClientHandshake(
                handshake.msgspec.structs.replace(self._me, name=self._me.token.decode())
            )
        ),
    )


@pytest.mark.planted(Bug(sends_the_token, "on the wire"))
async def test_secrets_are_not_sent(counts, monkeypatch):
    sent, write = [], pipe.Pipe.write
    monkeypatch.setattr(
        pipe.Pipe, "write", lambda pipe, data: sent.append(bytes(data)) or write(pipe, data)
    )
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as client,
    ):
        server._transport.network._hub.token = CANARY.encode()
        for each in (server, client):
            each._transport.network.token = CANARY.encode()
        server.create_service(Add, "add", add)
        await client.create_client(Add, "/add", timeout=5).call(ask(2, 3))
    counts["bytes seen"] = sum(map(len, sent))
    counts["on the wire"] += CANARY.encode() in b"".join(sent)
    counts.check("on the wire", happened=("bytes seen",))


def leaves_files_open(patch):
    from taskrpc.core.system import private_files

    def open_private(path, **options):
        made = os.open(path, os.O_RDWR | os.O_CREAT, 0o644, dir_fd=options.get("dir_fd"))
        os.fchmod(made, 0o644)
        return made

    patch(private_files, "open_private", open_private)


SERVER = """\
import sys
from taskrpc.cli.robot.server.command_line import main
print("ready", flush=True)
sys.exit(main(sys.argv[1:]))
"""


@posix
@pytest.mark.planted(Bug(leaves_files_open, "readable by others"))
async def test_commands_do_not_reveal_secrets_of_their_files(counts, programs, tmp_path):
    runtime = Path(os.environ["XDG_RUNTIME_DIR"])
    token, people = tmp_path / "token", tmp_path / "accounts.json"
    token.write_text(CANARY)
    people.write_text(json.dumps({"accounts": {"ana": {"secret": ACCOUNT.secret}}}))
    token.chmod(0o600)
    people.chmod(0o600)
    files = ["--token-file", str(token), "--accounts", str(people)]
    options = ["--db", ":memory:", "--log-level", "debug", "--log-format", "json", *files]
    server = await programs.start(SERVER, *options, name="server.py")
    place = ""
    while not place:
        line = server.stderr.readline()
        assert line, "the server ended"
        place = json.loads(line)["message"].partition(" at ")[2] if "ready:" in line else ""
    mine = tmp_path / "mine"
    mine.write_text(ACCOUNT.token)
    mine.chmod(0o600)
    wrong = tmp_path / "wrong"
    wrong.write_text(f"ana.{CANARY}-wrong")
    wrong.chmod(0o600)
    texts, listing = [], ["task", "list", "--connect", place]
    for secret, exits in ((mine, 0), (wrong, 1)):
        found = subprocess.run(
            [sys.executable, "-m", "taskrpc", *listing, "--token-file", str(secret)],
            env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(tmp_path / "far")},
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        assert found.returncode == exits, found.stderr
        texts.append(found.stdout + found.stderr)
        counts["commands"] += 1
    shown = subprocess.run(["ps", "-ww", "-o", "args", "-p", str(server.pid)], **CAPTURED)
    counts["in ps"] += CANARY in shown.stdout
    for path in runtime.rglob("*"):
        if path.is_file():
            counts["files"] += 1
            counts["readable by others"] += bool(stat.S_IMODE(path.stat().st_mode) & 0o077)
    server.terminate()
    texts += server.communicate(timeout=20)
    counts["log lines"] = texts[-1].count("\n")
    counts["in output"] += sum(CANARY in text for text in texts)
    counts.check(
        "in ps", "in output", "readable by others", happened=("commands", "files", "log lines")
    )


def believes_open_files(patch):
    from taskrpc.core.system import private_files

    patch(private_files, "why_not_private", lambda *_, **options: "")


@posix
@pytest.mark.planted(Bug(believes_open_files, "taken although others can read it"))
def test_secret_file_that_others_can_read_is_refused(counts, tmp_path, capsys):
    from taskrpc.cli.main import main

    for mode in (0o600, 0o400, 0o640, 0o644, 0o602, 0o666):
        token, people = tmp_path / f"token-{mode:o}", tmp_path / f"people-{mode:o}.json"
        token.write_text(CANARY)
        people.write_text(json.dumps({"accounts": {"ana": {"secret": ACCOUNT.secret}}}))
        for path in (token, people):
            path.chmod(mode)
        options = ["--connect", "127.0.0.1:9", "--token-file", str(token)]
        assert main(["service", "list", *options]) in (0, 1, 4)
        said = "".join(capsys.readouterr())
        try:
            accounts_module.read_accounts(people)
        except taskrpc.TaskRpcError as error:
            said_of_accounts = str(error)
        else:
            said_of_accounts = ""
        for told in (said, said_of_accounts):
            refused = "chmod 600" in told
            counts["refused"] += refused
            counts["taken"] += not refused
            counts["refused although private"] += refused and not mode & 0o077
            counts["taken although others can read it"] += not refused and bool(mode & 0o077)
            assert CANARY not in told
    counts.check(
        "refused although private", "taken although others can read it", happened=("taken",)
    )
    counts.require(refused=8, taken=4)


def writes_for_everybody(patch):
    from taskrpc.core.system import private_files

    def write_private(path, content, *, sync=True):
        path.write_bytes(content)
        path.chmod(0o644)

    patch(private_files, "write_private", write_private)


@posix
@pytest.mark.planted(
    Bug(leaves_files_open, "readable by others"), Bug(writes_for_everybody, "readable by others")
)
def test_files_of_a_class_cannot_be_read_by_others(counts, tmp_path):
    """Under every umask, and also if their folder is readable by others."""
    from taskrpc.course.classroom.authority import make_certificates
    from taskrpc.course.classroom.class_server import ClassServer
    from taskrpc.course.classroom.register import Register

    before = os.umask(0)
    try:
        lab = tmp_path / "lab"
        register = Register(lab)
        register.server = ClassServer(("192.0.2.7",), 7450)
        make_certificates(lab, ["localhost"], datetime.datetime.now(datetime.UTC))
        register.add(["ana"], expires=0.0)
    finally:
        os.umask(before)
    for path in lab.rglob("*"):
        counts["files"] += 1
        counts["readable by others"] += bool(stat.S_IMODE(path.stat().st_mode) & 0o077)
    counts.check("readable by others")
    counts.require(files=6)
