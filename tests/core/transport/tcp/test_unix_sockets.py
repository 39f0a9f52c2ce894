"""Only its user can reach a Unix socket, with any umask; a dead server's socket is replaced."""

import contextlib
import os
import socket
import stat
import tempfile
from pathlib import Path

import pytest

import taskrpc
from taskrpc import Account, Accounts
from taskrpc.core.system import file_locks, folders
from taskrpc.core.transport.tcp import unix_sockets
from taskrpc.core.transport.tcp.unix_sockets import peer_user
from tests.core.transport.helpers import Add, add, ask, outcome

HAS_UNIX = hasattr(socket, "AF_UNIX") and os.name == "posix"
pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(not HAS_UNIX, reason="no unix sockets on this system"),
]

ANA = Account("ana", "anas-secret-of-27-characters")


@pytest.fixture
def folder():
    # pytest's folders have names that are too long for a socket's path on macOS.
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


@contextlib.contextmanager
def umask(mask):
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


async def call(node):
    return await outcome(node.create_client(Add, "/add", timeout=5).call(ask(2, 3)))


@pytest.mark.parametrize("mask", [0o000, 0o022, 0o077, 0o177])
async def test_the_umask_cannot_open_a_socket_to_other_users(folder, mask):
    path = folder / "deep" / "robot.sock"
    (folder / "deep").mkdir(mode=0o700)
    with umask(mask):
        async with taskrpc.Node("server", listen=f"unix:{path}") as server:
            server.create_service(Add, "add", add)
            assert server.address == f"unix:{path}"
            assert (mode(path), mode(path.parent)) == (0o600, 0o700)
            assert stat.S_ISSOCK(path.stat().st_mode)
    assert not list(path.parent.iterdir())


async def test_a_folder_that_is_missing_is_made_for_its_user_only(folder):
    path = folder / "new" / "robot.sock"
    with umask(0o000):
        async with taskrpc.Node("server", listen=f"unix:{path}") as server:
            server.create_service(Add, "add", add)
            assert mode(path.parent) == 0o700


async def test_programs_of_the_user_find_it_and_call(folder):
    async with (
        taskrpc.Node("server", listen=f"unix:{folder}/robot.sock") as server,
        taskrpc.Node("local") as local,
    ):
        server.create_service(Add, "add", add)
        assert (await call(local)).sum == 5
        assert [each.address for each in await local.graph() if each.services] == [server.address]


async def test_the_socket_alone_is_enough_for_the_user_where_the_registry_is_another(
    folder, monkeypatch
):
    async with taskrpc.Node("server", listen=f"unix:{folder}/robot.sock") as server:
        server.create_service(Add, "add", add)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
        async with taskrpc.Node("cron", peers=[server.address]) as cron:
            assert (await call(cron)).sum == 5


async def test_unix_alone_is_a_socket_in_the_runtime_folder():
    async with (
        taskrpc.Node("server", listen="unix:") as server,
        taskrpc.Node("local") as local,
    ):
        server.create_service(Add, "add", add)
        path = Path(server.address.removeprefix("unix:"))
        assert path.parent == folders.runtime_dir()
        assert (await call(local)).sum == 5
    assert not path.exists()


async def test_accounts_are_recognised_on_a_unix_socket(folder):
    seen = []

    def look(request, response):
        seen.append(taskrpc.current_call().principal)
        return response

    place = f"unix:{folder}/robot.sock"
    async with (
        taskrpc.Node("server", listen=place, accounts=Accounts([ANA])) as server,
        taskrpc.Node("ana", peers=[place], token=ANA.token) as ana,
    ):
        server.create_service(Add, "add", look)
        await call(ana)
    assert seen == ["ana"]


async def test_the_system_identifies_and_refuses_another_user(folder, monkeypatch):
    monkeypatch.setattr(unix_sockets, "peer_user", lambda sock: os.getuid() + 1)
    place = f"unix:{folder}/robot.sock"
    async with (
        taskrpc.Node("server", listen=place) as server,
        taskrpc.Node("other") as other,  # has the token from the registry, and is still refused
    ):
        server.create_service(Add, "add", add)
        assert isinstance(await call(other), taskrpc.TaskRpcError)
        assert server.status().accepted.ended == {"PermissionDenied": 1}


async def test_another_user_may_call_with_an_account_but_not_without(folder, monkeypatch):
    place = f"unix:{folder}/robot.sock"
    async with taskrpc.Node("server", listen=place, accounts=Accounts([ANA])) as server:
        server.create_service(Add, "add", add)
        monkeypatch.setattr(unix_sockets, "peer_user", lambda sock: os.getuid() + 1)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
        async with (
            taskrpc.Node("ana", peers=[place], token=ANA.token) as ana,
            taskrpc.Node("eve", peers=[place]) as eve,
        ):
            assert (await call(ana)).sum == 5
            assert isinstance(await call(eve), taskrpc.AuthenticationFailed)


def test_the_system_identifies_the_peer():
    left, right = socket.socketpair(socket.AF_UNIX)
    with left, right:
        assert peer_user(left) in (os.getuid(), None)


async def test_the_socket_of_a_dead_server_is_replaced(folder):
    path = folder / "robot.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    async with (
        taskrpc.Node("server", listen=f"unix:{path}") as server,
        taskrpc.Node("local") as local,
    ):
        server.create_service(Add, "add", add)
        assert (await call(local)).sum == 5


async def test_the_socket_of_a_living_server_is_left_alone(folder):
    place = f"unix:{folder}/robot.sock"
    async with (
        taskrpc.Node("first", listen=place) as first,
        taskrpc.Node("second", listen=place, token="of its own") as second,
        taskrpc.Node("local") as local,
    ):
        first.create_service(Add, "add", add)
        with pytest.raises(taskrpc.CannotListen, match="another server listens there"):
            second.create_service(Add, "other", add)
        assert (await call(local)).sum == 5


async def test_a_server_that_ends_late_leaves_its_successors_socket_alone(folder):
    path = folder / "robot.sock"
    async with (
        taskrpc.Node("first", listen=f"unix:{path}") as first,
        taskrpc.Node("second", listen=f"unix:{path}", token="of its own") as second,
        taskrpc.Node("local", peers=[f"unix:{path}"]) as local,
    ):
        first.create_service(Add, "first", add)
        # The first server closes its socket, but removes the file after the second has started.
        first._transport.network._listener._sock.close()
        second.create_service(Add, "add", add)
        await first.destroy()
        assert (await call(local)).sum == 5
        assert path.exists()
    assert not list(folder.iterdir())


@pytest.mark.parametrize("kind", ["file", "open folder", "link"])
def test_only_sockets_of_this_user_are_replaced(folder, kind):
    path = folder / "robot.sock"
    if kind == "file":
        path.write_text("precious")
    elif kind == "open folder":
        folder.chmod(0o755)
    else:
        (folder / "elsewhere").mkdir(mode=0o700)
        (folder / "link").symlink_to(folder / "elsewhere")
        path = folder / "link" / "robot.sock"
    with pytest.raises(taskrpc.CannotListen, match=f"cannot listen at unix:{path}: "):
        unix_sockets.bound_unix(f"unix:{path}", "")
    if kind == "file":
        assert path.read_text() == "precious"
    if kind == "open folder":
        assert mode(folder) == 0o755


def test_nothing_is_removed_from_another_folder_that_takes_the_checked_ones_place(
    folder, monkeypatch
):
    """As a user can do who may write to the folder above."""
    own, other = folder / "own", folder / "other"
    other.mkdir(mode=0o755)
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(other / "robot.sock"))
    (other / "robot.sock").chmod(0o666)
    lock = file_locks.lock

    def lock_and_replace(descriptor):
        lock(descriptor)
        own.rename(folder / "away")
        own.symlink_to(other)

    monkeypatch.setattr(file_locks, "lock", lock_and_replace)
    with pytest.raises(taskrpc.CannotListen, match="cannot listen at"):
        unix_sockets.bound_unix(f"unix:{own}/robot.sock", "")
    assert (mode(other / "robot.sock"), mode(other)) == (0o666, 0o755)


def test_a_path_that_is_too_long_is_one_sentence(folder):
    with pytest.raises(taskrpc.CannotListen, match="too long"):
        unix_sockets.bound_unix(f"unix:{folder}/{'x' * 200}", "")


def test_a_socket_to_call_needs_its_path():
    with pytest.raises(taskrpc.TaskRpcError, match=r"expected unix:/path .*, got unix: alone"):
        unix_sockets.checked_unix("unix:")


def test_windows_users_get_one_clear_sentence(monkeypatch):
    monkeypatch.delattr(socket, "AF_UNIX")
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        unix_sockets.checked_unix("unix:/run/robot.sock")
    sentence = "unix:/run/robot.sock: Python has no unix sockets on Windows; use 127.0.0.1:PORT"
    assert str(caught.value) == sentence
