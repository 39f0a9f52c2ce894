"""Through its private folder, the registry changes and removes nothing else.

Nothing that is not an entry is removed, and no link is followed.
"""

import asyncio
import contextlib
import logging
import os
import shutil
import stat
import sys
from pathlib import Path

import pytest

import taskrpc
from taskrpc.core.system import file_locks, folders, private_files
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.journal import line_of
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.transport.tcp.tcp_network import ENTRY_CHECK, TcpNetwork

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="an open folder cannot be replaced on Windows"
)
IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
NAMES = ("1-dead.json", "2-notes.json", "lock", "web-7.page")


def entry(script="adder.py"):
    return RegistryEntry(pid=os.getpid(), script=script, folder="/", since=1.0)


def publish(registry):
    registry.publish(TrackedEntry(entry()), EntryChange())


def scripts(registry):
    return [each.script for each in registry.entries()]


def the_folder():
    return folders.runtime_dir() / "domain_0"


@pytest.fixture
def registry():
    registry = Registry(0)
    yield registry
    registry.close()


@pytest.fixture
def victim(tmp_path):
    """A folder with the files of another program, one of which looks like a dead entry."""
    folder = tmp_path / "victim"
    folder.mkdir(mode=0o755)
    for name in NAMES:
        (folder / name).write_bytes(line_of(1, entry("victim.py")))
    (folder / "2-notes.json").write_bytes(b'{"notes": 1}')
    for name in NAMES:
        os.utime(folder / name, (1, 1))
        (folder / name).chmod(0o644)
    return folder


def state(folder):
    """Return the contents, times and modes of a folder's files, and its own mode."""
    files = {
        path.name: (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_mode)
        for path in folder.iterdir()
    }
    return files, stat.S_IMODE(folder.stat().st_mode)


def put_link(path, target):
    """Put a link in the place of a folder, which is moved away."""
    path.rename(path.with_name(f"{path.name}-moved"))
    path.symlink_to(target)


def use(registry):
    """Do everything that a program does with the registry; it may be refused."""
    for work in (
        registry.entries,
        registry.signature,
        lambda: publish(registry),
        registry.others,
        registry.close,
    ):
        with contextlib.suppress(taskrpc.TaskRpcError):
            work()


@pytest.mark.parametrize("is_published", [True, False])
def test_a_link_in_place_of_the_folder_changes_no_other_folder(registry, victim, is_published):
    if is_published:
        publish(registry)
    before = state(victim)
    put_link(the_folder(), victim)
    use(registry)
    assert state(victim) == before


def test_a_link_in_place_of_the_folder_above_changes_no_other_folder(registry, victim):
    publish(registry)
    inner = victim / "domain_0"
    shutil.copytree(victim, inner)
    before = state(inner)
    put_link(folders.runtime_dir(), victim)
    use(registry)
    assert state(inner) == before


@pytest.mark.parametrize(
    ("function", "after"), [("is_locked", 1), ("is_locked", 2), ("lock", 1), ("lock", 2)]
)
def test_a_link_put_there_between_two_steps_changes_no_other_folder(
    registry, victim, function, after
):
    """The link appears at the n-th look at a lock, or at the n-th wait for one."""
    before = state(victim)
    for name in NAMES:
        (the_folder() / name).write_bytes(line_of(1, entry("dead.py")))
    known, calls = getattr(file_locks, function), []

    def swap(descriptor):
        calls.append(descriptor)
        if len(calls) == after:
            put_link(the_folder(), victim)
        return known(descriptor)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(file_locks, function, swap)
        use(registry)
    assert the_folder().is_symlink()
    assert state(victim) == before


def test_a_program_says_once_why_it_finds_no_others(registry, victim, caplog):
    publish(registry)
    put_link(the_folder(), victim)
    with caplog.at_level(logging.WARNING, "taskrpc"):
        assert [scripts(registry) for _ in range(3)] == [["adder.py"]] * 3
    assert [each.getMessage() for each in caplog.records] == [
        f"this program and others do not find each other: {the_folder()}: expected a folder of"
        " this user's, found a link or a file"
    ]
    with pytest.raises(taskrpc.TaskRpcError, match="found a link or a file"):
        publish(registry)


def dead(path):
    path.write_bytes(line_of(1, entry("dead.py")))


def link(path):
    target = path.with_name("target")
    dead(target)
    path.symlink_to(target)


def hard_link(path):
    target = path.with_name("target")
    dead(target)
    path.hardlink_to(target)


def huge(path):
    path.touch()
    os.truncate(path, 2**40)


STRANGE = {
    "link": link,
    "link to nothing": lambda path: path.symlink_to(path.with_name("nothing")),
    "hard link": hard_link,
    "pipe": os.mkfifo if hasattr(os, "mkfifo") else None,
    "folder": Path.mkdir,
    "huge file": huge,
    "empty file": Path.touch,
    "JSON of another program": lambda path: path.write_text('{"notes": 1}'),
    "a change without an entry": lambda path: path.write_bytes(line_of(1, EntryChange(node="/a"))),
    "half an entry": lambda path: path.write_bytes(line_of(1, entry())[:-1]),
    "bytes": lambda path: path.write_bytes(b"\xff" * 99),
}


@pytest.mark.parametrize("make", STRANGE.values(), ids=STRANGE)
def test_only_the_entry_of_a_dead_process_is_removed(registry, make):
    path = the_folder() / "1-strange.json"
    make(path)
    before = path.lstat()
    dead(the_folder() / "2-dead.json")
    publish(registry)
    for _ in range(2):
        assert scripts(registry) == ["adder.py"]
    after = path.lstat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert not (the_folder() / "2-dead.json").exists()


def test_a_file_that_is_no_entry_is_looked_at_under_the_lock_only_once(registry, monkeypatch):
    (the_folder() / "1-strange.json").write_text("notes")
    assert scripts(registry) == []
    locks = []
    monkeypatch.setattr(file_locks, "lock", locks.append)
    assert scripts(registry) == []
    assert locks == []
    dead(the_folder() / "1-strange.json")
    assert scripts(registry) == []
    assert len(locks) == 1
    assert not (the_folder() / "1-strange.json").exists()


def test_a_lock_file_that_is_a_link_is_refused_and_its_target_is_unchanged(registry, victim):
    before = state(victim)
    dead(the_folder() / "2-dead.json")
    (the_folder() / "lock").symlink_to(victim / "lock")
    assert scripts(registry) == []
    with pytest.raises(taskrpc.TaskRpcError, match=r"cannot lock .*/lock: "):
        publish(registry)
    assert state(victim) == before


@pytest.mark.parametrize("make", [Path.symlink_to, Path.hardlink_to])
def test_a_link_in_place_of_the_own_file_changes_no_other_file(registry, victim, make):
    publish(registry)
    [own] = the_folder().glob("*.json")
    own.unlink()
    make(own, victim / "lock")
    before = state(victim)
    publish(registry)
    registry.close()
    content, times, mode = state(victim)[0]["lock"]
    assert (content, mode) == (before[0]["lock"][0], before[0]["lock"][2])
    if make is Path.symlink_to:
        assert times == before[0]["lock"][1]


@pytest.mark.parametrize("remove", [shutil.rmtree, lambda path: path.rename(f"{path}-moved")])
@pytest.mark.parametrize("above", [False, True])
def test_a_program_enters_a_folder_that_was_made_anew(registry, remove, above):
    publish(registry)
    remove(the_folder().parent if above else the_folder())
    other = Registry(0)
    assert scripts(other) == []
    registry.signature()  # as a program does that waits for a service
    assert scripts(other) == ["adder.py"]
    other.close()


def test_a_change_after_the_folder_was_removed_is_published_with_the_whole_entry(registry):
    tracked = TrackedEntry(entry())
    registry.publish(tracked, EntryChange(node="/a"))
    shutil.rmtree(folders.runtime_dir())
    registry.publish(tracked, EntryChange(node="/b"))
    other = Registry(0)
    assert [each.nodes for each in other.entries()] == [("/a", "/b")]
    assert stat.S_IMODE(the_folder().stat().st_mode) == 0o700
    other.close()


def remove_runtime_folder(path):
    shutil.rmtree(path.parent)


def remove_files(path):
    for each in path.iterdir():
        each.unlink()


@pytest.mark.parametrize("remove", [remove_runtime_folder, shutil.rmtree, remove_files])
async def test_an_idle_server_is_found_again_after_its_entry_was_removed(remove):
    network, other = TcpNetwork(domain=0), Registry(0)
    await network.open()
    network.publish(TrackedEntry(entry()), EntryChange())
    for _ in range(2):
        remove(the_folder())
        assert scripts(other) == []
        await asyncio.sleep(ENTRY_CHECK)
        assert scripts(other) == ["adder.py"]
    network.close()
    await asyncio.sleep(ENTRY_CHECK)
    assert scripts(other) == []
    other.close()


async def test_an_idle_server_says_once_why_its_entry_cannot_be_written(victim, caplog):
    network = TcpNetwork(domain=0)
    await network.open()
    network.publish(TrackedEntry(entry()), EntryChange())
    put_link(the_folder(), victim)
    await asyncio.sleep(3 * ENTRY_CHECK)
    network.close()
    assert [each.getMessage() for each in caplog.records] == [
        f"this program and others do not find each other: {the_folder()}: expected a folder of"
        " this user's, found a link or a file"
    ]


async def test_a_server_whose_unix_socket_was_removed_says_once_what_to_do(caplog):
    network = TcpNetwork(domain=0, listen="unix:")
    await network.open()
    path = network.listen(asyncio.BufferedProtocol).removeprefix("unix:")
    await asyncio.sleep(ENTRY_CHECK)
    assert caplog.records == []
    shutil.rmtree(folders.runtime_dir())
    await asyncio.sleep(3 * ENTRY_CHECK)
    await network.stop_listening()
    network.close()
    assert [each.getMessage() for each in caplog.records] == [
        f"the socket {path} was removed: no program can call this one until it is restarted"
    ]


@pytest.mark.skipif(not IS_ROOT, reason="needs root, to give a folder to another user")
@pytest.mark.parametrize("above", [False, True])
def test_a_folder_of_another_user_is_refused_at_the_start_and_later(registry, above):
    publish(registry)
    the_path = the_folder()
    folder = the_path.parent if above else the_path
    shutil.rmtree(folder)
    the_path.mkdir(parents=True)
    os.chown(folder, 65534, 65534)
    with pytest.raises(taskrpc.TaskRpcError, match="belongs to another user"):
        Registry(0)
    assert scripts(registry) == ["adder.py"]
    with pytest.raises(taskrpc.TaskRpcError, match="belongs to another user"):
        publish(registry)
    assert list(the_path.iterdir()) == []


@pytest.mark.skipif(not IS_ROOT, reason="needs root, to give a file to another user")
def test_an_entry_of_another_user_is_not_believed(registry):
    path = the_folder() / "1-forged.json"
    descriptor = private_files.open_private(path)
    file_locks.lock(descriptor)
    os.write(descriptor, line_of(1, entry("forged.py")))
    assert scripts(registry) == ["forged.py"]
    os.chown(path, 65534, 65534)
    assert scripts(registry) == []
    os.close(descriptor)
    assert scripts(registry) == []
    assert path.exists()


def test_an_opened_folder_uses_one_descriptor_until_it_is_closed():
    def count():
        return len(os.listdir("/dev/fd"))

    before = count()
    registries = [Registry(0) for _ in range(3)]
    for each in registries:
        publish(each)
    assert count() == before + 6
    registries[0].close()
    assert count() == before + 4
    del each
    registries.clear()
    # The journals stay open, as a killed process leaves them.
    assert count() == before + 2
