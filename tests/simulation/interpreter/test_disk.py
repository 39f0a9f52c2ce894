"""The simulated disk: writes stay in the run, and a crash loses or tears what was not synced."""

from __future__ import annotations

import os
import random
import sqlite3
from pathlib import Path

import pytest

from taskrpc.simulation.interpreter.disk import Disk


class Program:
    def __init__(self, name="robot"):
        self.id = name


class Refused(Exception):
    pass


PROGRAM = Program()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "old.txt").write_bytes(b"old")
    return tmp_path


@pytest.fixture
def disk(folder):
    disk = Disk(folder, Refused)
    yield disk
    disk.close()


def write(disk, path, data, *, sync=False, owner=PROGRAM):
    """Write as a program does whose `open` and `fsync` are those of the disk."""
    place = disk.path(path, writes=True)
    before = Path(place).read_bytes() if os.path.exists(place) else None
    with open(place, "wb") as file:
        disk.opened(place, owner, before, file.fileno())
        file.write(data)
        file.flush()
        if sync:
            disk.synced(file.fileno())


def content(disk, path):
    place = Path(disk.path(path, writes=False))
    return place.read_bytes() if place.exists() else None


def after_crashes(folder, act, path, crashes=200):
    """What a file may contain after a crash: the contents of many runs."""
    found = set()
    for seed in range(crashes):
        disk = Disk(folder, Refused)
        try:
            act(disk)
            disk.crash(PROGRAM.id, random.Random(seed))
            found.add(content(disk, path))
        finally:
            disk.close()
    return found


def test_a_write_changes_nothing_in_the_folder(folder, disk):
    write(disk, folder / "old.txt", b"new")
    write(disk, folder / "another.txt", b"new")
    assert content(disk, folder / "old.txt") == content(disk, folder / "another.txt") == b"new"
    assert (folder / "old.txt").read_bytes() == b"old"
    assert [each.name for each in folder.iterdir()] == ["old.txt"]


def test_the_next_run_begins_with_the_folder_as_it_is(folder):
    for _ in range(2):
        disk = Disk(folder, Refused)
        assert content(disk, folder / "old.txt") == b"old"
        write(disk, folder / "old.txt", b"new")
        disk.close()


def test_reading_copies_nothing(folder, disk):
    assert disk.path(folder / "old.txt", writes=False) == folder / "old.txt"


def test_a_write_outside_of_the_folder_is_refused(folder, disk, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "file.txt"
    assert disk.path(elsewhere, writes=False) == elsewhere
    with pytest.raises(Refused, match="outside of the scenario's folder"):
        disk.path(elsewhere, writes=True)


def test_a_crash_loses_tears_or_keeps_what_was_not_synced(folder):
    found = after_crashes(folder, lambda disk: write(disk, folder / "x", b"abcd"), folder / "x")
    assert found == {None, b"", b"a", b"ab", b"abc", b"abcd"}
    found = after_crashes(
        folder, lambda disk: write(disk, folder / "old.txt", b"n"), folder / "old.txt"
    )
    assert found == {b"old", b"", b"n"}


def test_a_crash_keeps_what_was_synced(folder):
    found = after_crashes(
        folder, lambda disk: write(disk, folder / "x", b"abcd", sync=True), folder / "x"
    )
    assert found == {b"abcd"}


def test_the_crash_of_another_program_keeps_everything(folder):
    other = Program("student")
    found = after_crashes(
        folder, lambda disk: write(disk, folder / "x", b"abcd", owner=other), folder / "x"
    )
    assert found == {b"abcd"}


def test_a_renamed_file_without_a_sync_may_be_torn_under_its_new_name(folder):
    def replace(disk):
        write(disk, folder / "new.txt", b"new")
        source = disk.path(folder / "new.txt", writes=True)
        target = disk.path(folder / "old.txt", writes=True)
        os.replace(source, target)
        disk.moved(source, target)

    assert {b"new", b"n"} < after_crashes(folder, replace, folder / "old.txt")


def test_a_crash_keeps_the_commits_of_a_database_and_nothing_else(folder, disk):
    write(disk, folder / "tasks.db", b"")  # a program may create the file first
    place = disk.path(folder / "tasks.db", writes=True)
    database = sqlite3.connect(place)
    disk.connected(place, PROGRAM, database)
    with database:
        database.execute("CREATE TABLE orders (number)")
        database.execute("INSERT INTO orders VALUES (1)")
    database.execute("INSERT INTO orders VALUES (2)")
    disk.crash(PROGRAM.id, random.Random(0))
    again = sqlite3.connect(place)
    try:
        assert again.execute("SELECT number FROM orders").fetchall() == [(1,)]
    finally:
        again.close()
