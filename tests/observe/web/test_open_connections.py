"""Which connections of the web server stay open, without sockets."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.observe.web import open_connections
from taskrpc.observe.web.open_connections import (
    MAX_CONNECTIONS,
    MAX_UNFINISHED,
    TIME_TO_ASK,
    OpenConnections,
)

LATER = TIME_TO_ASK + 0.1


class Caller:
    def __init__(self):
        self.is_closed = False

    def make_room(self):
        self.is_closed = True


def added(made, count, now=0.0):
    callers = [Caller() for _ in range(count)]
    for each in callers:
        made.add(each, now)
    return callers


def closed(callers):
    return sum(each.is_closed for each in callers)


def test_pages_that_connect_at_one_instant_stay_open():
    callers = added(OpenConnections(), MAX_UNFINISHED)
    assert not closed(callers)


def test_flood_of_connections_at_one_instant_keeps_the_newest():
    callers = added(OpenConnections(), 3 * MAX_UNFINISHED)
    assert closed(callers[:-MAX_UNFINISHED]) == 2 * MAX_UNFINISHED
    assert not closed(callers[-MAX_UNFINISHED:])


def test_connections_that_send_no_request_make_room_for_new_ones():
    made = OpenConnections()
    silent = added(made, MAX_UNFINISHED)
    [new] = added(made, 1, LATER)
    assert not new.is_closed
    assert closed(silent) == MAX_UNFINISHED + 1 - MAX_CONNECTIONS
    assert len(made) == MAX_CONNECTIONS


def test_connection_whose_response_is_being_made_is_not_closed():
    made = OpenConnections()
    [asking] = added(made, 1)
    with made.kept(asking, 0.0):
        added(made, 2 * MAX_UNFINISHED, LATER)
        assert not asking.is_closed


def test_connection_that_does_not_read_its_response_makes_room():
    made = OpenConnections()
    [asking] = added(made, 1)
    with made.kept(asking, 0.0):
        pass
    added(made, MAX_CONNECTIONS, LATER)
    assert asking.is_closed


def test_connection_that_ended_during_its_response_does_not_count():
    made = OpenConnections()
    [asking] = added(made, 1)
    with made.kept(asking, 0.0):
        made.remove(asking)
    assert len(made) == 0


def test_too_many_responses_at_one_instant_are_refused(monkeypatch):
    monkeypatch.setattr(open_connections, "MAX_ANSWERED", 1)
    made = OpenConnections()
    first, second = added(made, 2)
    with made.kept(first, 0.0):
        with pytest.raises(open_connections.TooManyRequests), made.kept(second, 0.0):
            pass
        assert len(made) == 2
    with made.kept(second, 0.0):
        pass


@given(st.lists(st.tuples(st.sampled_from("take leave".split()), st.floats(0, 1)), max_size=400))
def test_connections_are_never_more_than_allowed_and_the_newest_stays_open(steps):
    made, now, callers = OpenConnections(), 0.0, []
    for step, seconds in steps:
        now += seconds
        if step == "take":
            callers += added(made, 9, now)
            assert not callers[-1].is_closed
        elif callers:
            made.remove(callers.pop(0))
        assert len(made) <= MAX_UNFINISHED
