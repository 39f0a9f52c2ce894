"""Folders are the user's alone, locks end with their holder, signals reach everybody who asked."""

import asyncio
import importlib.util
import os
import signal
import stat
import subprocess
import sys
import threading
from platform import libc_ver

import pytest

import taskrpc
from taskrpc.core import platform

posix = pytest.mark.skipif(os.name != "posix", reason="modes and owners are POSIX's")


def test_places_follow_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "r"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "s"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "c"))
    assert platform.runtime_dir() == tmp_path / "r" / "taskrpc"
    assert platform.state_dir() == tmp_path / "s" / "taskrpc"
    assert platform.cache_dir() == tmp_path / "c" / "taskrpc"


@posix
def test_without_xdg_the_runtime_folder_is_the_users_in_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    folder = platform.runtime_dir()
    assert folder == tmp_path / f"taskrpc-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@posix
def test_private_folder_is_closed_to_other_users_with_any_umask(tmp_path):
    before = os.umask(0)
    try:
        assert stat.S_IMODE(platform.private_dir(tmp_path / "a").stat().st_mode) == 0o700
        (tmp_path / "b").mkdir(mode=0o777)
        assert stat.S_IMODE(platform.private_dir(tmp_path / "b").stat().st_mode) == 0o700
        descriptor = platform.open_private(tmp_path / "f")
        assert stat.S_IMODE(os.fstat(descriptor).st_mode) == 0o600
        os.close(descriptor)
    finally:
        os.umask(before)


@posix
def test_owners_and_open_folders_are_recognised(tmp_path, monkeypatch):
    tmp_path.chmod(0o755)
    assert not platform.is_writable_by_all(tmp_path)
    tmp_path.chmod(0o1777)
    assert platform.is_writable_by_all(tmp_path)
    assert not platform.is_writable_by_all(tmp_path / "missing")
    tmp_path.chmod(0o700)
    found = tmp_path.stat()
    assert platform.is_ours_or_roots(found)
    monkeypatch.setattr(os, "getuid", lambda: found.st_uid + 1)
    assert platform.is_ours_or_roots(found) == (found.st_uid == 0)
    changed = list(found)
    changed[4] = found.st_uid + 7
    assert not platform.is_ours_or_roots(os.stat_result(changed))


@posix
def test_folder_of_another_user_or_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "target").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "target")
    for name in ("file", "link", "file/below"):
        with pytest.raises(taskrpc.TaskRpcError, match="folder"):
            platform.private_dir(tmp_path / name)
    (tmp_path / "to").symlink_to(tmp_path / "file")
    with pytest.raises(OSError, match=r"[Ss]ymbolic|[Ll]ink|ELOOP"):
        platform.open_private(tmp_path / "to")


@pytest.mark.skipif(sys.platform == "win32", reason="file modes are POSIX's")
def test_private_file_is_private_from_its_first_byte_also_in_place_of_another(tmp_path):
    path = tmp_path / "secret"
    waiting = tmp_path / f"secret.{os.getpid()}.new"
    waiting.write_text("another program's")
    waiting.chmod(0o666)
    others = os.open(waiting, os.O_RDONLY)
    modes = []
    fsync = os.fsync

    def look(descriptor):
        modes.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        fsync(descriptor)

    before = os.umask(0)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", look)
            platform.write_private(path, b"the secret")
    finally:
        os.umask(before)
    assert modes == [0o600]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert os.read(others, 100) == b"another program's"
    os.close(others)


@posix
def test_private_file_stays_in_the_opened_folder_if_another_takes_its_place(tmp_path, monkeypatch):
    """As a user can do who may write to the folder above."""
    own, away, other = (tmp_path / name for name in ("own", "away", "other"))
    own.mkdir()
    other.mkdir()
    new = other / f"file.{os.getpid()}.new"
    new.write_bytes(b"another's")

    def replace(_):
        own.rename(away)
        own.symlink_to(other)

    monkeypatch.setattr(os, "fsync", replace)
    platform.write_private(own / "file", b"the secret")
    assert new.read_bytes() == b"another's"
    assert [(each.name, each.read_bytes()) for each in away.iterdir()] == [("file", b"the secret")]


@posix
def test_mode_of_a_links_target_is_not_set(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.touch(0o644)
    link.symlink_to(file)
    if sys.platform == "linux":  # macOS sets the mode of the link itself
        with pytest.raises(OSError, match="symbolic links"):
            platform.set_mode(link, 0o600)
    assert stat.S_IMODE(file.stat().st_mode) == 0o644
    platform.set_mode(file, 0o600)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


@posix
def test_setting_a_mode_keeps_the_locks_of_a_file(tmp_path):
    file = tmp_path / "file"
    look = (
        "import fcntl; f = open('file', 'r+')\n"
        "try: fcntl.lockf(f, fcntl.LOCK_EX | fcntl.LOCK_NB); print('free')\n"
        "except OSError: print('locked')"
    )
    with file.open("w") as held:
        import fcntl

        fcntl.lockf(held, fcntl.LOCK_EX)
        platform.set_mode(file, 0o600)
        seen = subprocess.run([sys.executable, "-c", look], cwd=tmp_path, capture_output=True)
    assert seen.stdout == b"locked\n"


def test_a_lock_is_seen_by_others_and_ends_with_its_descriptor(tmp_path):
    one, other = (platform.open_private(tmp_path / "f") for _ in range(2))
    assert not platform.is_locked(other)
    platform.lock(one)
    assert platform.is_locked(other)
    assert not platform.try_lock(other)
    os.close(one)
    assert not platform.is_locked(other)
    assert platform.try_lock(other)
    os.close(other)


def test_checking_a_lock_does_not_take_it(tmp_path):
    one, other, third = (platform.open_private(tmp_path / "f") for _ in range(3))
    if os.name == "posix":
        assert not platform.is_locked(other)
        assert not platform.is_locked(third)
        os.close(other)
    os.close(third)
    assert platform.try_lock(one)
    os.close(one)


def test_a_lock_file_is_held_by_one_at_a_time(tmp_path):
    inside, most = [], []

    def enter():
        for _ in range(20):
            with platform.locked(tmp_path / "lock"):
                inside.append(1)
                most.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=enter) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 1


@posix
def test_a_stop_signal_reaches_every_block_and_the_handlers_come_back():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    one, other = [], []
    with platform.stop_signals(one.append):
        with platform.stop_signals(other.append):
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert one == [signal.SIGTERM, signal.SIGINT]
    assert other == [signal.SIGTERM]
    assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]


@posix
def test_blocks_may_end_in_any_order():
    one, other = [], []
    before = signal.getsignal(signal.SIGTERM)
    first, second = platform.stop_signals(one.append), platform.stop_signals(other.append)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    signal.raise_signal(signal.SIGTERM)
    second.__exit__(None, None, None)
    assert (one, other) == ([], [signal.SIGTERM])
    assert signal.getsignal(signal.SIGTERM) is before


def test_outside_the_main_thread_signals_stay_as_they_are():
    before = signal.getsignal(signal.SIGTERM)
    seen = []

    def run():
        with platform.stop_signals(seen.append):
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [before]


@pytest.mark.real_time
def test_a_process_can_be_asked_to_end():
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as sleeping:
        platform.end_process(sleeping.pid)
        assert sleeping.wait(60) != 0
    ended_pid = sleeping.pid if os.name == "posix" else 0x7FFF_FFFC
    with pytest.raises(ProcessLookupError):
        platform.end_process(ended_pid)


def test_output_takes_any_character(capfd):
    program = (
        "from taskrpc.core import platform; platform.prepare_output(); print('é → \\U0001f916')"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, check=True
    )
    assert done.stdout.strip() == b"\\xe9 \\u2192 \\U0001f916"


_LARGE_MESSAGES = """
import resource, sys
from taskrpc.core import platform
if sys.argv[1] == "kept":
    platform.keep_freed_memory(16 * 2**20)
pages = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
before = pages()
for _ in range(20):
    parts = [bytearray(2**18) for _ in range(4)]
    message = b"".join(parts)
    del parts, message
print((pages() - before) // 20)
"""


@pytest.mark.skipif(libc_ver()[0] != "glibc", reason="this allocator gives nothing back")
def test_memory_of_large_messages_is_used_again():
    """Counts the pages that the system must make for each message of 1 MiB."""
    new_pages = {
        how: int(subprocess.check_output([sys.executable, "-c", _LARGE_MESSAGES, how]))
        for how in ("kept", "given back")
    }
    assert new_pages["kept"] < new_pages["given back"] / 4, new_pages


class _Console:
    """The Windows console: each key is the characters that it delivers.

    `kbhit` sees keys; the second character of a key is seen only together with the next key.
    """

    def __init__(self, *keys):
        self._keys = list(keys)
        self._second = ""

    def kbhit(self):
        return bool(self._keys)

    def getwch(self):
        if self._second:
            typed, self._second = self._second, ""
        else:
            typed, *rest = self._keys.pop(0)
            self._second = "".join(rest)
        return typed


async def test_special_keys_of_a_windows_console_are_no_letters(monkeypatch):
    page_down, alt_q = "\xe0Q", "\0\x10"
    console = _Console("a", page_down, "b", alt_q, page_down, "q")
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "stdin", _Terminal())
    source = importlib.util.spec_from_file_location("platform_of_windows", platform.__file__)
    windows = importlib.util.module_from_spec(source)
    source.loader.exec_module(windows)
    pressed = []
    with windows.keys_pressed(pressed.append):
        await asyncio.sleep(1.0)
    assert pressed == ["a", "b", "q"]


class _Terminal:
    """A standard input that is a terminal."""

    def fileno(self):
        return 0

    def isatty(self):
        return True
