"""One process has the lock of a file; the lock file names it and counts the transactions."""

import os
import pickle
import re
import stat

import pytest

from taskrpc.core.storage.lock import CommitCount, FileInUse, Lock
from taskrpc.core.system import file_locks

STORE = CommitCount(bytes(range(16)), 7)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tasks.db"


def test_second_process_gets_the_name_of_the_process_with_the_file(path):
    lock = Lock(path, "task server")
    try:
        with pytest.raises(FileInUse) as caught:
            Lock(path, "task server")
    finally:
        lock.close()
    error = caught.value
    assert error.fact.startswith(f"{path} is in use by another task server (pid {os.getpid()}, ")
    assert str(error) == f"{error.fact}; stop that one, or give this one another file"
    copied = pickle.loads(pickle.dumps(error))
    assert (type(copied), copied.fact, str(copied)) == (FileInUse, error.fact, str(error))
    Lock(path, "task server").close()


def test_refused_lock_keeps_no_descriptor(path):
    lock = Lock(path, "task server")
    before = lowest_free_descriptor()
    for _ in range(3):
        with pytest.raises(FileInUse):
            Lock(path, "task server")
    assert lowest_free_descriptor() == before
    lock.close()


def lowest_free_descriptor():
    descriptor = os.open(os.devnull, os.O_RDONLY)
    os.close(descriptor)
    return descriptor


def test_lock_file_has_a_line_of_80_bytes_and_then_the_count(path):
    lock = Lock(path, "task server")
    assert lock.commit_count is None
    lock.note(STORE)
    lock.close()
    head, count = lock.path.read_bytes()[:80], lock.path.read_bytes()[80:]
    assert re.fullmatch(rb"pid \d+, since \d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d\d:\d\d *\n", head)
    assert count == b"store 000102030405060708090a0b0c0d0e0f, commit 00000000000000000007\n"
    again = Lock(path, "task server")
    assert again.commit_count == STORE
    again.close()


@pytest.mark.parametrize("length", [0, 1, 79, 81, 110, 147])
@pytest.mark.parametrize("end", [b"", b"\0" * 60])
def test_lock_file_that_a_machine_failure_cut_off_is_not_damaged(path, length, end):
    whole = Lock(path, "task server")
    whole.note(STORE)
    whole.close()
    whole.path.write_bytes(whole.path.read_bytes()[:length] + end)
    lock = Lock(path, "task server")
    assert (lock.is_damaged, lock.commit_count) == (False, None)
    lock.close()


@pytest.mark.parametrize("contents", [b"garbage", b"\0" * 80 + b"store 0001"])
def test_lock_file_with_other_contents_is_damaged_until_the_next_note(path, contents):
    whole = Lock(path, "task server")
    whole.close()
    whole.path.write_bytes(contents)
    for _ in range(2):
        lock = Lock(path, "task server")
        assert (lock.is_damaged, lock.commit_count) == (True, None)
        lock.close()
        assert lock.path.read_bytes() == contents
    lock = Lock(path, "task server")
    lock.note(STORE)
    lock.close()
    again = Lock(path, "task server")
    assert (again.is_damaged, again.commit_count) == (False, STORE)
    again.close()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights")
def test_lock_file_of_an_earlier_program_becomes_private(path):
    earlier = Lock(path, "task server")
    earlier.path.chmod(0o644)
    earlier.close()
    lock = Lock(path, "task server")
    assert stat.S_IMODE(lock.path.stat().st_mode) == 0o600
    lock.close()


def test_count_that_cannot_be_written_refuses_no_change(path, monkeypatch):
    lock = Lock(path, "task server")

    def full(*_):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(file_locks, "write_at", full)
    lock.note(STORE)
    lock.close()


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_link_in_the_place_of_the_lock_file_changes_no_mode(path, monkeypatch):
    """As a user can put there who may write to the folder."""
    precious = path.with_name("precious")
    precious.touch(0o644)
    try_lock = file_locks.try_lock

    def lock_and_replace(descriptor):
        place = path.with_name("tasks.db.lock")
        place.unlink()
        place.symlink_to(precious)
        return try_lock(descriptor)

    monkeypatch.setattr(file_locks, "try_lock", lock_and_replace)
    lock = Lock(path, "task server")
    assert lock.is_lost
    lock.close()
    assert stat.S_IMODE(precious.stat().st_mode) == 0o644
