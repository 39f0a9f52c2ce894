"""Unread responses are counted by the memory that they use."""

from collections import deque
from types import SimpleNamespace

import pytest

from taskrpc.core.transport.limits import backpressure
from taskrpc.core.transport.limits.backpressure import Backpressure


class QuotaKey:
    """A connection; the test decides how much its caller reads."""

    def __init__(self):
        self.turns = deque()
        self.loop = SimpleNamespace(call_soon=self.turns.append)
        self.written = self.buffered = 0
        self.transport = SimpleNamespace(get_write_buffer_size=lambda: self.buffered)
        self.released = 0

    def release(self):
        self.released += 1


@pytest.fixture
def kept(monkeypatch):
    monkeypatch.setattr(backpressure, "MAX_UNREAD", 1000)
    return Backpressure()


def answer(kept, caller, size, sent):
    """Send a response; the system takes some of its bytes at once."""
    caller.written += size
    caller.buffered += size - sent
    kept.answered("/big", caller, size)


def test_of_an_answer_that_is_sent_in_part_all_is_kept(kept):
    one, other = QuotaKey(), QuotaKey()
    answer(kept, one, 600, sent=590)
    assert not kept.is_active
    answer(kept, other, 600, sent=590)
    assert kept.is_active
    assert kept.forbids("/big")
    assert not kept.forbids("/small")


def test_a_sent_response_is_no_longer_counted(kept):
    one, other = QuotaKey(), QuotaKey()
    answer(kept, one, 700, sent=690)
    answer(kept, other, 400, sent=390)
    assert kept.is_active
    kept.hold(other)
    one.written, one.buffered = one.written + 20, 20  # a small response behind it
    kept.measure(one)
    assert not kept.is_active, "400 of the other and 20"
    assert other.released == 1


def test_responses_behind_a_large_one_are_counted_once(kept):
    caller = QuotaKey()
    answer(kept, caller, 400, sent=100)
    answer(kept, caller, 400, sent=0)
    assert not kept.is_active, "800 are kept"
    answer(kept, caller, 201, sent=0)
    assert kept.is_active


def test_a_connection_that_is_gone_keeps_nothing(kept):
    one, other = QuotaKey(), QuotaKey()
    for caller in (one, other):
        answer(kept, caller, 600, sent=590)
    one.transport = None
    kept.left(one)
    kept.measure(other)
    assert not kept._answers.keys() - {other}
    assert not kept._sizes.keys() - {other}


@pytest.fixture
def crowd(kept):
    """Five callers that wait because of one that has read nothing and is now gone."""
    gone, crowd = QuotaKey(), [QuotaKey() for _ in range(5)]
    answer(kept, gone, 1001, sent=0)
    for caller in crowd:
        caller.turns = crowd[0].turns
        caller.loop.call_soon = crowd[0].turns.append
        kept.hold(caller)
    gone.transport = None
    kept.left(gone)
    return crowd


def released(crowd):
    return [caller.released for caller in crowd]


def test_one_waiting_connection_continues_in_each_turn_before_new_calls(kept, crowd):
    for gone_on in range(1, 5):
        assert released(crowd) == [1] * gone_on + [0] * (5 - gone_on)
        assert kept.forbids("/big")
        assert len(crowd[0].turns) == 1
        crowd[0].turns.popleft()()
    assert released(crowd) == [1] * 5
    assert not kept.is_active
    assert not crowd[0].turns


def test_they_wait_on_in_their_order_when_there_is_no_room_again(kept, crowd):
    late = QuotaKey()
    kept.hold(late)
    answer(kept, crowd[0], 1001, sent=0)
    crowd[0].turns.popleft()()
    assert kept.is_active
    assert list(kept._waiting) == [*crowd[1:], late]
    assert not crowd[0].turns


def test_a_connection_that_waits_later_continues_after_the_earlier_ones(kept, crowd):
    late = QuotaKey()
    late.loop = crowd[0].loop
    crowd[0].turns.popleft()()
    kept.hold(late)
    for _ in range(3):
        crowd[0].turns.popleft()()
    assert [*released(crowd), late.released] == [1] * 5 + [0]
    assert kept.is_active
    crowd[0].turns.popleft()()
    assert late.released == 1
    assert not kept.is_active
    assert not crowd[0].turns


def test_a_connection_that_is_lost_while_it_waits_is_not_released(kept, crowd):
    for caller in crowd[1:]:
        kept.left(caller)
    crowd[0].turns.popleft()()
    assert released(crowd) == [1, 0, 0, 0, 0]
    assert not kept.is_active
