"""Operations, fragments and throttling of rosbridge, without a connection."""

import json
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.bridges.rosbridge import protocol
from taskrpc.bridges.rosbridge.protocol import (
    BadOperation,
    Fragment,
    Fragments,
    Throttle,
    parse,
    split,
)
from tests.properties import examples

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)
WORDS = st.sampled_from(
    "op id topic type service args msg data num total level advertise publish subscribe"
    " call_service fragment set_level service_response info".split()
)
OPERATIONS = st.dictionaries(WORDS, WORDS | JSON, max_size=6)


def refusal(text):
    with pytest.raises(BadOperation) as caught:
        parse(text)
    return str(caught.value), caught.value.id


@settings(max_examples=examples(60))
@given(st.text() | st.binary() | OPERATIONS.map(json.dumps))
def test_any_text_is_an_operation_or_refused_with_text_that_can_be_sent(text):
    try:
        operation = parse(text)
    except BadOperation as error:
        protocol.encode(protocol.status("error", str(error), error.id))
    else:
        msgspec.json.encode(operation)


@settings(max_examples=examples(60))
@given(OPERATIONS.map(msgspec.json.encode))
def test_id_of_an_operation_is_kept_or_dropped(text):
    sent = msgspec.json.decode(text).get("id")
    try:
        name = parse(text).id
    except BadOperation as error:
        name = error.id
    assert name in (sent, None)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "expected an operation in JSON: Input data was truncated"),
        ("[1]", "expected a JSON object with the field op, got a list"),
        ("{}", "unknown op none; there are advertise, unadvertise, "),
        ('{"op": "fly"}', "unknown op 'fly'; there are "),
        ('{"op": "call_service"}', "call_service: Object missing required field `service`"),
        ('{"op": "subscribe", "topic": 5}', "Expected `str`, got `int` - at `$.topic`"),
        ('{"op": "set_level", "level": "loud"}', "set_level: Invalid enum value 'loud'"),
        ("[" * 100_000, "expected an operation in JSON: it is nested too deeply"),
        ('{"op": "publish", "topic": "\\ud800"}', "expected an operation in JSON: "),
    ],
)
def test_error_says_what_was_expected(text, problem):
    assert problem in refusal(text)[0]


def test_refusal_repeats_the_id():
    assert refusal('{"op": "fly", "id": "a7"}')[1] == "a7"
    assert refusal('{"op": "subscribe", "id": 7}')[1] == 7
    assert refusal('{"op": "fly", "id": [7]}')[1] is None


def test_numbers_that_python_clients_write_are_accepted():
    operation = parse('{"op": "publish", "topic": "/x", "msg": {"data": Infinity}}')
    assert operation.msg == {"data": float("inf")}


def test_longer_message_than_the_limit_is_refused(monkeypatch):
    monkeypatch.setattr(protocol, "MAX_MESSAGE", 100)
    text = '{"op": "publish", "topic": "/x"' + " " * 100 + "}"
    assert refusal(text)[0] == "expected at most 100 bytes, got 132"


def test_client_gets_statuses_of_its_level_and_worse():
    assert protocol.is_wanted("error", "error")
    assert not protocol.is_wanted("warning", "error")
    assert protocol.is_wanted("warning", "info")
    assert not protocol.is_wanted("error", "none")


@pytest.mark.parametrize(
    ("number", "count"), [(None, 7), (float("nan"), 7), (-1, 0), (2.9, 2), (float("inf"), 9)]
)
def test_number_of_a_client_becomes_a_count_within_bounds(number, count):
    assert protocol.count_of(number, 7, 9) == count


# Fragments


def joined(parts, fragments=None):
    fragments = fragments or Fragments()
    return [fragments.add(parse(part), 0.0) for part in parts]


@given(st.text(min_size=1, max_size=20), st.integers(1, 300), st.randoms())
@settings(max_examples=examples(50))
def test_fragments_in_any_order_give_the_message_again(text, size, chance):
    text = json.dumps({"op": "publish", "topic": "/x", "msg": {"data": text * 30}})
    parts = split(text, size, "name")
    if len(parts) == 1:
        assert parts == [text]
    else:
        chance.shuffle(parts)
        assert joined(parts) == [None] * (len(parts) - 1) + [text]


def test_short_message_is_not_split():
    assert split("abc", 3, "name") == split("abc", 0, "name") == ["abc"]


def test_repeated_fragment_counts_once():
    parts = split("x" * 100, 64, "name")
    assert joined([parts[0], parts[0], parts[1]]) == [None, None, "x" * 100]


@pytest.mark.parametrize(
    ("num", "total", "problem"),
    [
        (0, 0, "expected a total from 1 to 10000"),
        (0, 10**9, "expected a total from 1 to 10000"),
        (2, 2, "expected a num from 0 to 1, got 2"),
        (-1, 2, "expected a num from 0 to 1, got -1"),
    ],
)
def test_impossible_fragment_is_refused(num, total, problem):
    with pytest.raises(BadOperation, match=problem):
        Fragments().add(Fragment(id="a", data="x", num=num, total=total), 0.0)


def test_fragments_that_disagree_about_the_total_drop_the_message():
    fragments = Fragments()
    fragments.add(Fragment(id="a", data="x", num=0, total=2), 0.0)
    with pytest.raises(BadOperation, match="the same in each fragment"):
        fragments.add(Fragment(id="a", data="x", num=1, total=3), 0.0)
    assert fragments.add(Fragment(id="a", data="y", num=1, total=2), 0.0) is None


def test_unfinished_messages_are_bounded_in_number_size_and_time(monkeypatch):
    monkeypatch.setattr(protocol, "MAX_MESSAGE", 100)
    fragments = Fragments()
    for number in range(9):
        fragments.add(Fragment(id=number, data="x", num=0, total=2), 0.0)
    assert fragments.add(Fragment(id=0, data="y", num=1, total=2), 0.0) is None  # was dropped
    assert fragments.add(Fragment(id=8, data="y", num=1, total=2), 59.0) == "xy"
    assert fragments.add(Fragment(id=7, data="y", num=1, total=2), 61.0) is None  # too old
    half = "x" * 51
    fragments.add(Fragment(id="a", data=half, num=0, total=3), 61.0)
    fragments.add(Fragment(id="b", data=half, num=0, total=3), 61.0)  # drops the first
    assert fragments.add(Fragment(id="b", data="", num=1, total=3), 61.0) is None
    with pytest.raises(BadOperation, match="expected a message of at most 100 characters"):
        fragments.add(Fragment(id="b", data=half, num=2, total=3), 61.0)


# Throttling


def test_message_that_comes_too_early_is_dropped_without_a_queue():
    throttle = Throttle(1.0, 0)
    assert [throttle.offer(each, each) for each in (0.0, 0.5, 1.0, 1.9)] == [
        True,
        False,
        True,
        False,
    ]
    assert throttle.due is None


def test_queue_keeps_the_newest_messages_and_spaces_them():
    throttle = Throttle(1.0, 2)
    for number in range(5):
        throttle.offer(number, 0.0)
    assert throttle.due == 1.0
    assert throttle.take(0.9) is None
    assert [throttle.take(1.0), throttle.take(2.0), throttle.due] == [3, 4, None]


@given(
    st.lists(st.floats(0, 3), max_size=30),
    st.integers(0, 2000).map(lambda milliseconds: milliseconds / 1000),
    st.integers(0, 5),
)
def test_throttled_messages_keep_their_order_and_distance(waits, rate, length):
    throttle, sent, now = Throttle(rate, length), [], 0.0
    for number, wait in enumerate(waits):
        end = now + wait
        while (due := throttle.due) is not None and due <= end:
            now = max(now, due)
            sent.append((throttle.take(now), now))
        now = end
        if throttle.offer(number, now):
            sent.append((number, now))
    assert [each for each, _ in sent] == sorted({each for each, _ in sent})
    times = [at for _, at in sent]
    assert all(later - earlier >= rate - 1e-9 for earlier, later in pairwise(times))
