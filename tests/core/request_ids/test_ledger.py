"""No request runs twice or gets the response of another, after repetitions, losses and restarts."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.core.request_ids.ids import (
    Completion,
    ReceivedId,
    RequestCounter,
    RequestId,
    id_splitter,
    with_request_id,
)
from taskrpc.core.request_ids.ledger import PER_CLIENT, PER_REQUEST, Ledger, Verdict
from tests.properties import examples

ME = b"c" * 16
cut_off = id_splitter("/add")


def claim(number, message=b"one"):
    """The received id of a request."""
    return ReceivedId(*cut_off(with_request_id(number, message))[:4])


def send(ledger, number, message=b"one", *, principal="", now=0.0):
    """The ledger's verdict on a request."""
    return ledger.decide(principal, claim(number, message), now)


def completion(number, *, at=0.0, answer=b"", message=b"one"):
    who = RequestId(number.client, number.sequence, number.first_incomplete)
    mark = claim(who, message).fingerprint
    return Completion(
        "", number.client, number.sequence, number.first_incomplete, mark, answer, 0, at
    )


def test_repeated_request_attaches_to_a_running_one_or_gets_its_stored_response():
    ledger, number = Ledger(), RequestId(ME, 1, 1)
    assert send(ledger, number) is Verdict.NEW
    assert send(ledger, number) is Verdict.ATTACH
    done = completion(number, answer=b"42")
    ledger.completed(done)
    assert send(ledger, number) is Verdict.DONE
    assert ledger.completion("", claim(number)) == done


def test_used_number_is_refused_for_another_request():
    ledger, number = Ledger(), RequestId(ME, 1, 1)
    send(ledger, number)
    assert send(ledger, number, b"two") is Verdict.REUSED
    ledger.completed(completion(number))
    assert send(ledger, number, b"two") is Verdict.REUSED


def test_abandoned_request_may_run():
    ledger, came = Ledger(), claim(RequestId(ME, 1, 1))
    ledger.decide("", came, 0.0)
    ledger.abandoned("", came)
    assert send(ledger, RequestId(ME, 1, 1)) is Verdict.NEW


def test_request_that_is_abandoned_twice_frees_only_its_own_place():
    ledger, came = Ledger(), claim(RequestId(ME, 1, 1))
    ledger.decide("", came, 0.0)
    ledger.abandoned("", came)
    assert send(ledger, RequestId(ME, 1, 1)) is Verdict.NEW
    ledger.abandoned("", came)
    assert send(ledger, RequestId(ME, 1, 1)) is Verdict.ATTACH


def test_running_request_can_be_added_to_any_ledger_of_its_client():
    number = RequestId(ME, 3, 3)
    done = completion(number, answer=b"42")
    for ledger in (Ledger(), Ledger([completion(RequestId(ME, 2, 2))])):
        ledger.add_running("", claim(number), 0.0)
        assert send(ledger, number) is Verdict.ATTACH
        ledger.completed(done)
        assert send(ledger, number) is Verdict.DONE
    ledger = Ledger([done])
    ledger.add_running("", claim(number), 0.0)
    assert ledger.completion("", claim(number)) == done


def test_request_settled_by_an_entered_one_never_runs_again():
    ledger = Ledger()
    ledger.add_running("", claim(RequestId(ME, 5, 5)), 0.0)
    assert send(ledger, RequestId(ME, 4, 4)) is Verdict.STALE


def test_client_with_only_abandoned_requests_is_forgotten():
    ledger = Ledger(memory=2 * (PER_CLIENT + PER_REQUEST))
    for client in (b"a" * 16, b"b" * 16):
        came = claim(RequestId(client, 1, 1))
        assert ledger.decide("", came, 0.0) is Verdict.NEW
        ledger.abandoned("", came)
    assert len(ledger) == 0


def test_settled_requests_are_forgotten_and_never_run_again():
    ledger = Ledger()
    for sequence in (1, 2):
        send(ledger, RequestId(ME, sequence, 1))
        ledger.completed(completion(RequestId(ME, sequence, 1)))
    assert send(ledger, RequestId(ME, 3, 3)) is Verdict.NEW
    assert send(ledger, RequestId(ME, 2, 1)) is Verdict.STALE


def test_execution_without_waiting_callers_leaves_nothing_behind():
    ledger, number = Ledger(open_per_client=2), RequestId(ME, 1, 1)
    send(ledger, number)
    assert send(ledger, RequestId(ME, 2, 2)) is Verdict.NEW
    assert send(ledger, RequestId(ME, 3, 2)) is Verdict.FULL
    ledger.completed(completion(number))
    assert send(ledger, RequestId(ME, 3, 2)) is Verdict.NEW
    assert ledger.size == PER_CLIENT + 2 * PER_REQUEST


def test_client_may_skip_to_the_largest_number():
    ledger, last = Ledger(), 2**64 - 1
    send(ledger, RequestId(ME, 1, 1))
    ledger.completed(completion(RequestId(ME, 1, 1)))
    assert send(ledger, RequestId(ME, last, last)) is Verdict.NEW
    assert send(ledger, RequestId(ME, 1, 1)) is Verdict.STALE


def test_request_of_an_unknown_client_with_settled_numbers_is_stale():
    assert send(Ledger(), RequestId(ME, 2, 2)) is Verdict.STALE


def test_restored_ledger_knows_the_settled_requests():
    ledger = Ledger([completion(RequestId(ME, 5, 4))])
    assert send(ledger, RequestId(ME, 3, 3)) is Verdict.STALE
    assert send(ledger, RequestId(ME, 5, 4)) is Verdict.DONE
    assert send(ledger, RequestId(ME, 4, 4)) is Verdict.NEW


def test_same_client_id_of_two_principals_names_two_clients():
    ledger, number = Ledger(), RequestId(ME, 1, 1)
    send(ledger, number, principal="ada")
    assert send(ledger, number, b"two", principal="bob") is Verdict.NEW
    assert send(ledger, number, principal="ada") is Verdict.ATTACH


def test_lease_begins_at_the_last_use_even_soon_after_an_earlier_one():
    ledger = Ledger(lease=10.0)
    for now in (0.0, 0.5):
        ledger.completed(completion(RequestId(ME, 1, 1)))
        send(ledger, RequestId(ME, 1, 1), now=now)
    assert ledger.expire(10.4) == []
    assert ledger.expire(10.5) == [("", ME)]


def test_lease_of_an_active_client_outlasts_that_of_a_newer_client():
    ledger = Ledger(lease=1000.0)
    for client, now in ((b"a" * 16, 0.0), (b"b" * 16, 1.0), (b"a" * 16, 500.0)):
        ledger.completed(completion(RequestId(client, 1, 1), at=now))
        send(ledger, RequestId(client, 1, 1), now=now)
    assert ledger.expire(1001.0) == [("", b"b" * 16)]
    assert ledger.expire(1500.0) == [("", b"a" * 16)]


def test_lease_begins_at_the_last_use_but_a_running_request_keeps_its_client():
    ledger = Ledger(lease=10.0)
    send(ledger, RequestId(b"a" * 16, 1, 1))
    send(ledger, RequestId(b"b" * 16, 1, 1), now=1.0)
    ledger.completed(completion(RequestId(b"b" * 16, 1, 1), at=1.0))
    send(ledger, RequestId(b"c" * 16, 1, 1), now=2.0)
    ledger.completed(completion(RequestId(b"c" * 16, 1, 1), at=2.0))
    assert ledger.expire(10.9) == []
    assert ledger.expire(11.0) == [("", b"b" * 16)]
    assert len(ledger) == 2


def test_open_requests_of_a_client_are_bounded():
    ledger = Ledger(open_per_client=2)
    for sequence in (1, 2):
        assert send(ledger, RequestId(ME, sequence, 1)) is Verdict.NEW
    assert send(ledger, RequestId(ME, 3, 1)) is Verdict.FULL
    assert len(ledger) == 1


ROOM = 100 * (PER_CLIENT + PER_REQUEST)


def fill(ledger, principal, *, answer=b""):
    """Send named requests of an account until one is refused; returns how many were accepted."""
    count = -1
    while True:
        count += 1
        number = RequestId(f"{principal:>8}{count:08}".encode(), 1, 1)
        if send(ledger, number, principal=principal) is Verdict.FULL:
            return count
        done = completion(number, answer=answer)
        ledger.completed(replace(done, principal=principal))


def test_no_account_can_use_all_memory():
    ledger = Ledger(memory=ROOM)
    taken = [fill(ledger, name) for name in ("ana", "ben", "cem", "dora")]
    assert taken == [50, 25, 13, 6]
    first = RequestId(b"     ana00000000", 1, 1)
    assert send(ledger, first, principal="ana") is Verdict.DONE, "no request was forgotten"
    assert ledger.size <= ROOM


def test_responses_count_by_their_bytes():
    assert fill(Ledger(memory=ROOM), "ana", answer=bytes(PER_CLIENT + PER_REQUEST)) == 25


def test_client_that_settles_a_request_gets_room_in_a_full_account():
    ledger = Ledger(memory=ROOM)
    fill(ledger, "ana", answer=b"long")
    client = b"     ana00000000"
    assert send(ledger, RequestId(client, 2, 1), principal="ana") is Verdict.FULL
    assert send(ledger, RequestId(client, 2, 2), principal="ana") is Verdict.NEW


def test_memory_is_free_again_when_leases_end():
    ledger = Ledger(memory=ROOM, lease=10.0)
    before = fill(ledger, "ana")
    ledger.expire(10.0)
    assert (ledger.size, len(ledger)) == (0, 0)
    assert fill(ledger, "ana") == before


actions = st.lists(
    st.tuples(
        st.sampled_from(["begin", "send", "finish", "abandon", "settle", "restart"]),
        st.integers(0, 5),
    ),
    max_size=60,
)


@settings(max_examples=examples(150))
@given(actions=actions)
def test_no_request_runs_twice_and_each_gets_its_own_response(actions):
    """Compares with a record of all executions and responses. Requests may be late or repeated."""
    numbers, ledger = RequestCounter(ME), Ledger()
    sent, runs, ran, stored = [], {}, {}, {}
    for what, which in actions:
        if what == "begin":
            sequence = numbers.take()
            sent.append(numbers.request_id(sequence))
        elif not sent:
            continue
        number = sent[which % len(sent)]
        message = b"%d" % number.sequence
        if what in ("begin", "send"):
            came = claim(number, message)
            verdict = ledger.decide("", came, 0.0)
            if verdict is Verdict.NEW:
                assert number.sequence not in ran, "run twice"
                assert number.sequence not in runs, "run while it runs"
                runs[number.sequence] = came
            elif verdict is Verdict.DONE:
                assert ledger.completion("", came).response == ran[number.sequence]
            elif verdict is Verdict.ATTACH:
                assert number.sequence in runs
            else:
                assert verdict is Verdict.STALE
        elif what == "settle":
            numbers.settle(number.sequence)
        elif what == "restart":
            runs.clear()
            ledger = Ledger(stored.values())
        elif number.sequence in runs:
            run = runs.pop(number.sequence)
            if what == "abandon":
                ledger.abandoned("", run)
                continue
            ran[run.sequence] = b"answer %d" % run.sequence
            done = completion(run, answer=ran[run.sequence], message=message)
            # As a store does: the transaction also deletes the completions that it settles.
            stored = {n: c for n, c in stored.items() if n >= run.first_incomplete}
            stored[run.sequence] = done
            ledger.completed(done)
        known = list(ledger._clients.values())
        assert ledger.size == sum(each.size for each in known)
        assert ledger._sizes == ({"": ledger.size} if known else {})


def test_memory_of_an_account_counts_after_a_restart_until_its_lease_ends():
    old = [replace(completion(RequestId(bytes([n] * 16), 1, 1)), principal="ada") for n in range(2)]
    ledger = Ledger(old, memory=4 * (PER_CLIENT + PER_REQUEST), lease=10.0)
    assert send(ledger, RequestId(ME, 1, 1), principal="ada", now=9.0) is Verdict.FULL
    assert send(ledger, RequestId(ME, 1, 1), principal="bob", now=9.0) is Verdict.NEW
    assert len(ledger.expire(10.0)) == 2
    assert send(ledger, RequestId(ME, 1, 1), principal="ada", now=10.0) is Verdict.NEW


steps = st.tuples(
    st.integers(0, 3),
    st.integers(-1, 3),
    st.booleans(),
    st.integers(0, 2),
    st.binary(max_size=400),
    st.sampled_from([0.0, 1.0, 61.0]),
)


@settings(max_examples=examples(300))
@given(work=st.lists(steps, max_size=30), memory=st.sampled_from([4_000, 2**20]))
def test_admitted_request_has_the_same_effects_as_one_that_was_decided(work, memory):
    quick, plain = [Ledger(open_per_client=4, memory=memory) for _ in range(2)]
    running, first, now = [], 1, 0.0
    for ahead, settled, ends_at_once, ended, answer, passed in work:
        first, now = max(1, first + settled), now + passed
        number = RequestId(ME, first + ahead, first)
        parts = cut_off(with_request_id(number, b"one"))
        record = quick.admit("", ME, number.sequence, first, now)
        if record is not None:
            assert plain.decide("", ReceivedId(*parts[:4]), now) is Verdict.NEW
        if record is not None and ends_at_once:
            done = completion(number, answer=answer, at=now)
            quick.grown(done, record, record.enter(done))
            plain.completed(done)
        else:
            verdict = Verdict.NEW
            if record is not None:
                quick.add_running("", ReceivedId(*parts[:4]), now)
            else:
                verdict = quick.decide("", ReceivedId(*parts[:4]), now)
                assert plain.decide("", ReceivedId(*parts[:4]), now) is verdict
            if verdict is Verdict.NEW:
                running.append(number)
        for _ in range(min(ended, len(running))):
            done = completion(running.pop(), answer=answer, at=now)
            quick.completed(done)
            plain.completed(done)
        assert contents(quick) == contents(plain)


def contents(ledger):
    """What a ledger remembers."""
    clients = {
        client: (each.first_incomplete, each.used, each.placed, each.is_idle, set(each.requests))
        for client, each in ledger._clients.items()
    }
    return ledger.size, ledger._sizes, list(clients.items())


def test_admitted_request_is_remembered_if_its_client_is_forgotten_meanwhile():
    ledger, first, second = Ledger(), RequestId(ME, 1, 1), RequestId(ME, 2, 1)
    refused = claim(first)
    ledger.decide("", refused, 0.0)
    record = ledger.admit("", ME, 2, 1, 0.0)
    ledger.abandoned("", refused)
    done = completion(second, answer=b"42")
    ledger.grown(done, record, record.enter(done))
    assert send(ledger, second) is Verdict.DONE
    assert ledger.size == Ledger([done]).size


def test_request_is_not_admitted_before_its_client_is_known():
    ledger = Ledger()
    assert ledger.admit("", ME, 1, 1, 0.0) is None
    assert len(ledger) == 0


def test_request_that_ends_in_the_next_ledger_is_done_there():
    before, number = Ledger(), RequestId(ME, 1, 1)
    came = claim(number)
    before.decide("", came, 0.0)
    after = Ledger()
    after.add_running("", came, 0.0)
    done = completion(number, answer=b"42")
    after.completed(done)
    assert send(before, number) is Verdict.ATTACH
    assert send(after, number) is Verdict.DONE
    assert after.size == Ledger([done]).size


def test_request_that_was_stored_before_its_ledger_was_read_is_done_once():
    number = RequestId(ME, 1, 1)
    came, done = claim(number), completion(number, answer=b"42")
    Ledger().decide("", came, 0.0)
    after = Ledger([done])
    after.add_running("", came, 0.0)
    after.completed(done)
    assert send(after, number) is Verdict.DONE
    assert after.size == Ledger([done]).size


def test_restored_lease_begins_at_the_latest_completion():
    old = [completion(RequestId(ME, 1, 1), at=0.0), completion(RequestId(ME, 2, 1), at=8.0)]
    ledger = Ledger(old, lease=10.0)
    assert ledger.expire(17.9) == []
    assert ledger.expire(18.0) == [("", ME)]


@pytest.mark.parametrize("done", [1, 3, 9])
def test_settling_many_requests_at_once_frees_their_bytes(done):
    ledger = Ledger()
    for sequence in range(1, done + 1):
        send(ledger, RequestId(ME, sequence, 1))
        ledger.completed(completion(RequestId(ME, sequence, 1), answer=b"12345"))
    assert ledger.size == PER_CLIENT + done * (PER_REQUEST + 5)
    assert send(ledger, RequestId(ME, done + 1, done + 1)) is Verdict.NEW
    assert ledger.size == PER_CLIENT + PER_REQUEST


def test_a_completion_that_settles_others_frees_their_bytes():
    old = [completion(RequestId(ME, n, 1), answer=b"12345") for n in (1, 2)]
    ledger = Ledger([*old, completion(RequestId(ME, 3, 3), at=1.0)])
    assert ledger.size == PER_CLIENT + PER_REQUEST


def test_running_request_that_settles_others_frees_their_bytes():
    ledger = Ledger([completion(RequestId(ME, 1, 1), answer=b"12345")])
    ledger.add_running("", claim(RequestId(ME, 2, 2)), 0.0)
    assert ledger.size == PER_CLIENT + PER_REQUEST
    assert ledger._sizes == {"": ledger.size}


def test_restored_completion_that_is_settled_takes_no_memory():
    old = [completion(RequestId(ME, 5, 5)), completion(RequestId(ME, 3, 3), at=1.0)]
    assert Ledger(old).size == PER_CLIENT + PER_REQUEST


def test_completion_at_the_first_incomplete_number_is_kept():
    ledger = Ledger([completion(RequestId(ME, number, 1)) for number in (1, 10)])
    assert send(ledger, RequestId(ME, 11, 10)) is Verdict.NEW
    assert send(ledger, RequestId(ME, 10, 10)) is Verdict.DONE


def test_completion_of_another_server_is_learned_unless_the_request_runs_here():
    ledger, first, second = Ledger(), RequestId(ME, 1, 1), RequestId(ME, 2, 1)
    ledger.learn(completion(first, answer=b"42"))
    assert send(ledger, first) is Verdict.DONE
    assert send(ledger, second) is Verdict.NEW
    ledger.learn(completion(second, answer=b"43"))
    assert send(ledger, second) is Verdict.ATTACH
