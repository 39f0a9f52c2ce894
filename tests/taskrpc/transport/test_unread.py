"""What callers leave unread is counted by what is kept for them."""

from types import SimpleNamespace

import pytest

from taskrpc.transport import unread
from taskrpc.transport.unread import Unread


class Caller:
    """A connection whose caller reads as much as the test says."""

    def __init__(self):
        self.written = self.buffered = 0
        self.transport = SimpleNamespace(get_write_buffer_size=lambda: self.buffered)
        self.released = 0

    def release(self):
        self.released += 1


@pytest.fixture
def kept(monkeypatch):
    monkeypatch.setattr(unread, "MAX_UNREAD", 1000)
    return Unread()


def answer(kept, caller, size, sent):
    """Give an answer, of which the system takes some bytes at once."""
    caller.written += size
    caller.buffered += size - sent
    kept.answered("/big", caller, size)


def test_of_an_answer_that_is_sent_in_part_all_is_kept(kept):
    one, other = Caller(), Caller()
    answer(kept, one, 600, sent=590)
    assert not kept.pressed
    answer(kept, other, 600, sent=590)
    assert kept.pressed
    assert kept.forbids("/big")
    assert not kept.forbids("/small")


def test_once_its_last_byte_is_sent_nothing_of_it_is_kept(kept):
    one, other = Caller(), Caller()
    answer(kept, one, 700, sent=690)
    answer(kept, other, 400, sent=390)
    assert kept.pressed
    kept.hold(other)
    one.written, one.buffered = one.written + 20, 20  # a small answer behind it
    kept.measure(one)
    assert not kept.pressed, "400 of the other and 20"
    assert other.released == 1


def test_answers_that_wait_behind_it_are_counted_once(kept):
    caller = Caller()
    answer(kept, caller, 400, sent=100)
    answer(kept, caller, 400, sent=0)
    assert not kept.pressed, "800 are kept"
    answer(kept, caller, 201, sent=0)
    assert kept.pressed


def test_a_connection_that_is_gone_keeps_nothing(kept):
    one, other = Caller(), Caller()
    for caller in (one, other):
        answer(kept, caller, 600, sent=590)
    one.transport = None
    kept.left(one)
    kept.measure(other)
    assert not kept._answers.keys() - {other}
    assert not kept._sizes.keys() - {other}
