"""No caller can take a whole quota; some is left for the next caller."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.transport.limits.quotas import (
    FairQuota,
    HostQueues,
    host_of,
    name_of,
    quota_key_of,
)

ADA, BO = ("ada", ""), ("bo", "")
callers = st.sampled_from([ADA, BO, ("", "192.0.2.7")])
steps = st.lists(st.tuples(st.booleans(), callers, st.integers(1, 50)), max_size=60)


def take_all(quota, caller):
    taken = 0
    while quota.take(caller, 1):
        taken += 1
    return taken


def test_one_alone_has_a_half_and_the_next_half_of_the_rest():
    quota = FairQuota(1000)
    assert take_all(quota, ADA) == 500
    assert take_all(quota, BO) == 250
    assert not quota.take(ADA, 1)


def test_callers_that_take_in_turn_get_equal_quotas():
    quota = FairQuota(1000)
    names = [(str(number), "") for number in range(9)]
    for _ in range(1000):
        for name in names:
            quota.take(name, 1)
    assert quota.left == pytest.approx(1000 / 10, abs=9)


def test_returned_quota_can_be_taken_again():
    quota = FairQuota(100)
    assert quota.take(ADA, 50)
    assert not quota.take(ADA, 1)
    quota.give(ADA, 50)
    assert quota.take(BO, 50)


@given(steps)
def test_some_quota_is_always_left(steps):
    quota, held = FairQuota(300), {}
    for is_taken, caller, amount in steps:
        if is_taken:
            fits = held.get(caller, 0) + amount <= 300 - sum(held.values()) - amount
            assert quota.take(caller, amount) == fits
            held[caller] = held.get(caller, 0) + amount * fits
        elif amount <= held.get(caller, 0):
            quota.give(caller, amount)
            held[caller] -= amount
        assert quota.left == 300 - sum(held.values()) > 0


@pytest.mark.parametrize(
    ("peername", "host"),
    [
        (("192.0.2.7", 4711), "192.0.2.7"),
        (("127.0.0.1", 4711), ""),
        (("::1", 4711, 0, 0), ""),
        (("::ffff:127.0.0.1", 4711, 0, 0), ""),
        (("::ffff:192.0.2.7", 4711, 0, 0), "192.0.2.7"),
        (("fe80::1%eth0", 4711, 0, 2), "fe80::1%eth0"),
        ("", ""),
        (None, ""),
    ],
)
def test_each_machine_counts_for_itself_in_an_account_and_without_one(peername, host):
    assert quota_key_of("class", peername) == ("class", host)
    assert quota_key_of("", peername) == ("", host)


def test_a_caller_is_named_for_the_log():
    named = [name_of(each) for each in (("", ""), ("", "192.0.2.7"), ADA, ("ada", "192.0.2.7"))]
    assert named == [
        "this machine",
        "the machine 192.0.2.7",
        "the account ada at this machine",
        "the account ada at the machine 192.0.2.7",
    ]


def test_machines_take_turns_and_the_largest_loses_its_oldest():
    waiting = HostQueues()
    for number in range(5):
        waiting.add("192.0.2.7", f"flood {number}")
    waiting.add("", "here")
    waiting.add("192.0.2.8", "there")
    assert (len(waiting), waiting.largest()) == (7, "192.0.2.7")
    assert waiting.pop_oldest(waiting.largest()) == "flood 0"
    assert [waiting.pop_next() for _ in range(4)] == ["flood 1", "here", "there", "flood 2"]
    assert waiting.remove("192.0.2.7", "flood 3")
    assert not waiting.remove("192.0.2.7", "flood 3")
    assert list(waiting) == ["flood 4"]
    assert waiting.pop_next() == "flood 4"
    assert (len(waiting), waiting.largest()) == (0, "")


def test_the_machine_of_a_peer_is_its_address_and_this_one_has_none():
    assert host_of(("127.0.0.9", 1)) == host_of(("::1", 1, 0, 0)) == host_of("") == ""
    assert host_of(("::ffff:192.0.2.7", 1, 0, 0)) == host_of(("192.0.2.7", 2)) == "192.0.2.7"
