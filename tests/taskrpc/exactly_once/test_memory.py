"""Completions in memory: what a plain dictionary would keep, whatever comes in what order."""

import tracemalloc

from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.exactly_once.memory import KeptCompletions
from taskrpc.request_ids.ids import Completion

clients = st.tuples(st.sampled_from(["ann", "bob"]), st.sampled_from([b"c" * 16, b"d" * 16]))
completions = st.tuples(clients, st.integers(1, 6), st.integers(0, 5))


def completion(client, sequence, first=1, answer=b""):
    principal, number = client
    return Completion(principal, number, sequence, first, b"f" * 16, answer, 0, 1.0)


class Plain:
    """The same, one step after another."""

    def __init__(self):
        self.kept, self.firsts = {}, {}

    def keep(self, done, forgotten=()):
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


def test_a_late_completion_that_an_earlier_batch_has_settled_is_not_kept():
    kept, me, other = KeptCompletions(), ("ann", b"c" * 16), ("ann", b"d" * 16)
    kept.keep(completion(me, 4, 4))
    kept.keep(None, [other])
    kept.keep(completion(me, 3, 3))
    assert kept.all() == (completion(me, 4, 4),)


@settings(max_examples=300)
@given(st.lists(st.one_of(completions, st.tuples(clients, st.just(0), st.just(0))), max_size=40))
def test_kept_completions_are_those_that_no_client_has_settled(work):
    kept, plain = KeptCompletions(), Plain()
    for number, (client, ahead, behind) in enumerate(work):
        if not ahead:
            for each in (kept, plain):
                each.keep(None, [client])
        else:
            sequence = number + ahead
            done = completion(client, sequence, max(1, sequence - behind), b"%d" % number)
            for each in (kept, plain):
                each.keep(done)
    # One that comes late, below what its client has settled, may be kept until the next one comes.
    late = [each for each in kept.all() if each not in plain.all()]
    assert all(each.sequence < plain.firsts[each.principal, each.client] for each in late)
    assert sorted((each for each in kept.all() if each not in late), key=key_of) == plain.all()


@settings(max_examples=100)
@given(st.lists(clients, max_size=200))
def test_completions_in_their_order_leave_only_the_last_of_each_client(work):
    kept, last = KeptCompletions(), {}
    for sequence, client in enumerate(work, 1):
        last[client] = completion(client, sequence, sequence)
        kept.keep(last[client])
    assert sorted(kept.all(), key=key_of) == sorted(last.values(), key=key_of)


def test_settled_completions_take_no_memory():
    kept = KeptCompletions()
    tracemalloc.start()
    try:
        for sequence in range(1, 5_000):
            kept.keep(completion(("ann", b"c" * 16), sequence, sequence, bytes(1_000)))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 500_000
    assert len(kept.all()) == 1


def test_large_answers_do_not_gather():
    kept = KeptCompletions()
    tracemalloc.start()
    try:
        for sequence in range(1, 60):
            kept.keep(completion(("ann", b"c" * 16), sequence, sequence, bytes(1_000_000)))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 3_000_000
