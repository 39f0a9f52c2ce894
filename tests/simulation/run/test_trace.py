"""The hash of a trace tells runs apart."""

import msgspec
import pytest

from taskrpc.simulation.run.trace import Event, Trace

EVENTS = [
    Event(0.5, "robot", "start", "starts"),
    Event(1.0, "robot", "print", "moving", "robot.py:3"),
    Event(1.5, "client", "call", "/pick"),
]


def trace(events):
    made = Trace()
    for each in events:
        made.add(each)
    return made


def changed(**values):
    return trace([EVENTS[0], msgspec.structs.replace(EVENTS[1], **values), EVENTS[2]])


def test_equal_events_have_the_same_hash():
    assert trace(EVENTS).hash() == trace(list(EVENTS)).hash()
    assert trace(EVENTS).shape() == trace(list(EVENTS)).shape()


@pytest.mark.parametrize("values", [{"program": "client"}, {"kind": "raise"}, {"text": "moved"}])
def test_another_event_changes_hash_and_shape(values):
    assert changed(**values).hash() != trace(EVENTS).hash()
    assert changed(**values).shape() != trace(EVENTS).shape()


def test_another_time_changes_the_hash_alone():
    assert changed(time=1.0000001).hash() != trace(EVENTS).hash()
    assert changed(time=1.0000001).shape() == trace(EVENTS).shape()


def test_line_of_the_program_changes_nothing():
    assert changed(where="").hash() == trace(EVENTS).hash()


def test_order_matters():
    assert trace(EVENTS).shape() != trace(EVENTS[::-1]).shape()
