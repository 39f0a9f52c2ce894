"""A reader gets the last complete state, wherever a write stops; reading on is enough."""

import contextlib
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.security.private_folder import PrivateFolder
from taskrpc.core.transport.discovery import journal as module
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.journal import Journal, JournalReader, line_of
from taskrpc.core.wire.messages import ServiceEndpoint
from tests.properties import examples

ABOUT = RegistryEntry(pid=1, script="a.py", folder="/", since=1.0)

NAMES = st.sampled_from(["/a", "/b", "/Ünï", "/" + "x" * 50])
ENDPOINTS = st.builds(ServiceEndpoint, NAMES, st.just("a/srv/B"), st.just("R"), NAMES)
CHANGES = st.builds(
    EntryChange,
    node=st.just("") | NAMES,
    service=st.none() | ENDPOINTS,
    client=st.none() | ENDPOINTS,
    gone=st.booleans(),
    address=st.sampled_from(["", "127.0.0.1:7"]),
    token=st.just("ab"),
)


class Disk:
    """Observes every write and truncation of a file, and can fail like a full disk."""

    def __init__(self, monkeypatch):
        self.states = []
        self.fails_after = None
        self._write, self._truncate = os.write, os.ftruncate
        monkeypatch.setattr(os, "write", self.write)
        monkeypatch.setattr(os, "ftruncate", self.truncate)

    def write(self, descriptor, data):
        """Write, and record the content of the file after each byte."""
        if self.fails_after is not None:
            if not self.fails_after:
                raise OSError("no space left")
            data = data[: self.fails_after]
            self.fails_after = 0
        place = os.lseek(descriptor, 0, os.SEEK_CUR)
        before = contents(descriptor)
        os.lseek(descriptor, place, os.SEEK_SET)
        data = bytes(data)
        for count in range(len(data) + 1):
            self.states.append(before[:place] + data[:count] + before[place + count :])
        return self._write(descriptor, data)

    def truncate(self, descriptor, size):
        self._truncate(descriptor, size)
        self.states.append(contents(descriptor))


def contents(descriptor):
    os.lseek(descriptor, 0, os.SEEK_SET)
    return os.read(descriptor, 10**7)


@contextlib.contextmanager
def scratch(folder):
    """A file that is overwritten many times, because opening new ones would take long."""
    with (folder / "cut").open("w+b", buffering=0) as file:
        yield file


def said(data, file):
    """Return the entry that a reader gets from these bytes."""
    file.seek(0)
    file.write(data)
    file.truncate()
    return read_on(file, JournalReader())


def read_on(file, reader):
    reader.read(file.fileno())
    return reader.tracked and reader.tracked.entry()


@settings(max_examples=examples(20))
@given(changes=st.lists(CHANGES, min_size=2, max_size=6))
def test_wherever_a_write_ends_readers_find_the_old_state_or_the_new(changes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("journal")
    with pytest.MonkeyPatch.context() as monkeypatch, scratch(folder) as cut:
        monkeypatch.setattr(module, "_SLACK", 0)  # so that new entries are often written
        disk = Disk(monkeypatch)
        journal, tracked = Journal(PrivateFolder(folder), "journal"), TrackedEntry(ABOUT)
        # One reader reads every state, the other one every fiftieth.
        readers = {1: JournalReader(), 50: JournalReader()}
        old, looks = None, 0
        for change in changes:
            journal.write(tracked, change)
            states, disk.states = disk.states, []
            allowed = (old, ABOUT, tracked.entry()) if old is None else (old, tracked.entry())
            for data in states:
                looks += 1
                found = said(data, cut)
                assert found in allowed
                for step, reader in readers.items():
                    if looks % step == 0:
                        assert read_on(cut, reader) == found
            old = tracked.entry()
            assert said(states[-1], cut) == old
        journal.close()


@given(
    changes=st.lists(CHANGES, min_size=1, max_size=20),
    full=st.integers(0, 1000),
    at=st.integers(0, 19),
)
def test_a_full_disk_leaves_the_old_state_and_the_next_write_succeeds(
    changes, full, at, tmp_path_factory
):
    path = tmp_path_factory.mktemp("journal") / "journal"
    reader = JournalReader()
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(module, "_SLACK", 0)
        disk = Disk(monkeypatch)
        journal, tracked = Journal(PrivateFolder(path.parent), path.name), TrackedEntry(ABOUT)
        for number, change in enumerate(changes):
            if number == at:
                disk.fails_after = full
                before = tracked.entry()
                try:
                    journal.write(tracked, change)
                except OSError:
                    assert tracked.entry() == before
                disk.fails_after = None
            journal.write(tracked, change)
            with path.open("rb") as file:
                reader.read(file.fileno())
            assert reader.tracked.entry() == tracked.entry()
        journal.close()


def test_a_reader_takes_no_line_twice_and_none_out_of_turn(tmp_path):
    whole, change = line_of(1, ABOUT), line_of(2, EntryChange(node="/a"))
    with scratch(tmp_path) as cut:
        assert said(whole + change + change, cut).nodes == ("/a",)
        assert said(whole + line_of(3, EntryChange(node="/a")), cut).nodes == ()
        assert said(change + whole, cut).nodes == ()
        assert said(whole + b"garbage\n" + change, cut).nodes == ("/a",)
        assert said(whole + b"garbage" + change, cut).nodes == ()


def test_a_journal_stays_small_after_many_changes(tmp_path):
    path = tmp_path / "journal"
    journal, tracked = Journal(PrivateFolder(path.parent), path.name), TrackedEntry(ABOUT)
    for n in range(2000):
        journal.write(tracked, EntryChange(node="/n", gone=bool(n % 2)))
        assert path.stat().st_size < 8192
    journal.close()


def test_a_reader_reads_on_instead_of_beginning_anew(tmp_path, monkeypatch):
    path = tmp_path / "journal"
    journal, tracked, reader = (
        Journal(PrivateFolder(path.parent), path.name),
        TrackedEntry(ABOUT),
        JournalReader(),
    )
    read, total = os.read, []
    monkeypatch.setattr(os, "read", lambda *args: total.append(read(*args)) or total[-1])
    for n in range(1000):
        journal.write(tracked, EntryChange(node=f"/n{n}"))
        with path.open("rb") as file:
            reader.read(file.fileno())
    assert reader.tracked.entry() == tracked.entry()
    assert sum(map(len, total)) < 12 * path.stat().st_size
    journal.close()
