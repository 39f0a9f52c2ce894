"""Promise 24: another user of the machine can neither read the token nor call."""

import asyncio
import json
import os
import subprocess
import tempfile
from pathlib import Path

import pytest

from tests.faults.harness import Bug
from tests.faults.programs import ROOT
from tests.faults.test_22_attacker import any_proof_accepted

IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(not IS_ROOT, reason="needs root, to become another user"),
]

SERVER = """\
import os, sys
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")

async def main():
    async with taskrpc.Node("tcp") as tcp, taskrpc.Node("unix", listen="unix:") as unix:
        for node in (tcp, unix):
            node.create_service(Add, node.get_name(), lambda request, response: response)
        print("ready", tcp.address, unix.address, flush=True)
        await tcp.spin()

os.umask(0)
taskrpc.run(main())
"""

OTHER = """\
import asyncio, json, os, pathlib, sys, tempfile
import srvgen, taskrpc
from tests.faults.attacker import Attacker, broken_handshakes, knowing, proving
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
runtime, *places = sys.argv[1:]

async def call(place, service, token):
    async with taskrpc.Node("other", peers=[place], token=token) as node:
        try:
            await node.create_client(Add, service, timeout=5).call(Add.Request())
        except taskrpc.TaskRpcError as error:
            return type(error).__name__
    return "called"

WAYS = broken_handshakes("guess") | {
    "zeros": proving("", lambda line: bytes(32)),
    "a guess": knowing("guess"),
    "the empty token": knowing(""),
    "an account": knowing("eve.guess", "eve"),
}

async def attack(place, service):
    # How many raw attempts there were, and how many of them the server took for proved.
    heard = [await Attacker(place, service).attempt(way) for way in WAYS.values()]
    return len(heard), sum(each.let_in for each in heard)

async def main():
    # All that is imported late must be here before the files of Python are out of reach.
    async with taskrpc.Node("warm", transport="memory") as node:
        node.create_service(Add, "warm", lambda request, response: response)
        await node.create_client(Add, "warm").call(Add.Request())
    await call("127.0.0.1:9", "/none", "guess")
    await attack("127.0.0.1:9", "/none")
    own = tempfile.mkdtemp()
    os.chmod(own, 0o777)
    os.environ["XDG_RUNTIME_DIR"] = os.environ["XDG_STATE_HOME"] = own
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
    told = {"read": 0, "unreadable": 0, "called": 0, "refused": [], "attempts": 0, "let in": 0}
    for folder, folders, files in os.walk(runtime, onerror=lambda error: told.__setitem__(
        "unreadable", told["unreadable"] + 1
    )):
        for name in files:
            try:
                told["read"] += b"token" in pathlib.Path(folder, name).read_bytes()
            except OSError:
                told["unreadable"] += 1
    for place, service in zip(places, ("/tcp", "/unix")):
        for token in (None, "guess", "eve.guess"):
            what = await call(place, service, token)
            told["called"] += what == "called"
            told["refused"] += [what] if what != "called" else []
        attempts, let_in = await attack(place, service)
        told["attempts"] += attempts
        told["let in"] += let_in
    print(json.dumps(told), flush=True)

asyncio.run(main())
"""


def opens_the_registry(patch):
    """Folders and files with Python's default modes, under the umask of the server."""
    from taskrpc.core.system import private_files

    def private_dir(path):
        path.mkdir(parents=True, exist_ok=True)
        path.chmod(0o755)
        return path

    def open_private_dir(path, dir_fd=None):
        return os.open(private_dir(path), os.O_RDONLY)

    def open_private(path, must_be_new=False, dir_fd=None):
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o666, dir_fd=dir_fd)

    patch(private_files, "private_dir", private_dir)
    patch(private_files, "open_private_dir", open_private_dir)
    patch(private_files, "open_checked_dir", lambda path: os.open(path, os.O_RDONLY))
    patch(private_files, "open_private", open_private)


def opens_the_socket(patch):
    """A socket that every user may reach, without a check of the peer's user."""
    from taskrpc.core.system import private_files
    from taskrpc.core.transport.tcp import tcp_network, unix_sockets

    opens_the_registry(patch)
    patch(
        private_files,
        "set_mode",
        lambda path, mode, dir_fd=None: os.chmod(path, mode | 0o666, dir_fd=dir_fd),
    )
    patch(
        tcp_network,
        "unix_peer_credentials",
        lambda sock, **options: unix_sockets.PeerCredentials("", is_owner=True),
    )


@pytest.fixture
def runtime():
    """A folder that every user may enter: its files must keep others out themselves."""
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        yield Path(made)


def makes_readable_files(patch):
    """Their folder still keeps others out, unless it is moved or copied."""
    from taskrpc.core.system import private_files

    known = private_files.open_private

    def open_private(path, **options):
        made = known(path, **options)
        os.fchmod(made, 0o644)
        return made

    patch(private_files, "open_private", open_private)


@pytest.mark.planted(
    Bug(opens_the_registry, "read the token"),
    Bug(makes_readable_files, "open to others"),
    Bug(opens_the_socket, "called"),
    Bug(any_proof_accepted, "let in"),
)
async def test_second_user_can_neither_read_the_token_nor_call(
    counts, programs, tmp_path, monkeypatch, runtime
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    server = await programs.start(SERVER, name="server.py")
    places = json.loads(await asyncio.to_thread(_addresses, runtime))
    script = tmp_path / "other.py"
    script.write_text(OTHER)
    found = await asyncio.to_thread(
        subprocess.run,
        programs.command(script, str(runtime), *places),
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(tmp_path / "warm")},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert server.poll() is None
    for path in runtime.rglob(
        "*"
    ):  # each separately: one barrier must not hide that another is missing
        counts["files"] += 1
        counts["open to others"] += bool(path.lstat().st_mode & 0o077)
    assert found.returncode == 0, found.stderr
    told = json.loads(found.stdout)
    counts["read the token"] += told["read"]
    counts["called"] += told["called"]
    counts["unreadable"] += told["unreadable"]
    counts["raw attempts"] += told["attempts"]
    counts["let in"] += told["let in"]
    counts["refused"] += len(told["refused"])
    broken = ("read the token", "open to others", "called", "let in")
    counts.check(*broken, happened=("unreadable", "refused"))
    counts.require(refused=6, raw_attempts=32, files=4)


def _addresses(runtime: Path) -> str:
    """The addresses where the server accepts calls, as root sees them."""
    from taskrpc.core.transport.discovery.registry import Registry

    entries = Registry(0).entries()
    places = {each.services[0].name: each.address for each in entries if each.services}
    return json.dumps([places["/tcp"], places["/unix"]])
