"""Error texts for paths that are not safe for a store."""

import os
import sys

import pytest

from taskrpc.core.storage.lock import CommitCount, Lock
from taskrpc.core.storage.path_checks import refuse_lost_store, refuse_second_name
from taskrpc.errors import StoreError


@pytest.mark.parametrize(
    ("system", "command"), [("win32", "fsutil hardlink list"), ("linux", "find / -samefile")]
)
def test_second_name_is_refused_with_the_command_that_finds_it(
    tmp_path, monkeypatch, system, command
):
    path, other = tmp_path / "tasks.db", tmp_path / "other.db"
    path.touch()
    refuse_second_name(path)
    os.link(path, other)
    monkeypatch.setattr(sys, "platform", system)
    with pytest.raises(StoreError) as refused:
        refuse_second_name(path)
    assert f"(find it with `{command} {path}`)" in str(refused.value)


@pytest.mark.parametrize(
    ("commits", "text"), [(1, "a database of 1 transaction;"), (2, "a database of 2 transactions;")]
)
def test_refusal_of_a_lost_store_has_its_number_of_transactions(tmp_path, commits, text):
    path = tmp_path / "tasks.db"
    lock = Lock(path, "task server")
    lock.commit_count = CommitCount(b"S" * 16, commits)
    with pytest.raises(StoreError) as refused:
        refuse_lost_store(path, lock)
    lock.close()
    assert f"tasks.db.lock beside it belongs to {text}" in str(refused.value)
