"""However calls are gathered into transactions, the file knows what they said, in their order."""

import sqlite3

from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.exactly_once.memory import KeptCompletions
from taskrpc.request_ids.ids import Completion
from taskrpc.storage.completions import (
    CompletionBatch,
    make_tables,
    read_completions,
    read_store_id,
    renew,
)

CLIENTS = [("", bytes(16)), ("ann", b"a" * 16), ("it's ü\x00", b"\xff" * 16)]
clients = st.sampled_from(CLIENTS)
calls = st.tuples(clients, st.integers(1, 6), st.integers(0, 2), st.lists(clients, max_size=2))


def new_file():
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.text_factory = bytes
    make_tables(connection)
    return connection


@settings(max_examples=60)
@given(batches=st.lists(st.lists(calls, max_size=5), max_size=5))
def test_a_file_remembers_what_memory_does(batches):
    connection, memory = new_file(), KeptCompletions()
    settled = dict.fromkeys(CLIENTS, 1)
    for batch in batches:
        writing = CompletionBatch()
        for client, ahead, more, forgotten in batch:
            settled[client] += more
            sequence = settled[client] + ahead - 1
            done = Completion(*client, sequence, settled[client], b"f", b"\x00a", 0, ahead / 3)
            memory.keep(done, forgotten)
            writing.add(done, forgotten)
        writing.write(connection)
    assert set(read_completions(connection)) == set(memory.all())
    connection.close()


def test_a_renewed_store_has_another_name_and_no_memory():
    connection = new_file()
    before = read_store_id(connection)
    batch = CompletionBatch()
    batch.add(Completion("", bytes(16), 1, 1, b"f", b"", 0, 1.0), ())
    batch.write(connection)
    renew(connection)
    assert read_store_id(connection) != before
    assert read_completions(connection) == ()
    connection.close()
