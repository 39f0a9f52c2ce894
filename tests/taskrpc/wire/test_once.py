"""Whatever is repeated, lost or restarted: no request runs twice or gets the answer of another."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.errors import ProtocolError
from taskrpc.wire.once import (
    PER_CLIENT,
    PER_REQUEST,
    Claim,
    Completion,
    Ledger,
    Number,
    Numbers,
    Verdict,
    _size,
    cut_number,
    fingerprint,
    number_of_id,
    with_number,
)

ME = b"c" * 16
PRINT = fingerprint("/add", b"one")
OTHER = fingerprint("/add", b"two")


def completion(number, *, at=0.0, answer=b"", mark=PRINT):
    return Completion(
        "", number.client, number.sequence, number.first_incomplete, mark, answer, 0, at
    )


def test_a_number_travels_before_the_body():
    number = Number(ME, 7, 3)
    assert cut_number(with_number(number, b"body")) == (number, b"body")


@pytest.mark.parametrize("body", [b"", b"x" * 31, with_number(Number(ME, 3, 4), b"")])
def test_a_request_without_a_valid_number_is_no_request(body):
    with pytest.raises(ProtocolError):
        cut_number(body)


def test_zero_is_no_number():
    with pytest.raises(ProtocolError):
        cut_number(with_number(Number(ME, 0, 0), b""))


def test_one_id_means_one_request_of_one_service():
    assert number_of_id("/a", "x") == number_of_id("/a", "x")
    assert number_of_id("/a", "x").client != number_of_id("/b", "x").client
    assert number_of_id("/a", "x").client != number_of_id("/a", "y").client


def test_an_id_need_not_be_text():
    assert number_of_id("/a", "\udcff").client != number_of_id("/a", "\udcfe").client


def test_the_same_body_means_something_else_to_another_service():
    assert fingerprint("/add", b"x") != fingerprint("/drop", b"x")


def test_a_repeated_request_attaches_while_the_first_runs_and_gets_its_answer_afterwards():
    ledger, number = Ledger(), Number(ME, 1, 1)
    assert ledger.decide("", number, PRINT, 0.0) is Verdict.NEW
    assert ledger.decide("", number, PRINT, 0.0) is Verdict.ATTACH
    done = completion(number, answer=b"42")
    ledger.completed(done)
    assert ledger.decide("", number, PRINT, 0.0) is Verdict.DONE
    assert ledger.answer("", number) == done


def test_another_request_under_a_used_number_is_refused_while_it_runs_and_afterwards():
    ledger, number = Ledger(), Number(ME, 1, 1)
    ledger.decide("", number, PRINT, 0.0)
    assert ledger.decide("", number, OTHER, 0.0) is Verdict.REUSED
    ledger.completed(completion(number))
    assert ledger.decide("", number, OTHER, 0.0) is Verdict.REUSED


def test_what_was_abandoned_may_run():
    ledger, number = Ledger(), Number(ME, 1, 1)
    ledger.decide("", number, PRINT, 0.0)
    ledger.abandoned("", number)
    assert ledger.decide("", number, PRINT, 0.0) is Verdict.NEW


def test_what_runs_is_taken_over_whatever_else_is_known_of_its_client():
    number = Number(ME, 3, 3)
    done = completion(number, answer=b"42")
    for ledger in (Ledger(), Ledger([completion(Number(ME, 2, 2))])):
        ledger.runs("", Claim(number, PRINT), 0.0)
        assert ledger.decide("", number, PRINT, 0.0) is Verdict.ATTACH
        ledger.completed(done)
        assert ledger.decide("", number, PRINT, 0.0) is Verdict.DONE
    ledger = Ledger([done])
    ledger.runs("", Claim(number, PRINT), 0.0)
    assert ledger.answer("", number) == done


def test_a_client_whose_only_requests_were_refused_takes_no_place():
    ledger = Ledger(memory=2 * (PER_CLIENT + PER_REQUEST))
    for client in (b"a" * 16, b"b" * 16):
        assert ledger.decide("", Number(client, 1, 1), PRINT, 0.0) is Verdict.NEW
        ledger.abandoned("", Number(client, 1, 1))
    assert len(ledger) == 0


def test_what_the_client_has_settled_is_forgotten_and_never_run_again():
    ledger = Ledger()
    for sequence in (1, 2):
        ledger.decide("", Number(ME, sequence, 1), PRINT, 0.0)
        ledger.completed(completion(Number(ME, sequence, 1)))
    assert ledger.decide("", Number(ME, 3, 3), PRINT, 0.0) is Verdict.NEW
    assert ledger.decide("", Number(ME, 2, 1), PRINT, 0.0) is Verdict.STALE


def test_what_runs_although_nobody_waits_any_more_leaves_nothing_behind():
    ledger, number = Ledger(open_per_client=2), Number(ME, 1, 1)
    ledger.decide("", number, PRINT, 0.0)
    assert ledger.decide("", Number(ME, 2, 2), PRINT, 0.0) is Verdict.NEW
    assert ledger.decide("", Number(ME, 3, 2), PRINT, 0.0) is Verdict.FULL
    ledger.completed(completion(number))
    assert ledger.decide("", Number(ME, 3, 2), PRINT, 0.0) is Verdict.NEW


def test_a_client_may_leap_to_the_last_number_that_there_is():
    ledger, last = Ledger(), 2**64 - 1
    ledger.decide("", Number(ME, 1, 1), PRINT, 0.0)
    ledger.completed(completion(Number(ME, 1, 1)))
    assert ledger.decide("", Number(ME, last, last), PRINT, 0.0) is Verdict.NEW
    assert ledger.decide("", Number(ME, 1, 1), PRINT, 0.0) is Verdict.STALE


def test_a_client_that_had_answers_and_is_unknown_now_is_told_so():
    assert Ledger().decide("", Number(ME, 2, 2), PRINT, 0.0) is Verdict.STALE


def test_a_restored_ledger_knows_what_was_settled():
    ledger = Ledger([completion(Number(ME, 5, 4))])
    assert ledger.decide("", Number(ME, 3, 3), PRINT, 0.0) is Verdict.STALE
    assert ledger.decide("", Number(ME, 5, 4), PRINT, 0.0) is Verdict.DONE
    assert ledger.decide("", Number(ME, 4, 4), PRINT, 0.0) is Verdict.NEW


def test_two_principals_never_meet_under_one_client_id():
    ledger, number = Ledger(), Number(ME, 1, 1)
    ledger.decide("ada", number, PRINT, 0.0)
    assert ledger.decide("bob", number, OTHER, 0.0) is Verdict.NEW
    assert ledger.decide("ada", number, PRINT, 0.0) is Verdict.ATTACH


def test_a_lease_lasts_from_the_last_use_and_what_runs_outlasts_it():
    ledger = Ledger(lease=10.0)
    ledger.decide("", Number(b"a" * 16, 1, 1), PRINT, 0.0)
    ledger.decide("", Number(b"b" * 16, 1, 1), PRINT, 1.0)
    ledger.completed(completion(Number(b"b" * 16, 1, 1), at=1.0))
    ledger.decide("", Number(b"c" * 16, 1, 1), PRINT, 2.0)
    ledger.completed(completion(Number(b"c" * 16, 1, 1), at=2.0))
    assert ledger.expire(10.9) == []
    assert ledger.expire(11.0) == [("", b"b" * 16)]
    assert len(ledger) == 2


def test_open_requests_of_a_client_are_bounded():
    ledger = Ledger(open_per_client=2)
    for sequence in (1, 2):
        assert ledger.decide("", Number(ME, sequence, 1), PRINT, 0.0) is Verdict.NEW
    assert ledger.decide("", Number(ME, 3, 1), PRINT, 0.0) is Verdict.FULL
    assert len(ledger) == 1


ROOM = 100 * (PER_CLIENT + PER_REQUEST)


def fill(ledger, principal, *, answer=b""):
    """Let an account name requests until it is refused; returns how many were taken."""
    count = -1
    while True:
        count += 1
        number = Number(f"{principal:>8}{count:08}".encode(), 1, 1)
        if ledger.decide(principal, number, PRINT, 0.0) is Verdict.FULL:
            return count
        done = completion(number, answer=answer)
        ledger.completed(replace(done, principal=principal))


def test_no_account_can_take_the_room_of_another():
    ledger = Ledger(memory=ROOM)
    taken = [fill(ledger, name) for name in ("ana", "ben", "cem", "dora")]
    assert taken == [50, 25, 13, 6]
    first = Number(b"     ana00000000", 1, 1)
    assert ledger.decide("ana", first, PRINT, 0.0) is Verdict.DONE, "nobody is forgotten for it"
    assert ledger.size <= ROOM


def test_answers_count_by_their_bytes():
    assert fill(Ledger(memory=ROOM), "ana", answer=bytes(PER_CLIENT + PER_REQUEST)) == 25


def test_a_client_that_settles_finds_room_in_a_full_account():
    ledger = Ledger(memory=ROOM)
    fill(ledger, "ana", answer=b"long")
    client = b"     ana00000000"
    assert ledger.decide("ana", Number(client, 2, 1), PRINT, 0.0) is Verdict.FULL
    assert ledger.decide("ana", Number(client, 2, 2), PRINT, 0.0) is Verdict.NEW


def test_room_is_free_again_when_leases_end():
    ledger = Ledger(memory=ROOM, lease=10.0)
    before = fill(ledger, "ana")
    ledger.expire(10.0)
    assert (ledger.size, len(ledger)) == (0, 0)
    assert fill(ledger, "ana") == before


def test_a_client_says_from_which_number_on_it_waits():
    numbers = Numbers(ME)
    first, second, third = numbers.take(), numbers.take(), numbers.take()
    assert numbers.number(third) == Number(ME, 3, 1)
    numbers.settle(second)
    assert numbers.number(third) == Number(ME, 3, 1)
    numbers.settle(first)
    assert numbers.number(third) == Number(ME, 3, 3)


actions = st.lists(
    st.tuples(
        st.sampled_from(["begin", "send", "finish", "abandon", "settle", "restart"]),
        st.integers(0, 5),
    ),
    max_size=60,
)


@settings(max_examples=300, deadline=None)
@given(actions=actions)
def test_no_request_runs_twice_and_each_gets_its_own_answer(actions):
    """Against ground truth: what ran, and what it answered. Sends may come late and repeated."""
    numbers, ledger = Numbers(ME), Ledger()
    sent, runs, ran, stored = [], {}, {}, {}
    for what, which in actions:
        if what == "begin":
            sequence = numbers.take()
            sent.append(numbers.number(sequence))
        elif not sent:
            continue
        number = sent[which % len(sent)]
        mark = fingerprint("/add", b"%d" % number.sequence)
        if what in ("begin", "send"):
            verdict = ledger.decide("", number, mark, 0.0)
            if verdict is Verdict.NEW:
                assert number.sequence not in ran, "run twice"
                assert number.sequence not in runs, "run while it runs"
                runs[number.sequence] = number
            elif verdict is Verdict.DONE:
                assert ledger.answer("", number).answer == ran[number.sequence]
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
            done = completion(run, answer=ran[run.sequence], mark=mark)
            # As a store does: what is settled goes with the transaction that says so.
            stored = {n: c for n, c in stored.items() if n >= run.first_incomplete}
            stored[run.sequence] = done
            ledger.completed(done)
        known = list(ledger._clients.values())
        sizes = [sum(map(_size, each.requests.values())) for each in known]
        assert [each.size - PER_CLIENT for each in known] == sizes
        assert ledger.size == sum(each.size for each in known)
        assert ledger._sizes == ({"": ledger.size} if known else {})


def test_what_an_account_had_counts_after_a_restart_until_its_lease_ends():
    old = [replace(completion(Number(bytes([n] * 16), 1, 1)), principal="ada") for n in range(2)]
    ledger = Ledger(old, memory=4 * (PER_CLIENT + PER_REQUEST), lease=10.0)
    assert ledger.decide("ada", Number(ME, 1, 1), PRINT, 9.0) is Verdict.FULL
    assert ledger.decide("bob", Number(ME, 1, 1), PRINT, 9.0) is Verdict.NEW
    assert len(ledger.expire(10.0)) == 2
    assert ledger.decide("ada", Number(ME, 1, 1), PRINT, 10.0) is Verdict.NEW
