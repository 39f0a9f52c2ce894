"""The call log shows each call once, with what the server knows about it, and stays bounded."""

import asyncio
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import taskrpc
from taskrpc.core.callinfo import CallInfo
from taskrpc.core.security.roles import Account, Accounts, Role
from taskrpc.errors import Code
from taskrpc.observe.web import calls
from taskrpc.observe.web.calls import CallLog, live_callers
from taskrpc.observe.web.streams import MAX_CALLS
from tests.core.transport.helpers import Add, Text, ask


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def log(clock):
    made = CallLog(wall_clock=lambda: 1000.0 + clock.now)
    made.is_active = True
    return made


def call(number, clock, service="/add", caller="/ada", principal="", deadline=None):
    return CallInfo(service, caller, principal, Role.ADMIN, number, deadline, clock)


def shown(log, clock):
    event = log.event(clock.now)
    return [] if event is None else [json.loads(each) for each in event.calls]


def stats(log, clock):
    return json.loads(log.event(clock.now).stats)


def test_ended_call_has_its_duration_and_its_code(log, clock):
    first, second = call(1, clock, deadline=102.0), call(2, clock)
    log.call_began(first)
    log.call_began(second)
    log.call_ended(first, Code.OK, 0.0003)
    log.call_ended(second, Code.DEADLINE_EXCEEDED, 0.02)
    ok, failed = shown(log, clock)
    assert ok == {
        "id": 1,
        "client": "/ada",
        "account": "",
        "service": "/add",
        "begin": 1100.0,
        "ms": 0.3,
        "state": "ok",
        "code": "",
        "deadline_ms": 2000.0,
        "attempt": 1,
        "repeated": False,
        "task_id": None,
    }
    assert (failed["state"], failed["code"]) == ("error", "DEADLINE_EXCEEDED")
    assert failed["deadline_ms"] is None
    assert shown(log, clock) == []


@pytest.mark.parametrize(
    ("after", "expected"),
    [(1.0, "CANCELLED"), (1.95, "DEADLINE_EXCEEDED"), (1.995, "DEADLINE_EXCEEDED")],
)
def test_call_that_its_client_cancels_at_its_timeout_is_shown_as_late(log, clock, after, expected):
    late = call(1, clock, deadline=102.0)
    log.call_began(late)
    clock.now += after
    log.call_ended(late, Code.CANCELLED, after)
    assert shown(log, clock)[0]["code"] == expected


def test_slow_call_is_shown_when_it_is_open_and_when_it_ends(log, clock):
    slow = call(1, clock)
    log.call_began(slow)
    assert shown(log, clock) == []
    clock.now += 2 * calls.SLOW
    [opened] = shown(log, clock)
    assert (opened["state"], opened["ms"]) == ("open", None)
    assert shown(log, clock) == []
    log.call_ended(slow, Code.OK, 1.0)
    [ended] = shown(log, clock)
    assert (ended["id"], ended["state"], ended["ms"]) == (1, "ok", 1000.0)


def test_request_that_could_not_be_decoded_is_shown(log, clock):
    log.call_ended(call(1, clock), Code.INVALID_ARGUMENT, 0.0)
    [refused] = shown(log, clock)
    assert refused["code"] == "INVALID_ARGUMENT"


@given(st.lists(st.integers(0, 300), max_size=5))
def test_every_call_is_shown_or_counted_as_skipped(floods):
    clock = Clock()
    log, number, found, skipped = CallLog(wall_clock=clock), 0, [], 0
    log.is_active = True
    for flood in floods:
        for _ in range(flood):
            number += 1
            log.call_began(call(number, clock))
            log.call_ended(call(number, clock), Code.OK, 0.001)
        clock.now += 0.2
        if (event := log.event(clock.now)) is not None:
            assert len(event.calls) <= MAX_CALLS
            found += [json.loads(each)["id"] for each in event.calls]
            skipped += event.skipped
    assert len(found) + skipped == number
    assert len(set(found)) == len(found)


def test_statistics_count_rate_errors_and_percentiles(log, clock):
    log.event(clock.now)
    for number in range(100):
        clock.now += 0.01
        log.call_began(call(number, clock))
        code = Code.INTERNAL if number % 10 == 0 else Code.OK
        log.call_ended(call(number, clock), code, (number + 1) / 1000)
    found = stats(log, clock)
    assert found["per_second"] == pytest.approx(100, rel=0.02)
    assert (found["total"], found["errors"], found["open"]) == (100, 10, 0)
    assert (found["p50_ms"], found["p99_ms"]) == (51.0, 100.0)
    clock.now += 10
    log.event(clock.now)
    clock.now += 10
    log.call_ended(call(101, clock), Code.OK, 0.001)
    assert stats(log, clock)["per_second"] == 0.3


def test_calls_that_wait_on_purpose_do_not_count_in_the_percentiles(log, clock):
    watching = call(1, clock, service="/robot_task/watch")
    log.call_began(watching)
    log.call_ended(watching, Code.OK, 10.0)
    assert stats(log, clock)["p50_ms"] is None


def test_without_pages_calls_are_counted_and_not_kept(log, clock):
    log.is_active = False
    for number in range(1000):
        log.call_began(call(number, clock, principal="ada"))
        log.call_ended(call(number, clock), Code.OK, 0.001)
    log.is_active = True
    event = log.event(clock.now)
    assert list(event.calls) == []
    assert json.loads(event.stats)["total"] == 1000
    assert log.accounts["ada"].calls == 1000
    assert not log.callers


def test_accounts_and_callers_are_bounded(log, clock):
    for number in range(20 * calls.MAX_CALLERS):
        log.call_began(call(number, clock, caller=f"/c{number}", principal=f"p{number}"))
    assert len(log.accounts) == 10 * calls.MAX_CALLERS
    assert len(log.callers) == calls.MAX_CALLERS
    assert next(reversed(log.callers))[0] == f"/c{number}"


async def test_caller_is_forgotten_a_minute_after_its_last_call():
    loop = asyncio.get_running_loop()
    log = CallLog()
    log.is_active = True
    log.call_began(call(1, loop.time, caller="/ada"))
    assert [each.name for each in live_callers(log)] == ["/ada"]
    await asyncio.sleep(calls.CALLER_SECONDS + 1)
    assert live_callers(log) == []


async def made_server(log, **options):
    node = taskrpc.Node("server", transport="memory", observer=log, **options)
    await node.start()
    return node


def add(request, response):
    response.sum = request.a + request.b
    return response


async def test_repeated_request_has_its_attempt_and_is_marked():
    log = CallLog()
    log.is_active = True
    now = asyncio.get_running_loop().time
    async with await made_server(log) as server, taskrpc.Node("ada", transport="memory") as ada:
        server.create_service(Add, "add", add, exactly_once=taskrpc.MemoryCompletions())
        client = ada.create_client(Add, "add")
        for _ in range(3):
            await client.call(ask(1, 2), request_id="mine")
        await client.call(ask(1, 3), request_id="other")
        found = [json.loads(each) for each in log.event(now()).calls]
    assert [each["attempt"] for each in found] == [1, 2, 3, 1]
    assert [each["repeated"] for each in found] == [False, True, True, False]
    assert {each["client"] for each in found} == {"/ada"}


async def test_request_that_an_earlier_server_answered_is_at_least_the_second_attempt():
    store = taskrpc.MemoryCompletions()
    now = asyncio.get_running_loop().time
    log = CallLog()
    async with taskrpc.Node("ada", transport="memory") as ada:
        client = ada.create_client(Add, "add")
        for _ in range(2):
            log = CallLog()
            log.is_active = True
            async with await made_server(log) as server:
                server.create_service(Add, "add", add, exactly_once=store)
                await client.call(ask(1, 2), request_id="mine")
    [again] = [json.loads(each) for each in log.event(now()).calls]
    assert (again["attempt"], again["repeated"]) == (2, True)


async def test_call_that_repeats_a_running_request_is_marked_while_it_waits():
    log, go_on = CallLog(), asyncio.Event()
    log.is_active = True
    now = asyncio.get_running_loop().time

    async def slow(request, response):
        await go_on.wait()
        return response

    async with await made_server(log) as server, taskrpc.Node("ada", transport="memory") as ada:
        server.create_service(Add, "add", slow, exactly_once=taskrpc.MemoryCompletions())
        client = ada.create_client(Add, "add")
        both = [
            asyncio.create_task(client.call(ask(1, 2), request_id="mine", timeout=None))
            for _ in range(2)
        ]
        await asyncio.sleep(1)
        found = [json.loads(each) for each in log.event(now()).calls]
        go_on.set()
        await asyncio.gather(*both)
    assert sorted((each["state"], each["repeated"]) for each in found) == [
        ("open", False),
        ("open", True),
    ]


async def test_account_of_a_caller_and_its_connections_are_known():
    accounts = Accounts([Account("ada", "s" * 20)])
    log = CallLog()
    log.is_active = True
    now = asyncio.get_running_loop().time
    async with await made_server(log, accounts=accounts) as server:
        server.create_service(Add, "add", add)
        assert server.status().accepted.accounts == {}
        async with taskrpc.Node("x", transport="memory", token="ada." + "s" * 20) as ada:
            await ada.create_client(Add, "add").call(ask(1, 2))
            assert server.status().accepted.accounts == {"ada": 1}
        await asyncio.sleep(1)
        assert server.status().accepted.accounts == {}
        [found] = [json.loads(each) for each in log.event(now()).calls]
    assert (found["client"], found["account"]) == ("/x", "ada")
    assert log.accounts["ada"].calls == 1


def ended(log, clock, number, code=Code.OK, response=None, **about):
    made = call(number, clock, principal="ada", **about)
    log.call_began(made)
    if response is not None:
        log.call_answered(made, response)
    log.call_ended(made, code, 0.1)


@pytest.mark.parametrize("is_active", [True, False])
def test_account_has_its_first_call_its_successes_and_the_last_problem(log, clock, is_active):
    log.is_active = is_active
    ended(log, clock, 1, service="/robot_task/health")
    account = log.accounts["ada"]
    assert (account.succeeded, account.problem) == (0, None), "`taskrpc join` calls it"
    clock.now += 5
    ended(log, clock, 2, Code.CANCELLED, deadline=clock.now + 0.05)
    assert account.problem == calls.Problem("/add", "DEADLINE_EXCEEDED")
    ended(log, clock, 3, response=Text.Response(message="Invalid task: fly" + 999 * "!"))
    assert account.problem.code == ""
    assert account.problem.message.startswith("Invalid task: fly")
    assert len(account.problem.message) == 200
    assert account.succeeded == 0
    ended(log, clock, 4, response=Text.Response(success=True))
    assert (account.succeeded, account.problem) == (1, None)
    assert (account.first, account.last, account.calls) == (1100.0, 1105.0, 4)
