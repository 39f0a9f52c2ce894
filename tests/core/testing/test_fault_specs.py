"""The specifications of faults, and which call gets which fault."""

import contextlib
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.testing.fault_specs import ALLOWED, Fault, FaultKind, FaultPlan, parse_fault

EXAMPLES = [
    ("lose-request", Fault(FaultKind.LOSE_REQUEST)),
    ("lose-response:first=1", Fault(FaultKind.LOSE_RESPONSE, first=1)),
    ("lose-response:0.3", Fault(FaultKind.LOSE_RESPONSE, share=0.3)),
    ("delay-response:0.5s", Fault(FaultKind.DELAY_RESPONSE, 0.5)),
    ("slow:200ms,0.25", Fault(FaultKind.SLOW, 0.2, 0.25)),
    ("busy:.2,seed=7", Fault(FaultKind.BUSY, share=0.2, seed=7)),
    ("cut-connection:service=/a/b,first=2", Fault(FaultKind.CUT_CONNECTION, 0, 1, 2, "/a/b")),
    ("busy:service=add", Fault(FaultKind.BUSY, service="/add")),
]


@pytest.mark.parametrize(("text", "expected"), EXAMPLES)
def test_specification_gives_its_fault(text, expected):
    assert parse_fault(text) == expected


def test_default_service_applies_if_none_is_named():
    assert parse_fault("busy", "/robot_task").service == "/robot_task"
    assert parse_fault("busy:service=/other", "/robot_task").service == "/other"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "expected a fault, got ''"),
        ("lose", "expected a fault, got 'lose'"),
        ("Busy", "expected a fault, got 'Busy'"),
        ("slow", "expected a time, such as slow:0.5s"),
        ("delay-response:0.5", "expected a time, such as delay-response:0.5s"),
        ("busy:2s", "busy takes no time"),
        ("slow:0s", "expected a time above 0 s up to 3600 s, got '0s'"),
        ("slow:1e9s", "expected a share above 0 up to 1, or a time such as 2s, got '1e9s'"),
        ("slow:3601s", "expected a time above 0 s up to 3600 s, got '3601s'"),
        ("slow:1..2s", "expected a time above 0 s up to 3600 s, got '1..2s'"),
        ("busy:0", "expected a share above 0 up to 1"),
        ("busy:1.1", "expected a share above 0 up to 1"),
        ("busy:nan", "expected a share above 0 up to 1"),
        ("busy:", "expected a share above 0 up to 1, or a time such as 2s, got ''"),
        ("busy:first=0", "first: expected a whole number from 1, got '0'"),
        ("busy:first=one", "first: expected a whole number from 1, got 'one'"),
        ("busy:first=²", "first: expected a whole number from 1, got '²'"),
        ("busy:seed=-1", "seed: expected a whole number from 0, got '-1'"),
        ("busy:service=/a b", "expected the name of a service, got '/a b'"),
        ("busy:0.5,0.5", "'0.5' repeats the share"),
        ("busy:first=1,first=2", "'first=2' repeats the first"),
        ("busy:service=/a,service=/b", "'service=/b' repeats the service"),
        ("busy:last=1", "expected a share above 0 up to 1"),
    ],
)
def test_error_names_the_invalid_specification_and_lists_the_allowed_ones(text, problem):
    with pytest.raises(ValueError, match="allowed are") as refused:
        parse_fault(text, "/robot_task")
    message = str(refused.value)
    assert message.startswith(problem)
    assert message.endswith(ALLOWED)
    assert all(kind.value in message for kind in FaultKind)
    assert "\n" not in message


@given(st.text(alphabet="busylow-r:=,.0123456789smfite/ \n²", max_size=30) | st.text(max_size=60))
def test_any_text_is_a_fault_or_a_value_error(text):
    with contextlib.suppress(ValueError):
        fault = parse_fault(text)
        assert 0 < fault.share <= 1
        assert (fault.seconds > 0) is fault.kind.needs_seconds


@given(st.text(max_size=60))
def test_invalid_part_is_an_error_in_one_line(part):
    with pytest.raises(ValueError, match="allowed are") as refused:
        parse_fault(f"busy:={part}")
    assert len(str(refused.value).splitlines()) == 1


kinds = st.sampled_from(FaultKind)
services = st.sampled_from(["", "/a", "/b"])
faults = st.builds(
    Fault,
    kinds,
    seconds=st.just(1.0),
    share=st.floats(0.01, 1),
    first=st.none() | st.integers(1, 9),
    service=services,
    seed=st.integers(0, 99),
)


def planned(faults, calls):
    plan = FaultPlan(faults, [random.Random(fault.seed).random for fault in faults])
    return [plan.next(service) for service in calls]


@given(st.lists(faults, max_size=4), st.lists(st.sampled_from(["/a", "/b", "/c"]), max_size=30))
def test_same_seeds_and_calls_give_the_same_faults_to_the_right_calls(given_faults, calls):
    found = planned(given_faults, calls)
    assert found == planned(given_faults, calls)
    for service, fault in zip(calls, found, strict=True):
        assert fault is None or fault.service in ("", service)
    for fault in given_faults:
        struck = sum(each is fault for each in found)
        assert fault.first is None or struck <= fault.first * given_faults.count(fault)


@given(faults, st.integers(0, 20))
def test_a_fault_of_all_calls_strikes_exactly_the_first_ones(fault, count):
    fault = Fault(fault.kind, 1.0, 1.0, fault.first)
    found = planned([fault], ["/a"] * count)
    first = count if fault.first is None else min(count, fault.first)
    assert found == [fault] * first + [None] * (count - first)


def test_call_with_a_fault_does_not_count_for_the_next_fault():
    busy, lost = Fault(FaultKind.BUSY, first=1), Fault(FaultKind.LOSE_RESPONSE, first=1)
    assert planned([busy, lost], ["/a"] * 3) == [busy, lost, None]


def test_share_is_the_share_of_the_calls():
    fault = Fault(FaultKind.BUSY, share=0.3)
    struck = [each is fault for each in planned([fault], ["/a"] * 1000)]
    assert 250 < sum(struck) < 350


def test_plan_concerns_only_the_services_of_its_faults():
    plan = FaultPlan([Fault(FaultKind.BUSY, service="/a")], [lambda: 0.0])
    assert plan.concerns("/a")
    assert not plan.concerns("/b")
    assert FaultPlan([Fault(FaultKind.BUSY)], [lambda: 0.0]).concerns("/b")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lose-response:first=1", "the response is lost in the first call of /a"),
        ("lose-request:first=3", "the request is lost in the first 3 calls of /a"),
        ("delay-response:0.5s", "the response is 0.5 s late in every call of /a"),
        ("slow:2s,0.25", "the handler takes 2 s longer in 25 % of the calls of /a"),
        ("busy:0.5,first=9", "the caller gets ServerBusy in 50 % of the first 9 calls of /a"),
        (
            "cut-connection:service=/b",
            "the connection is cut before the response in every call of /b",
        ),
    ],
)
def test_fault_in_words(text, expected):
    assert str(parse_fault(text, "/a")) == expected
    assert str(parse_fault("busy")) == "the caller gets ServerBusy in every call of every service"
