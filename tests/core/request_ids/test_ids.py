"""A request says which it is, and a client which of its requests it still waits for."""

import msgspec
import pytest

from taskrpc.core.request_ids.ids import (
    OPEN_PER_CLIENT,
    Completion,
    ReceivedId,
    RequestCounter,
    RequestId,
    id_splitter,
    named_request_id,
    with_request_id,
)
from taskrpc.errors import ProtocolError

ME = b"c" * 16


def cut_off(body):
    """The claim and the message of a request to the service /add."""
    *claim, message = id_splitter("/add")(body)
    return ReceivedId(*claim), message


def test_a_number_travels_before_the_body():
    number = RequestId(ME, 7, 3)
    came, body = cut_off(with_request_id(number, b"body"))
    assert (came.client, came.sequence, came.first_incomplete, body) == (ME, 7, 3, b"body")


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (b"", "without its request id"),
        (b"x" * 31, "without its request id"),
        (with_request_id(RequestId(ME, 3, 4), b""), "expected 0 < first open number"),
        (with_request_id(RequestId(ME, 1, 0), b""), "expected 0 < first open number"),
    ],
)
def test_a_request_without_a_valid_number_is_no_request(body, problem):
    with pytest.raises(ProtocolError, match=problem):
        cut_off(body)


def test_zero_is_no_number():
    with pytest.raises(ProtocolError):
        cut_off(with_request_id(RequestId(ME, 0, 0), b""))


def test_one_id_means_one_request_of_one_service():
    assert named_request_id("/a", "x") == named_request_id("/a", "x")
    assert named_request_id("/a", "x").client != named_request_id("/b", "x").client
    assert named_request_id("/a", "x").client != named_request_id("/a", "y").client
    number = named_request_id("/a", "x")
    assert (len(number.client), number.sequence, number.first_incomplete) == (16, 1, 1)


def test_an_id_need_not_be_text():
    assert named_request_id("/a", "\udcff").client != named_request_id("/a", "\udcfe").client


def test_the_same_body_means_something_else_to_another_service():
    for message in (b"one", b"one" * 1000):
        request = with_request_id(RequestId(ME, 1, 1), message)
        assert cut_off(request)[0].fingerprint != id_splitter("/drop")(request)[3]


def test_a_long_body_is_known_by_a_short_fingerprint():
    message = b"long" * 1000
    claim, body = cut_off(with_request_id(RequestId(ME, 7, 3), message))
    assert (claim.client, claim.sequence, claim.first_incomplete, body) == (ME, 7, 3, message)
    assert len(claim.fingerprint) == 16
    other = cut_off(with_request_id(RequestId(ME, 7, 3), message[:-1] + b"."))[0]
    assert other.fingerprint != claim.fingerprint


def test_a_client_says_from_which_number_on_it_waits():
    numbers = RequestCounter(ME)
    first, second, third = numbers.take(), numbers.take(), numbers.take()
    assert numbers.request_id(third) == RequestId(ME, 3, 1)
    numbers.settle(second)
    assert numbers.request_id(third) == RequestId(ME, 3, 1)
    numbers.settle(first)
    assert numbers.request_id(third) == RequestId(ME, 3, 3)


@pytest.mark.parametrize("first", [b"", b"x" * 16, b"x" * 17, b"x" * 100])
def test_fingerprints_of_short_and_long_messages_differ_and_repeat(first):
    number = RequestId(ME, 1, 1)
    prints = [
        cut_off(with_request_id(number, each))[0].fingerprint for each in (first, first + b"x")
    ]
    assert prints[0] != prints[1]
    assert cut_off(with_request_id(RequestId(ME, 1, 1), first))[0].fingerprint == prints[0]


def test_a_client_that_has_left_an_old_number_open_counts_on_as_another():
    numbers = RequestCounter(ME)
    numbers.take()
    while not numbers.is_retired:
        latest = numbers.take()
        numbers.settle(latest)
    assert latest == OPEN_PER_CLIENT // 2 + 1


def test_settling_twice_or_out_of_order_counts_once():
    numbers = RequestCounter(ME)
    taken = [numbers.take() for _ in range(4)]
    for each in (3, 1, 1, 3, 2):
        numbers.settle(each)
    assert numbers.request_id(taken[3]) == RequestId(ME, 4, 4)
    numbers.settle(4)
    numbers.settle(4)
    assert numbers.request_id(numbers.take()) == RequestId(ME, 5, 5)


def test_a_completion_with_the_time_of_day_of_an_earlier_version_is_read():
    done = Completion("ann", b"c" * 16, 1, 1, b"f" * 16, b"answer", 0, 1.5)
    row = [*msgspec.json.decode(msgspec.json.encode(done)), 1_700_000_000.0]
    assert msgspec.json.decode(msgspec.json.encode(row), type=Completion) == done
