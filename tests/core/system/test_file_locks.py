"""A lock has one holder, and ends with it."""

import os
import threading

from taskrpc.core.system import file_locks, private_files


def test_a_lock_is_seen_by_others_and_ends_with_its_descriptor(tmp_path):
    one, other = (private_files.open_private(tmp_path / "f") for _ in range(2))
    assert not file_locks.is_locked(other)
    file_locks.lock(one)
    assert file_locks.is_locked(other)
    assert not file_locks.try_lock(other)
    os.close(one)
    assert not file_locks.is_locked(other)
    assert file_locks.try_lock(other)
    os.close(other)


def test_checking_a_lock_does_not_take_it(tmp_path):
    one, other, third = (private_files.open_private(tmp_path / "f") for _ in range(3))
    if os.name == "posix":
        assert not file_locks.is_locked(other)
        assert not file_locks.is_locked(third)
        os.close(other)
    os.close(third)
    assert file_locks.try_lock(one)
    os.close(one)


def test_a_lock_file_is_held_by_one_at_a_time(tmp_path):
    inside, most = [], []

    def enter():
        for _ in range(20):
            with file_locks.locked(tmp_path / "lock"):
                inside.append(1)
                most.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=enter) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 1
