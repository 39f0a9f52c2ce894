"""Completions in memory and in a file: whatever the order, both keep what no client has settled."""

import sqlite3
import tracemalloc

from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.exactly_once.completions import CompletionBatch, CompletionIndex
from taskrpc.core.exactly_once.stores import (
    clear_completions,
    create_completion_tables,
    read_stored_completions,
)
from taskrpc.core.request_ids.ids import Completion
from tests.properties import examples

CLIENTS = [("", bytes(16)), ("ann", b"a" * 16), ("it's ü\x00", b"\xff" * 16)]
clients = st.sampled_from(CLIENTS)
calls = st.tuples(clients, st.integers(1, 6), st.integers(0, 2), st.lists(clients, max_size=2))


def new_file():
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.text_factory = bytes
    create_completion_tables(connection)
    return connection


@settings(max_examples=examples(60))
@given(batches=st.lists(st.lists(calls, max_size=5), max_size=5))
def test_file_and_index_keep_the_same_completions(batches):
    connection, memory = new_file(), CompletionIndex()
    settled = dict.fromkeys(CLIENTS, 1)
    for batch in batches:
        writing = CompletionBatch()
        for client, ahead, more, forgotten in batch:
            settled[client] += more
            sequence = settled[client] + ahead - 1
            done = Completion(*client, sequence, settled[client], b"f", b"\x00a", 0, ahead / 3)
            memory.add(done, forgotten)
            writing.add(done, forgotten)
        writing.write(connection)
    assert set(read_stored_completions(connection).completions) == set(memory.all())
    connection.close()


def test_cleared_store_has_another_id_and_no_completions():
    connection = new_file()
    before = read_stored_completions(connection).store_id
    batch = CompletionBatch()
    batch.add(Completion("", bytes(16), 1, 1, b"f", b"", 0, 1.0), ())
    batch.write(connection)
    clear_completions(connection)
    after = read_stored_completions(connection)
    assert after.store_id != before
    assert after.completions == ()
    connection.close()


memory_clients = st.tuples(st.sampled_from(["ann", "bob"]), st.sampled_from([b"c" * 16, b"d" * 16]))
completions = st.tuples(memory_clients, st.integers(1, 6), st.integers(0, 5))


def completion(client, sequence, first=1, answer=b""):
    principal, number = client
    return Completion(principal, number, sequence, first, b"f" * 16, answer, 0, 1.0)


class Plain:
    """A plain dictionary as the model."""

    def __init__(self):
        self.kept, self.firsts = {}, {}

    def add(self, done, forgotten=()):
        for client in forgotten:
            self.kept = {key: each for key, each in self.kept.items() if key[0] != client}
            self.firsts.pop(client, None)
        if done is None:
            return
        client = done.principal, done.client
        first = self.firsts[client] = max(self.firsts.get(client, 0), done.first_incomplete)
        self.kept[client, done.sequence] = done
        settled = [key for key in self.kept if key[0] == client and key[1] < first]
        for key in settled:
            del self.kept[key]

    def all(self):
        return sorted(self.kept.values(), key=key_of)


def key_of(each):
    return each.principal, each.client, each.sequence


def test_late_completion_below_an_earlier_batch_is_not_kept():
    kept, me, other = CompletionIndex(), ("ann", b"c" * 16), ("ann", b"d" * 16)
    kept.add(completion(me, 4, 4))
    kept.add(None, [other])
    kept.add(completion(me, 3, 3))
    assert kept.all() == (completion(me, 4, 4),)


@settings(max_examples=examples(300))
@given(
    st.lists(st.one_of(completions, st.tuples(memory_clients, st.just(0), st.just(0))), max_size=40)
)
def test_index_keeps_all_unsettled_completions(work):
    kept, plain = CompletionIndex(), Plain()
    for number, (client, ahead, behind) in enumerate(work):
        if not ahead:
            for each in (kept, plain):
                each.add(None, [client])
        else:
            sequence = number + ahead
            done = completion(client, sequence, max(1, sequence - behind), b"%d" % number)
            for each in (kept, plain):
                each.add(done)
    # A late completion, below what its client has settled, may stay until the next one arrives.
    late = [each for each in kept.all() if each not in plain.all()]
    assert all(each.sequence < plain.firsts[each.principal, each.client] for each in late)
    assert sorted((each for each in kept.all() if each not in late), key=key_of) == plain.all()


@settings(max_examples=examples(100))
@given(st.lists(memory_clients, max_size=200))
def test_each_completion_in_order_settles_the_one_before(work):
    kept, last = CompletionIndex(), {}
    for sequence, client in enumerate(work, 1):
        last[client] = completion(client, sequence, sequence)
        kept.add(last[client])
    assert sorted(kept.all(), key=key_of) == sorted(last.values(), key=key_of)


def test_settled_completions_take_no_memory():
    kept = CompletionIndex()
    tracemalloc.start()
    try:
        for sequence in range(1, 5_000):
            kept.add(completion(("ann", b"c" * 16), sequence, sequence, bytes(1_000)))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 500_000
    assert len(kept.all()) == 1


def test_large_responses_are_indexed_at_once():
    kept = CompletionIndex()
    tracemalloc.start()
    try:
        for sequence in range(1, 60):
            kept.add(completion(("ann", b"c" * 16), sequence, sequence, bytes(1_000_000)))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 3_000_000
